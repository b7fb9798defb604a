"""How plainly the two packages are written: what `tests/layout.py` puts in its table."""
