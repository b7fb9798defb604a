"""The catalogue of effects: what a joint may do that its model does not know."""
