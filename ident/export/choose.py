"""How far a file is from recordings, and which of all candidates is written.

Torque: RMS of measured less predicted log, both through the run's own filter, where a joint slides. Energy: how far the
work that this difference does strays on its way through a stretch of time: the standard deviation of the work done so
far, for at a stretch's end it is next to nothing by chance in one file or another. Replay: the arm starts from a
measured state, gets the logged torque for a quarter of a second, and is compared with the measured state at the end,
joints that stood still aside; from a longer stretch without feedback any model drifts away, and nothing is learnt of
it. A position that is missed by more than the way that the joint went is not foretold at all: how far beyond it is says
nothing, and one replay that flies off would make the mean of all.

Candidates are the URDF's arm, the arm tuned to the same recordings, the arm with its effects, and mixtures: the bodies
of one of them, and at each joint the losses and laws of the one that does best there with these bodies. None is fitted
to the recordings that decide: what they would make of one is partly chance, and comes out better than it is. The best
whole one has the least errors, as shares of the least of the first two's: a gain counts as far as stretches and windows
make sure of it, a loss as far as they let expect one, and several times as much. A mixture, never fitted as one and the
best of many, is written where it gains as much on the best whole one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student_t

from ident.arrays import Array, Bool, Float, Int
from ident.command_options import HORIZON
from ident.export.identified import IdentifiedArm
from ident.export.loaded import FILE_OF, LoadedModel, WrittenFile, log_error
from ident.laws.motion import Losses
from ident.motion.motion import Motion

WINDOW = HORIZON  # [s]
MOST_WINDOWS = 24
# Measures by which files are compared, their names in a record, and errors that are none: [N m], [J], [rad].
MEASURES = {"torque": "torque_rms_Nm", "energy": "energy_J", "position": "position_rms_rad"}
LEAST = {"torque": 1e-6, "energy": 1e-6, "position": 1e-7}
# One file is worse than another beyond this logarithm of the ratio of their errors: less are the simulators' own steps.
WORTH = 0.005
# How sure a gain has to be to count.
LEVEL = 0.975
# What a loss that is to be expected counts against a gain that is sure, both as logarithms of errors' ratios.
WORSE = 5.0
# Stretches of a run whose work is compared [s].
STRETCH = 2.0
SAID = {
    "given": "the URDF as it is",
    "before": "the URDF's bodies with tuned losses",
    "tuned": "bodies and losses tuned without the effects",
    "after": "bodies, losses and effects together",
}


@dataclass(frozen=True, eq=False)
class Gap:
    """How far a model is from recordings, joint by joint.

    Squared errors of torque (with the share of its samples), energy, position and velocity, of each of k stretches or
    windows: their means are the squares of the errors in N m, J, rad and rad/s.
    """

    squares: Mapping[str, Float[Array, "k n"]]
    count: Float[Array, " n"]  # samples behind the torque

    def error(self, name: str) -> Float[Array, " n"]:
        """RMS of a measure, NaN where nothing was measured."""
        return np.sqrt(self.squares[name].mean(axis=0))

    @property
    def rms(self) -> float:
        """RMS of the torque over all joints' samples [N m]."""
        return float(np.sqrt(self.count @ self.error("torque") ** 2 / max(self.count.sum(), 1.0)))

    def over(self, others: Sequence[Gap], level: float = 0.5) -> Float[Array, "m n"]:
        """Logarithms of its errors over the least of others', by measure and joint; zero where nothing was measured.

        Those that are not exceeded at a level, by Student's distribution of what stretches, pair by pair, leave open; a
        single one leaves open all.
        """
        found = []
        for name, least in LEAST.items():
            own, *theirs = (one.squares[name] + least**2 for one in (self, *others))
            best = np.argmin([one.mean(axis=0) for one in theirs], axis=0)
            rival = np.array(theirs)[best, :, np.arange(own.shape[1])].T
            found.append(np.nan_to_num(log_ratio(own, rival, level)))
        return np.array(found)

    def cost(self, others: Sequence[Gap]) -> Float[Array, " n"]:
        """What each joint's errors cost against the least of others': losses to be expected less sure gains."""
        found = self.over(others)
        sure = self.over(others, LEVEL)
        error = np.maximum((sure - found) / norm.ppf(LEVEL), 1e-12)
        loss = error * norm.pdf(found / error) + found * norm.cdf(found / error)
        return np.sum(WORSE * loss + np.minimum(sure, 0.0), axis=0)

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """Its record, figures by the joints' names."""
        named = (*MEASURES.items(), ("velocity", "velocity_rms_rad_s"))
        errors = {
            key: dict(zip(joints, map(float, self.error(name)), strict=True)) for name, key in named
        }
        return {**errors, "windows": int(np.isfinite(self.squares["position"][:, 0]).sum())}


