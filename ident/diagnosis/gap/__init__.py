"""How large the gap is, where it lies, and how far it shrinks."""
