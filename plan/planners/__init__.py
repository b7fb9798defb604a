"""The planners: one file each, one interface."""
