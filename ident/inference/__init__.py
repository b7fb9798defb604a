"""From rows to causes: one log evidence over sets of effects, their weights, and calibrated
probabilities.
"""
