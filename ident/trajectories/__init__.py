"""Reference motions of an arm, within its limits, and the files that command them."""
