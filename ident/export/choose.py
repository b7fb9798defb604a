"""How far a file is from recordings, and which of all candidates is written.

Torque: RMS of measured less predicted log, both through the run's own filter, where a joint slides.
Energy: how far the work that this difference does strays on its way through a stretch of time: the
standard deviation of the work done so far, for at a stretch's end it is next to nothing by chance
in one file or another. Replay: the arm starts from a measured state, gets the logged torque for a
quarter of a second, and is compared with the measured state at the end, joints that stood still
aside; from a longer stretch without feedback any model drifts away, and nothing is learnt of it. A
position that is missed by more than the way that the joint went is not foretold at all: how far
beyond it is says nothing, and one replay that flies off would make the mean of all.

Candidates are the URDF's arm, the arm tuned to the same recordings, the arm with its effects, and
mixtures: the bodies of one of them, and at each joint the losses and laws of the one that does best
there with these bodies. None is fitted to the recordings that decide: what they would make of one
is partly chance, and comes out better than it is. The best whole one has the least errors, as
shares of the least of the first two's: a gain counts as far as stretches and windows make sure of
it, a loss as far as they let expect one, and several times as much. A mixture, never fitted as one
and the best of many, is written where it gains as much on the best whole one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

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
# Measures by which files are compared, their names in a record, and errors that are none: [N m],
# [J], [rad].
MEASURES = {"torque": "torque_rms_Nm", "energy": "energy_J", "position": "position_rms_rad"}
LEAST = {"torque": 1e-6, "energy": 1e-6, "position": 1e-7}
# One file is worse than another beyond this logarithm of the ratio of their errors: less are the
# simulators' own steps.
WORTH = 0.005
# How sure a gain has to be to count.
LEVEL = 0.975
# What a loss that is to be expected counts against a gain that is sure, both as logarithms of
# errors' ratios.
WORSE = 5.0
# Stretches of a run whose work is compared [s].
STRETCH = 2.0
# Where no errors scatter, a standard deviation that is none.
LEAST_SCATTER = 1e-12
SAID = {
    "given": "the URDF as it is",
    "before": "the URDF's bodies with tuned losses",
    "tuned": "bodies and losses tuned without the effects",
    "after": "bodies, losses and effects together",
}


@dataclass(frozen=True, eq=False)
class Gap:
    """How far a model is from recordings, joint by joint.

    Squared errors of torque (with the share of its samples), energy, position and velocity, of each
    of k stretches or windows: their means are the squares of the errors in N m, J, rad and rad/s.
    """

    squares: Mapping[str, Float[Array, "k n"]]
    count: Float[Array, " n"]  # samples behind the torque

    def error(self, name: str) -> Float[Array, " n"]:
        """RMS of a measure over what was measured.

        Args:
            name: "torque", "energy", "position" or "velocity".

        Returns:
            One a joint, in the measure's unit; NaN where nothing was measured.
        """
        return np.sqrt(self.squares[name].mean(axis=0))

    @property
    def rms(self) -> float:
        """RMS of the torque over all joints' samples [N m]."""
        squares = self.count @ self.error("torque") ** 2
        return float(np.sqrt(squares / max(self.count.sum(), 1.0)))

    def over(self, others: Sequence[Gap], level: float = 0.5) -> Float[Array, "m n"]:
        """Logarithms of its errors over the least of others', by measure and joint.

        Args:
            others: Gaps of the same recordings, one at least; the best is taken anew for each
                joint.
            level: 0.5 for the estimates themselves. A higher one gives what the true logarithms
                don't exceed at that level, by Student's distribution of what stretches, pair by
                pair, leave open; a single stretch leaves open all.

        Returns:
            Rows in the order of `LEAST`, columns the joints; negative where its errors are smaller,
            zero where nothing was measured.
        """
        logarithms = []
        for name, least in LEAST.items():
            squares = self.squares[name] + least**2
            theirs = [other.squares[name] + least**2 for other in others]
            best = np.argmin([values.mean(axis=0) for values in theirs], axis=0)
            joints = np.arange(squares.shape[1])
            rival = np.array(theirs)[best, :, joints].T
            logarithms.append(np.nan_to_num(log_ratio(squares, rival, level)))
        return np.array(logarithms)

    def cost(self, others: Sequence[Gap]) -> Float[Array, " n"]:
        """What each joint's errors cost against the least of others'.

            Σ WORSE E[max(r, 0)] + min(r₀, 0),  r normal about its estimate

        over the measures: losses r to be expected less gains r₀ that are sure.
        """
        estimate = self.over(others)
        sure = self.over(others, LEVEL)
        scatter = np.maximum((sure - estimate) / norm.ppf(LEVEL), LEAST_SCATTER)
        normal = estimate / scatter
        loss = scatter * norm.pdf(normal) + estimate * norm.cdf(normal)
        return np.sum(WORSE * loss + np.minimum(sure, 0.0), axis=0)

    def to_dict(self, joints: Sequence[str]) -> dict[str, object]:
        """Its record.

        Returns:
            One key a measure with figures by the joints' names, and "windows": how many were
            replayed.
        """
        record: dict[str, object] = {}
        for name, key in (*MEASURES.items(), ("velocity", "velocity_rms_rad_s")):
            record[key] = dict(zip(joints, map(float, self.error(name)), strict=True))
        record["windows"] = int(np.isfinite(self.squares["position"][:, 0]).sum())
        return record


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
    counts = np.zeros(runs[0].n)
    squares = []
    works: list[Float[Array, " n"]] = []
    for motion in runs:
        left = log_error(model, motion)
        counts += motion.settled.sum(axis=0)
        step = motion.interval * motion.lowpass.factor
        starts = stretches(len(left), step)
        squares.append(np.add.reduceat(left**2, starts, axis=0))
        work = np.cumsum(left * motion.dq[motion.coarse] * step, axis=0)
        works += [stretch.var(axis=0) for stretch in np.split(work, starts[1:])]
    torque = np.concatenate(squares) * len(works) / np.maximum(counts, 1.0)
    position, velocity = _replay_squares(model, runs)
    measures = {
        "torque": torque,
        "energy": np.array(works),
        "position": position,
        "velocity": velocity,
    }
    return Gap(measures, counts)


