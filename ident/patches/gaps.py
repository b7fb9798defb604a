"""Two distances of a loaded model from recordings: of torque, and of motion.

Torque gap: RMS of measured less predicted log, both through the run's own filter, where a joint slides. Rollout gap:
the arm starts from a measured state, gets the logged torque for a quarter of a second, and is compared with the
measured state at the end; from a longer stretch without feedback any model drifts away, and nothing is learnt of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.motion.motion import Motion
from ident.patches.loaded import LoadedModel
from ident.patches.standalone.log import shifted

WINDOW = 0.25  # [s]
MOST_WINDOWS = 24

# Joint torque that a model lacks along a run [N m], and the joint torque behind its log.
Missing = Callable[[Motion], Float[Array, "T n"]]


@dataclass(frozen=True, eq=False)
class Gap:
    """How far a model is from recordings.

    Attributes:
        torque: RMS of the torque [N m], shape (n,).
        position: RMS of the position at the end of a window [rad], shape (n,).
        velocity: RMS of the velocity there [rad/s], shape (n,).
        windows: Number of windows.
    """

    torque: Float[Array, " n"]
    position: Float[Array, " n"]
    velocity: Float[Array, " n"]
    windows: int

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        return {
            "torque_rms_Nm": dict(zip(joints, map(float, self.torque), strict=True)),
            "position_rms_rad": dict(zip(joints, map(float, self.position), strict=True)),
            "velocity_rms_rad_s": dict(zip(joints, map(float, self.velocity), strict=True)),
            "windows": self.windows,
        }


@dataclass(frozen=True, eq=False)
class Helper:
    """A written module that stands in for what a file lacks.

    Attributes:
        module: The module, loaded from its file.
        file: Which file it helps, `urdf` or `mjcf`.
        reads_log: Whether the module also says what the log reads: for files that can't.
    """

    module: ModuleType
    file: str
    reads_log: bool

    def missing(self, motion: Motion) -> Float[Array, "T n"]:
        """Joint torque that the file lacks along a run [N m]."""
        return np.asarray(
            self.module.missing_torque(self.file, motion.q, motion.dq, motion.ddq, motion.interval), dtype=float
        )


def measure_gap(model: LoadedModel, motions: Sequence[Motion], helper: Helper | None = None) -> Gap:
    """Both distances of a model, alone or with a module's help."""
    n = motions[0].n
    squares, counts = np.zeros(n), np.zeros(n)
    ends: list[Array] = []
    each = max(1, MOST_WINDOWS // len(motions))
    for motion in motions:
        missing = helper.missing(motion) if helper else np.zeros_like(motion.q)
        left = motion.tau_filtered - motion.filtered(predict_log(model, motion, helper, missing))
        settled = motion.settled
        squares += np.sum(np.where(settled, left, 0.0) ** 2, axis=0)
        counts += settled.sum(axis=0)
        ends += _roll_run(model, motion, helper, missing, each)
    miss = np.sqrt(np.mean(np.array(ends) ** 2, axis=0))
    return Gap(np.sqrt(squares / np.maximum(counts, 1.0)), miss[0], miss[1], len(ends))


def predict_log(
    model: LoadedModel, motion: Motion, helper: Helper | None, missing: Float[Array, "T n"]
) -> Float[Array, "T n"]:
    """Torque log of a run as the model has it [N m]."""
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval) + missing
    if helper is not None and helper.reads_log:
        return np.asarray(helper.module.log_of_torque(torque, motion.interval), dtype=float)
    return model.read_log(torque, motion.interval)


def _roll_run(
    model: LoadedModel, motion: Motion, helper: Helper | None, missing: Float[Array, "T n"], count: int
) -> list[Float[Array, "2 n"]]:
    """Misses of position and velocity at the ends of evenly spread windows."""
    if helper is not None and helper.reads_log:
        drive = np.asarray(helper.module.torque_of_log(motion.tau, motion.interval), dtype=float)
    else:
        drive = shifted(np.array(motion.tau), -model.delay, motion.interval)
    length = max(2, round(WINDOW / motion.interval))
    twists = model.deflections(motion.q, motion.dq, motion.ddq, motion.interval)
    starts = np.linspace(length, len(motion.time) - 2 * length, count).astype(int)
    found = []
    for start in np.unique(starts[starts >= 0]):
        span = slice(start, start + length + 1)
        state = motion.q[start], motion.dq[start]
        q, dq = model.roll_out(state, twists[start, :2], drive[span], -missing[span], motion.interval)
        found.append(np.stack([q - motion.q[start + length], dq - motion.dq[start + length]]))
    return found
