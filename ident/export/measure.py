"""How far a loaded file is from recordings: in torque, in energy and in motion.

Torque: RMS of measured less predicted log, both through the run's own filter, where a joint slides. Energy: RMS over
the runs of the work that this difference does. Replay: the arm starts from a measured state, gets the logged torque for
a quarter of a second, and is compared with the measured state at the end; from a longer stretch without feedback any
model drifts away, and nothing is learnt of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.export.loaded import LoadedModel
from ident.laws.acting import shifted
from ident.motion.motion import Motion

WINDOW = 0.25  # [s]
MOST_WINDOWS = 24
# Stretches by whose scatter it is told whether one file's errors are larger than another's by more than chance [s].
STRETCH = 1.0
# Measures by which files are compared, and their names in a record.
MEASURES = {"torque": "torque_rms_Nm", "energy": "energy_J", "position": "position_rms_rad"}


@dataclass(frozen=True, eq=False)
class Gap:
    """How far a model is from recordings, joint by joint.

    Attributes:
        torque: RMS of the torque [N m], shape (n,).
        energy: RMS over the runs of the energy error [J], shape (n,).
        position: RMS of the position at the end of a window [rad], shape (n,); NaN where nothing was replayed.
        velocity: RMS of the velocity there [rad/s], shape (n,).
        windows: Number of windows.
        count: Samples behind the torque, shape (n,).
        parts: By measure the squared errors of single stretches, those of the position of single windows, (B, n).
    """

    torque: Float[Array, " n"]
    energy: Float[Array, " n"]
    position: Float[Array, " n"]
    velocity: Float[Array, " n"]
    windows: int
    count: Float[Array, " n"]
    parts: Mapping[str, Float[Array, "B n"]]

    @property
    def rms(self) -> float:
        """RMS of the torque over all joints' samples [N m]."""
        return float(np.sqrt(self.count @ self.torque**2 / max(self.count.sum(), 1.0)))

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        named = {**MEASURES, "velocity": "velocity_rms_rad_s"}
        told = {key: dict(zip(joints, map(float, getattr(self, name)), strict=True)) for name, key in named.items()}
        return {**told, "windows": self.windows}


@dataclass(frozen=True, eq=False)
class Helper:
    """A written module, loaded from its file, that stands in for what a file lacks.

    Attributes:
        module: The module.
        file: Which file it helps: `urdf`, for which it also says what the log reads, or `mjcf`.
    """

    module: ModuleType
    file: str

    @property
    def reads_log(self) -> bool:
        return self.file == "urdf"

    def missing(self, motion: Motion) -> Float[Array, "T n"]:
        """Joint torque that the file lacks along a run [N m]."""
        states = (motion.q, motion.dq, motion.ddq, motion.interval)
        return np.asarray(self.module.missing_torque(self.file, *states), dtype=float)


def measure_gap(model: LoadedModel, runs: Sequence[Motion], helper: Helper | None = None) -> Gap:
    """All distances of a loaded file from recordings, alone or with a module's help."""
    n = runs[0].n
    counts, work = np.zeros(n), np.zeros(n)
    squares: list[Array] = []
    works: list[Array] = []
    ends: list[Array] = []
    each = max(1, MOST_WINDOWS // len(runs))
    for motion in runs:
        missing = helper.missing(motion) if helper else np.zeros_like(motion.q)
        left = motion.tau_filtered - motion.filtered(predict_log(model, motion, helper, missing))
        left = np.where(motion.settled, left, 0.0)
        counts += motion.settled.sum(axis=0)
        step = motion.interval * motion.lowpass.factor
        starts = np.arange(0, len(left), max(1, round(STRETCH / step)))
        squares.append(np.add.reduceat(left**2, starts, axis=0))
        works.append(np.add.reduceat(left * motion.dq[motion.coarse] * step, starts, axis=0))
        work += np.sum(works[-1], axis=0) ** 2
        ends.append(_roll_run(model, motion, helper, missing, each))
    missed, torques = np.concatenate(ends, axis=1), np.concatenate(squares)
    parts = {"torque": torques, "energy": np.concatenate(works) ** 2, "position": missed[0] ** 2}
    windows = missed.shape[1]
    miss = np.sqrt(np.mean(missed**2, axis=1)) if windows else np.full((2, n), np.nan)
    torque = np.sqrt(torques.sum(axis=0) / np.maximum(counts, 1.0))
    return Gap(torque, np.sqrt(work / len(runs)), miss[0], miss[1], windows, counts, parts)


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
) -> Float[Array, "2 w n"]:
    """Misses of position and velocity at the ends of evenly spread windows."""
    if helper is not None and helper.reads_log:
        drive = np.asarray(helper.module.torque_of_log(motion.tau, motion.interval), dtype=float)
    else:
        drive = shifted(np.array(motion.tau), -model.delay, motion.interval)
    length = max(2, round(WINDOW / motion.interval))
    twists = model.deflections(motion.q, motion.dq, motion.ddq, motion.interval)
    starts = np.linspace(length, len(motion.time) - 2 * length, count).astype(int)
    starts = np.unique(starts[starts >= 0])
    if not len(starts):
        return np.zeros((2, 0, motion.n))
    rows = starts[:, None] + np.arange(length + 1)
    state = np.stack([motion.q, motion.dq])
    ends = model.roll_out(state[:, starts], twists[starts, :2], drive[rows], -missing[rows], motion.interval)
    return ends - state[:, starts + length]