def stretches(samples: int, step: float) -> Int[Array, " k"]:
    """First samples of the stretches into which a run is cut.

    Args:
        samples: How many it has.
        step: Time between them [s].
    """
    number = max(1, round(samples * step / STRETCH))
    return np.linspace(0, samples, number, endpoint=False).astype(int)


def _replay_squares(model: LoadedModel, runs: Sequence[Motion]) -> Float[Array, "2 w n"]:
    """Squared errors of position and velocity after replays, weighted by who moved.

    NaN where no window is long enough.
    """
    each = max(1, MOST_WINDOWS // len(runs))
    replays = [roll_run(model, motion, each) for motion in runs]
    moved = np.concatenate([replay.moved for replay in replays])
    squares = np.concatenate([replay.missed for replay in replays], axis=1) ** 2
    if not squares.size:
        return np.full((2, 1, runs[0].n), np.nan)
    return squares * moved * len(moved) / np.maximum(moved.sum(axis=0), 1)


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
    starts, length = _windows(motion, count, horizon)
    if not len(starts):
        nothing = np.zeros((2, 0, motion.n))
        return Replayed(nothing, np.zeros((0, motion.n), bool), starts)
    rows = starts[:, None] + np.arange(length + 1)
    run = (motion.q, motion.dq, motion.ddq, motion.interval)
    drive = model.undo_log(np.array(motion.tau), motion.interval)[rows]
    twists = model.deflections(*run)[starts, :2]
    missing = model.missing(*run)[rows]
    states = np.stack([motion.q, motion.dq])
    reached = model.roll_out(states[:, starts], twists, drive, -missing, motion.interval)
    ends = starts + length
    missed = reached - states[:, ends]
    speed = np.abs(motion.dq[rows])
    way = speed[:, 1:].sum(axis=1) * motion.interval
    missed[0] = np.clip(missed[0], -way, way)
    return Replayed(missed, (speed > motion.rest_speed).any(axis=1), ends)


def _windows(motion: Motion, count: int, horizon: float) -> tuple[Int[Array, " w"], int]:
    """First samples of evenly spread windows that fit a run, and how many samples one has."""
    samples = min(horizon / motion.interval, len(motion.time))  # a longer window fits no run
    length = max(2, round(samples))
    if len(motion.time) < 3 * length:
        return np.zeros(0, dtype=int), length
    last = len(motion.time) - 2 * length
    return np.unique(np.linspace(length, last, count).astype(int)), length


@dataclass(frozen=True, eq=False)
class Chosen:
    """The file to be written."""

    stated: IdentifiedArm  # what it holds
    bodies: str  # whose bodies it has, a name of the candidates
    joints: tuple[str, ...]  # whose losses and laws each joint has
    gaps: Mapping[str, Gap]  # its errors, and those of the candidates that are reported beside it
    # Joints at which another candidate is nearer in some measure, with that measure and the
    # largest ratio.
    worse: Mapping[str, tuple[str, float]]
    tried: int = 1  # candidates that were measured

    @property
    def name(self) -> str:
        """The candidate that it is, or `mixed`."""
        return self.bodies if set(self.joints) == {self.bodies} else "mixed"

    def to_dict(self, names: Sequence[str]) -> dict[str, object]:
        """Its record.

        Returns:
            "written" (the candidate's name), "bodies", "joints" (by their names), "worse" (ratios
            by name).
        """
        worse = {name: ratio for name, (_, ratio) in self.worse.items()}
        joints = zip(names, self.joints, strict=True)
        return {"written": self.name, "bodies": self.bodies, "joints": dict(joints), "worse": worse}

    def in_words(self, form: str, names: Sequence[str]) -> list[str]:
        """What a user should know of the choice.

        Args:
            form: The file's format.
            names: The joints' names.
        """
        file = FILE_OF[form]
        lines = []
        if self.name != "after":
            words = SAID[self.bodies]
            joints = zip(names, self.joints, strict=True)
            plain = [name for name, candidate in joints if candidate != "after"]
            if plain:
                words += f"; losses without effects at {', '.join(plain)}"
            lines.append(f"{file}: on these runs the best of its candidates has {words}")
        for name, (measure, ratio) in self.worse.items():
            share = f"{ratio:.2f} of another candidate's"
            lines.append(f"{file}: at {name} its error of {measure} is {share}")
        return lines


Mixture = tuple[str, tuple[str, ...]]
"""Whose bodies an arm has, and whose losses and laws each of its joints: names of candidates."""


class _Measurer:
    """Measures mixtures of candidates as files of a format, each once."""

    def __init__(
        self,
        form: str,
        options: Mapping[str, IdentifiedArm],
        runs: Sequence[Motion],
        folder: Path,
    ) -> None:
        self._form = form
        self._options = options
        self._runs = runs
        self._folder = folder
        self.gaps: dict[Mixture, Gap] = {}

    def measure(self, bodies: str, joints: tuple[str, ...]) -> Gap:
        """How far a mixture's file is from the recordings."""
        if (bodies, joints) not in self.gaps:
            mixed = mix(self._options, bodies, joints)
            file = WrittenFile.write(self._form, self._folder, mixed)
            model = file.load(self._runs[0].payload)
            self.gaps[bodies, joints] = measure_gap(model, self._runs)
        return self.gaps[bodies, joints]

    def measure_whole(self, name: str) -> Gap:
        """How far a candidate's own file is from the recordings."""
        return self.measure(name, (name,) * self._runs[0].n)


def choose(
    form: str, options: Mapping[str, IdentifiedArm], runs: Sequence[Motion], folder: Path
) -> Chosen:
    """The nearest candidate of a format on recordings that none was fitted to.

    Args:
        form: The format.
        options: The candidates by name; `after` is the one with all that was identified.
        runs: The recordings.
        folder: For scratch files.
    """
    measurer = _Measurer(form, options, runs, folder)
    whole = {name: measurer.measure_whole(name) for name in options}
    others = [gap for name, gap in whole.items() if name != "after"]
    for bodies in options:
        if bodies == "given" and "before" in options:
            continue  # its bodies are those of `before`
        # Of the same errors its own are taken: they stand first.
        order = [bodies, *(name for name in options if name != bodies)]
        costs = []
        for name in order:
            mixed = measurer.measure(bodies, (name,) * runs[0].n)
            costs.append(mixed.cost(others))
        nearest = np.array(costs).argmin(axis=0)
        measurer.measure(bodies, tuple(order[index] for index in nearest))
    best_whole = min(whole.values(), key=lambda gap: float(gap.cost(others).sum()))
    bodies, joints = min(
        measurer.gaps, key=lambda mixture: float(measurer.gaps[mixture].cost([best_whole]).sum())
    )
    gap = measurer.gaps[bodies, joints]
    worse = {}
    names = options["after"].nominal.joint_names
    for name, ratios in zip(names, gap.over(others).T, strict=True):
        if ratios.max() > WORTH:
            measure = list(MEASURES)[ratios.argmax()]
            worse[name] = (measure, float(np.exp(ratios.max())))
    return Chosen(
        stated=mix(options, bodies, joints),
        bodies=bodies,
        joints=joints,
        gaps=whole | {"after": gap},
        worse=worse,
        tried=len(measurer.gaps),
    )


def mix(options: Mapping[str, IdentifiedArm], bodies: str, joints: Sequence[str]) -> IdentifiedArm:
    """An arm of several candidates' parts.

    Args:
        options: The candidates by name.
        bodies: The one whose bodies are taken, with what a diagnosis changed of them.
        joints: For each joint the name of the candidate whose losses and laws it gets.
    """
    losses = {}
    for field in fields(Losses):
        columns = [getattr(options[name].losses, field.name) for name in joints]
        losses[field.name] = np.array([column[j] for j, column in enumerate(columns)])
    changes = [change for change in options[bodies].changes if change.of_the_bodies]
    for j, name in enumerate(joints):
        of_joint = [change for change in options[name].changes if change.joint == j]
        changes += [change for change in of_joint if not change.of_the_bodies]
    return replace(options[bodies], losses=Losses(**losses), changes=tuple(changes))
