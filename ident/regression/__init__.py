"""The one big regression: its columns, rows, block sums and solves."""
