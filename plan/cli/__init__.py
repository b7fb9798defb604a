"""The command `plan`: parse, call, print."""
