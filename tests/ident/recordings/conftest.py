"""A made-up recording of two joints, and its native table."""

import numpy as np
import pytest

from ident.recordings.recording import Recording

HEADER = "time,a/position,b/position,a/effort,b/effort"


@pytest.fixture
def run() -> Recording:
    """400 samples at 100 Hz."""
    time = 0.01 * np.arange(400)
    phase = time[:, None] + np.arange(2)
    return Recording("run", ("a", "b"), time, np.sin(phase), np.cos(phase), velocity=np.cos(phase))


@pytest.fixture
def lines(run: Recording) -> list[str]:
    """The recording as a native CSV: the header and 400 rows of six decimals."""
    table = np.column_stack([run.time, run.position, run.effort])
    return [HEADER, *(",".join(f"{value:.6f}" for value in row) for row in table)]
