"""How far a file is from recordings, and which of all candidates is written.

Torque: RMS of measured less predicted log, both through the run's own filter, where a joint slides. Energy: RMS over
the runs of the work that this difference does. Replay: the arm starts from a measured state, gets the logged torque for
a quarter of a second, and is compared with the measured state at the end; from a longer stretch without feedback any
model drifts away, and nothing is learnt of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.export.loaded import LoadedModel
from ident.export.loading import FILE_OF, WrittenFile
from ident.laws.acting import shifted
from ident.laws.motion import Losses
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


# Which file is written: of all candidates the one that is nearest to recordings that no fit has seen.
# Candidates are the URDF's arm, the arm tuned to the same recordings, the arm with its effects, and mixtures: the
# bodies of one of them, and at each joint the losses and laws of one. A file whose torque is worse than the URDF's at
# any joint is never written; of the others the one whose worst joint, in torque, energy or replay, is best. Worse is
# what is so beyond the scatter between stretches of the recordings.


# One file is worse than another beyond this logarithm of the ratio of their errors: less are the simulators' own steps.
WORTH = 0.01
# Errors below these are none: torque [N m], energy [J], position [rad].
LEAST = {"torque": 1e-6, "energy": 1e-6, "position": 1e-7}
SAID = {
    "before": "the URDF's bodies with tuned losses",
    "tuned": "bodies and losses tuned without the effects",
    "after": "bodies, losses and effects together",
}


@dataclass(frozen=True, eq=False)
class Chosen:
    """The file to be written.

    Attributes:
        stated: What it holds.
        bodies: Whose bodies it has, a name of the candidates.
        joints: Whose losses and laws each joint has.
        gaps: Its errors, and those of the candidates that are told beside it.
        worse: Joints at which another candidate is nearer in some measure, with the largest ratio.
    """

    stated: IdentifiedArm
    bodies: str
    joints: tuple[str, ...]
    gaps: Mapping[str, Gap]
    worse: Mapping[str, float]

    @property
    def name(self) -> str:
        """The candidate that it is, or `mixed`."""
        return self.bodies if set(self.joints) == {self.bodies} else "mixed"

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        joints = dict(zip(names, self.joints, strict=True))
        return {"written": self.name, "bodies": self.bodies, "joints": joints, "worse": dict(self.worse)}

    def in_words(self, form: str, names: Sequence[str]) -> list[str]:
        """What a user should know of the choice."""
        lines = []
        if self.name != "after":
            own = [name for name, when in zip(names, self.joints, strict=True) if when != "after"]
            words = f"{SAID[self.bodies]}" + (f"; losses without effects at {', '.join(own)}" if own else "")
            lines.append(f"{FILE_OF[form]}: on these runs the best of its candidates has {words}")
        for name, ratio in self.worse.items():
            lines.append(f"{FILE_OF[form]}: at {name} another candidate is nearer, by a factor of {ratio:.2f}")
        return lines


def choose(form: str, options: Mapping[str, IdentifiedArm], runs: Sequence[Motion], folder: Path) -> Chosen:
    """The nearest candidate of a format.

    Args:
        form: `urdf` or `mjcf`.
        options: What each candidate would hold; the first is what none may be worse than.
        runs: Recordings that no candidate was fitted to.
        folder: A scratch folder.
    """
    payload, names_of = runs[0].payload, next(iter(options.values())).nominal.joint_names
    n = len(names_of)
    found: dict[tuple[str, tuple[str, ...]], Gap] = {}

    def measure(bodies: str, joints: tuple[str, ...]) -> Gap:
        key = bodies, joints
        if key not in found:
            file = WrittenFile.write(form, folder, mix(options, *key))
            found[key] = measure_gap(file.load(payload), runs)
        return found[key]

    alone = {name: measure(name, (name,) * n) for name in options}
    others = [gap for name, gap in alone.items() if name != "after"]
    for bodies in options:
        names = [bodies, *(name for name in options if name != bodies)]  # of the same errors its own are taken
        surely, likely = np.stack([_against(measure(bodies, (name,) * n), others) for name in names], axis=1)
        best = np.lexsort((likely.mean(axis=1), np.maximum(surely.max(axis=1), WORTH)), axis=0)[0]
        measure(bodies, tuple(names[k] for k in best))
    fit = [key for key, gap in found.items() if _against(gap, others[:1])[0, 0].max() <= WORTH]
    far = {key: _against(found[key], others) for key in fit}
    # Least where no joint is worse than another candidate's, and then where all errors are least on the whole.
    bodies, joints = min(fit, key=lambda key: (max(far[key][0].max(), WORTH), far[key][1].mean()))
    surely, likely = far[bodies, joints]
    ratios = np.exp(np.where(surely > WORTH, likely, 0.0).max(axis=0))
    worse = {name: float(ratio) for name, ratio in zip(names_of, ratios, strict=True) if ratio > 1.0}
    gaps = {name: gap for name, gap in alone.items() if name != "after"} | {"after": found[bodies, joints]}
    return Chosen(mix(options, bodies, joints), bodies, joints, gaps, worse)


def _against(gap: Gap, others: Sequence[Gap]) -> Float[Array, "2 m n"]:
    """Logarithms of how many times larger errors are than the least of others': surely, and as they are.

    Surely larger is what is so beyond twice the deviation by which single stretches of the recordings scatter.
    """
    found = np.zeros((2, len(MEASURES), len(others), len(gap.torque)))
    for k, (one, least) in enumerate(LEAST.items()):
        own = gap.parts[one] + least**2
        for i, other in enumerate(others):
            theirs = other.parts[one] + least**2
            if len(own) > 1:
                mean, usual = own.mean(axis=0), theirs.mean(axis=0)
                ratio = 0.5 * np.log(mean / usual)
                chance = 0.5 * np.std(own / mean - theirs / usual, axis=0) / np.sqrt(len(own) - 1)
                found[:, k, i] = np.maximum(ratio - 2.0 * chance, 0.0), ratio
    return found.max(axis=2)


def mix(options: Mapping[str, IdentifiedArm], bodies: str, joints: Sequence[str]) -> IdentifiedArm:
    """The bodies of one candidate, with the losses and laws of one at each joint."""
    losses = Losses(
        *(
            np.array([getattr(options[name].losses, one.name)[j] for j, name in enumerate(joints)])
            for one in fields(Losses)
        )
    )
    changes = [change for change in options[bodies].changes if change.of_the_bodies]
    for j, name in enumerate(joints):
        changes += [c for c in options[name].changes if c.joint == j and not c.of_the_bodies]
    return replace(options[bodies], losses=losses, changes=tuple(changes))
