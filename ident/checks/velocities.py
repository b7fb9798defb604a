"""Measured velocity against the positions' derivative, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.filtered_run import filter_run
from ident.recordings.recording import Session

# A joint's velocity is compared where it moves: at rest both are noise. [rad/s]
MOVING_RAD_S = 0.02


@dataclass(frozen=True, eq=False)
class Velocities:
    """Measured velocity = slope · derivative of position, per joint, where it moves."""

    moving: Bool[Array, " n"]
    slope: Float[Array, " n"]
    correlation: Float[Array, " n"]


def compare_velocities(session: Session) -> Velocities | None:
    """Slope and correlation over all runs; None where no velocity was measured."""
    motions = [motion for run in session.runs if (motion := filter_run(run)) is not None]
    motions = [motion for motion in motions if motion.dq_measured is not None]
    if not motions:
        return None
    derived = np.concatenate([motion.dq for motion in motions])
    measured = np.concatenate([motion.dq_measured for motion in motions if motion.dq_measured is not None])
    xx, xy, yy = (derived**2).mean(axis=0), (derived * measured).mean(axis=0), (measured**2).mean(axis=0)
    # A wrong time base scales the derivative, so moving is told by either of the two.
    moving = np.maximum(np.sqrt(xx), np.sqrt(yy)) > MOVING_RAD_S
    return Velocities(moving, xy / np.maximum(xx, 1e-300), xy / np.sqrt(np.maximum(xx * yy, 1e-300)))
