"""Writes joint states as a session that armgap reads."""
