"""Named effects written where simulators can use them, and measured there."""
