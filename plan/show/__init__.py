"""Console, pictures and the Rerun timeline of a plan."""
