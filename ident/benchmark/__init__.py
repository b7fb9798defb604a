"""The check on withheld effects: simulate, seal, diagnose without the answer, open, score.

`run.run_blind` does all of it. Nothing is imported here: the diagnosing processes must not know the
plant.
"""
