"""Recordings: runs and sessions, read from and written to every kind of file, damage cut out."""
