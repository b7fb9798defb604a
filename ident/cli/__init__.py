"""The command `ident`: parse, call, print."""
