"""A page on this machine in which a log and a robot are given, checked and diagnosed: `ident open`."""
