"""What each command does, as a Python function: `from ident import diagnose`."""
