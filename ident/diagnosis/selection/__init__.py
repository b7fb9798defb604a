"""Candidate changes of an arm: evaluation beside a model, acceptance criteria, estimates with intervals."""
