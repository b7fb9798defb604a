"""Which effects get a name: search, tests, estimates with intervals."""
