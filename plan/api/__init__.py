"""What each command does, as a Python function: `from plan import solve`."""
