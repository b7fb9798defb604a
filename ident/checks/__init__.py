"""Is a recording fit for use?

Finds faults, mends what can be mended safely, and refuses what can't.
"""
