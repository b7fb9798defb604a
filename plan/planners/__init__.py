"""The planners: one file each, one interface.

Those of the paper and its peers are loaded when they are named.
"""
