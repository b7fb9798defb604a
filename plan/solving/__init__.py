"""One task solved, or all methods compared."""
