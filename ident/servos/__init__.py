"""Arms that log goal and position only: hobby servos, whose torque nobody measures."""
