"""The planners: one file each, one interface; those of the paper and its peers are loaded when they are named."""
