"""A page on this machine where a log and a robot are given, checked, diagnosed: `ident open`."""
