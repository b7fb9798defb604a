"""Torque and power of trajectories, in batches."""
