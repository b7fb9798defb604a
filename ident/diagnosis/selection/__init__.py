"""Selection of effects: search, acceptance criteria, probabilities, estimates with intervals."""
