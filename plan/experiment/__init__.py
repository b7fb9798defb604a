"""The next motion to record.

What tells two models apart, or a model's parameters from the rest, in the least time.
"""
