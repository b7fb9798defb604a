"""The hybrid model: loss, inertias, residual net, and what each rung of it is worth."""
