"""A hybrid model from recordings: the shared regression with losses and inertias as its columns."""
