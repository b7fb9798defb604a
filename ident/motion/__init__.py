"""From samples to motions: smoothing, one common filter, and memory that does not grow with a
session.
"""
