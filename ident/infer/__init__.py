"""A foreign table -> a session.toml: columns, units, signs, rate and joint order, guessed.

Each with its evidence.
"""
