"""A foreign table -> a session.toml: columns, units, signs, rate and joint order, guessed, each with its evidence."""
