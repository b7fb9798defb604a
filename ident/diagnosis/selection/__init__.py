"""Which effects get a name: search, tests, figures with intervals."""
