"""Settings of the planner's tests."""

import os

# Small batches: one thread is faster than two that wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