def log_ratio(squares: Array, rivals: Array, level: float = 0.5) -> Array:
    """Logarithm of the ratio of two root mean squares that is not exceeded at a level.

    Args:
        squares: Squared errors of k stretches, shape (k,) or (k, n); none is zero.
        rivals: Another file's, on the same stretches.
        level: Of Student's distribution of what stretches, pair by pair, leave open; a single one
            leaves open all.
    """
    number = max(len(squares), 2)
    ratio = np.log(squares.mean(axis=0) / rivals.mean(axis=0))
    if len(squares) > 1:
        differences = squares / squares.mean(axis=0) - rivals / rivals.mean(axis=0)
        scatter = differences.std(axis=0, ddof=1)
    else:
        scatter = 1.0 * (ratio != 0.0)
    reach = float(student_t.ppf(level, number - 1)) * scatter / np.sqrt(number)
    return np.asarray(0.5 * (ratio + reach))


def measure_gap(model: LoadedModel, runs: Sequence[Motion]) -> Gap:
    """All distances of a loaded file from recordings."""
    each = max(1, MOST_WINDOWS // len(runs))
    rolled = [roll_run(model, motion, each) for motion in runs]
    moved = np.concatenate([replayed.moved for replayed in rolled])
    replay = np.concatenate([replayed.missed for replayed in rolled], axis=1) ** 2
    replay = replay * moved * len(moved) / np.maximum(moved.sum(axis=0), 1)
    replay = replay if replay.size else np.full((2, 1, runs[0].n), np.nan)
    replayed = dict(zip(("position", "velocity"), replay, strict=True))
    counts = np.zeros(runs[0].n)
    squares = []
    works = []
    for motion in runs:
        left = log_error(model, motion)
        counts += motion.settled.sum(axis=0)
        step = motion.interval * motion.lowpass.factor
        number = max(1, round(len(left) * step / STRETCH))
        starts = np.linspace(0, len(left), number, endpoint=False).astype(int)
        squares.append(np.add.reduceat(left**2, starts, axis=0))
        work = np.cumsum(left * motion.dq[motion.coarse] * step, axis=0)
        works += [part.var(axis=0) for part in np.split(work, starts[1:])]
    torque = np.concatenate(squares) * len(works) / np.maximum(counts, 1.0)
    return Gap({"torque": torque, "energy": np.array(works), **replayed}, counts)


@dataclass(frozen=True, eq=False)
class Replayed:
    """Replays of w windows of one run."""

    missed: Float[Array, "2 w n"]  # of position, up to the joint's way, and velocity at the ends
    moved: Bool[Array, "w n"]  # which joints moved in them
    ends: Int[Array, " w"]  # rows of the run at which they end


def roll_run(model: LoadedModel, motion: Motion, count: int, horizon: float = WINDOW) -> Replayed:
    """Replays evenly spread windows of a run; a window's way is the path of the joint in it.

    Args:
        model: A loaded file.
        motion: The run.
        count: The most windows.
        horizon: Their length [s].
    """
    samples = min(horizon / motion.interval, len(motion.time))  # a longer window fits no run
    length = max(2, round(samples))
    starts = np.zeros(0, dtype=int)
    if len(motion.time) >= 3 * length:
        starts = np.unique(np.linspace(length, len(motion.time) - 2 * length, count).astype(int))
    if not len(starts):
        return Replayed(np.zeros((2, 0, motion.n)), np.zeros((0, motion.n), bool), starts)
    rows = starts[:, None] + np.arange(length + 1)
    states = (motion.q, motion.dq, motion.ddq, motion.interval)
    drive = model.undo_log(np.array(motion.tau), motion.interval)[rows]
    twists = model.deflections(*states)
    missing = model.missing(*states)
    state = np.stack([motion.q, motion.dq])
    begin = (state[:, starts], twists[starts, :2])
    arrived = model.roll_out(*begin, drive, -missing[rows], motion.interval)
    speed = np.abs(motion.dq[rows])
    way = speed[:, 1:].sum(axis=1) * motion.interval
    ends = starts + length
    missed = arrived - state[:, ends]
    missed[0] = np.clip(missed[0], -way, way)
    return Replayed(missed, (speed > motion.rest_speed).any(axis=1), ends)


@dataclass(frozen=True, eq=False)
class Chosen:
    """The file to be written."""

    stated: IdentifiedArm  # what it holds
    bodies: str  # whose bodies it has, a name of the candidates
    joints: tuple[str, ...]  # whose losses and laws each joint has
    gaps: Mapping[str, Gap]  # its errors, and those of the candidates that are reported beside it
    # Joints at which another candidate is nearer in some measure, with that measure and the largest ratio.
    worse: Mapping[str, tuple[str, float]]
    tried: int = 1  # candidates that were measured

    @property
    def name(self) -> str:
        """The candidate that it is, or `mixed`."""
        return self.bodies if set(self.joints) == {self.bodies} else "mixed"

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Its record, figures by the joints' names."""
        worse = {name: ratio for name, (_, ratio) in self.worse.items()}
        joints = zip(names, self.joints, strict=True)
        return {"written": self.name, "bodies": self.bodies, "joints": dict(joints), "worse": worse}

    def in_words(self, form: str, names: Sequence[str]) -> list[str]:
        """What a user should know of the choice."""
        lines = []
        if self.name != "after":
            own = [name for name, when in zip(names, self.joints, strict=True) if when != "after"]
            words = SAID[self.bodies] + (
                f"; losses without effects at {', '.join(own)}" if own else ""
            )
            lines.append(f"{FILE_OF[form]}: on these runs the best of its candidates has {words}")
        for name, (measure, ratio) in self.worse.items():
            lines.append(
                f"{FILE_OF[form]}: at {name} its error of {measure} is {ratio:.2f} of another candidate's"
            )
        return lines


def choose(
    form: str, options: Mapping[str, IdentifiedArm], runs: Sequence[Motion], folder: Path
) -> Chosen:
    """The nearest candidate of a format on recordings that none was fitted to; `folder` is for scratch files."""
    n = runs[0].n
    found = dict[tuple[str, tuple[str, ...]], Gap]()

    def measure(bodies: str, joints: tuple[str, ...]) -> Gap:
        if (bodies, joints) not in found:
            file = WrittenFile.write(form, folder, mix(options, bodies, joints))
            found[bodies, joints] = measure_gap(file.load(runs[0].payload), runs)
        return found[bodies, joints]

    own = {name: measure(name, (name,) * n) for name in options}
    others = [gap for name, gap in own.items() if name != "after"]
    for bodies in options:
        order = [
            bodies,
            *(name for name in options if name != bodies),
        ]  # of the same errors its own are taken
        if bodies != "given" or "before" not in options:  # its bodies are those of `before`
            costs = np.array([measure(bodies, (name,) * n).cost(others) for name in order])
            measure(bodies, tuple(order[k] for k in costs.argmin(axis=0)))
    whole = own[min(own, key=lambda name: own[name].cost(others).sum())]
    bodies, joints = min(found, key=lambda key: found[key].cost([whole]).sum())
    gap = found[bodies, joints]
    most = zip(options["after"].nominal.joint_names, gap.over(others).T, strict=True)
    worse = {
        name: (list(MEASURES)[r.argmax()], float(np.exp(r.max())))
        for name, r in most
        if r.max() > WORTH
    }
    gaps = own | {"after": gap}
    return Chosen(mix(options, bodies, joints), bodies, joints, gaps, worse, len(found))


def mix(options: Mapping[str, IdentifiedArm], bodies: str, joints: Sequence[str]) -> IdentifiedArm:
    """An arm of several candidates' parts.

    Args:
        options: The candidates by name.
        bodies: The one whose bodies are taken, with what a diagnosis changed of them.
        joints: For each joint the name of the candidate whose losses and laws it gets.
    """
    mixed = (
        [getattr(options[name].losses, one.name)[j] for j, name in enumerate(joints)]
        for one in fields(Losses)
    )
    losses = Losses(*map(np.array, mixed))
    changes = [change for change in options[bodies].changes if change.of_the_bodies]
    for j, name in enumerate(joints):
        changes += [c for c in options[name].changes if c.joint == j and not c.of_the_bodies]
    return replace(options[bodies], losses=losses, changes=tuple(changes))
