"""Arms through time: estimates of each session in a store, alarms whose false rate holds, pages of
arm and fleet.
"""
