"""Energy- and time-optimal, collision-free motions on an identified arm."""
