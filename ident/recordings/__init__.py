"""Recordings: runs and sessions, read from and written to every kind of file, damage cut out."""

# Topic of the joint states in a bag, where nobody says another.
TOPIC = "/joint_states"
