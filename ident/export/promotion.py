"""The gate of promotion: whether a file moves as the arm does, better than the URDF alone.

The URDF alone is the URDF as a simulator loads it: its bodies, and the damping and dry friction of
its `<dynamics>`. Three errors of both on motion held out are held against each other, over all
joints: of the torque; of the positions after a horizon, to which the logged torque drives the model
from a measured state; and of the tool's place there. A file is promoted where one of the three is
surely smaller and none is surely larger, by what stretches and windows, pair by pair, leave open
(`log_ratio`). Where the file is the best of several on the same recordings, and as one of three
errors is enough, sureness is shared among them all (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.export.choose import LEVEL, MOST_WINDOWS, WINDOW, log_ratio, roll_run, stretches
from ident.export.identified import IdentifiedArm
from ident.export.loaded import LoadedModel, LoadedUrdf, log_error
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.units import TORQUE

Record = Mapping[str, Any]
# Errors by their names in a record, and the least that is one: [N m], [rad], [m].
LEAST = {"torque_rms_Nm": 1e-6, "replay_rms_rad": 1e-7, "tool_rms_m": 1e-7}
# In words: what it is of, its unit, and how many of these units the record's unit has.
SAID = {
    "torque_rms_Nm": ("torque", TORQUE, 1.0),
    "replay_rms_rad": ("replay", "mrad", 1e3),
    "tool_rms_m": ("tool", "mm", 1e3),
}
IN_SAMPLE = "the model was fitted on these recordings: they tell of no others (--in-sample)"
REMEDY = "nothing is written; record more motion, ask `ident diagnose` for the cause, or fit anew"


class LoadedHybrid(LoadedUrdf):
    """A fitted model, its laws and net included, on an arm in Pinocchio.

    In a replay, what laws and net add is that of the recorded motion.
    """

    form = "model"

    def __init__(self, model: HybridModel, motions: Sequence[Motion]) -> None:
        payload = motions[0].payload
        super().__init__(model.arm, IdentifiedArm.losses_of(model), payload)
        self._whole = lambda q, dq, ddq: model.torque(q, dq, ddq, payload)

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque of bodies, losses, laws and net as the model has it, shape (T, n) [N m]."""
        return np.asarray(self._whole(q, dq, ddq))

    def missing(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """What of that bodies and losses lack, shape (T, n) [N m]."""
        return self.joint_torque(q, dq, ddq, interval) - self.own_torque(q, dq, ddq, interval)


def tool_of(arm: ArmModel) -> str:
    """The link that stands for the tool: of all on the last joint the one farthest from it."""
    links = set(arm.forward_kinematics(arm.neutral))
    farthest = -1.0
    name = ""
    for frame in arm.model.frames:
        distance = float(np.linalg.norm(frame.placement.translation))
        if int(frame.parentJoint) == arm.n and frame.name in links and distance > farthest:
            farthest = distance
            name = str(frame.name)
    return name


@dataclass(frozen=True, eq=False)
class Distance:
    """Squared errors of one file on held-out motion, over all joints."""

    # Of each stretch the torque's [N² m²]; of each window the joints' [rad²], the tool's [m²].
    squares: Mapping[str, Float[Array, " k"]]

    def rms(self, name: str) -> float:
        """The error, NaN where no window is long enough."""
        values = self.squares[name]
        return float(np.sqrt(values.mean())) if len(values) else float("nan")


def measure_distance(
    model: LoadedModel,
    runs: Sequence[Motion],
    arm: ArmModel,
    horizon: float = WINDOW,
) -> Distance:
    """How far a loaded file is from recordings.

    Args:
        model: The file.
        runs: The recordings.
        arm: The nominal arm, whose lengths say where the tool is.
        horizon: Length of the replays [s].
    """
    each = max(1, MOST_WINDOWS // len(runs))
    tool = tool_of(arm)
    torques = []
    positions = []
    places = []
    for motion in runs:
        torques.append(_torque_by_stretch(model, motion))
        replay = roll_run(model, motion, each, horizon)
        moved = replay.moved.any(axis=1)
        if not moved.any():
            continue
        missed = replay.missed[0][moved]
        counted = np.where(replay.moved[moved], missed**2, 0.0)
        joints = np.maximum(replay.moved[moved].sum(axis=1), 1)
        positions.append(counted.sum(axis=1) / joints)
        measured = motion.q[replay.ends[moved]]
        reached = arm.link_poses(measured + missed, [tool])[tool][1]
        there = arm.link_poses(measured, [tool])[tool][1]
        places.append(np.sum((reached - there) ** 2, axis=1))
    squares = {}
    for name, values in zip(LEAST, (torques, positions, places), strict=True):
        squares[name] = np.concatenate([np.zeros(0), *values])
    return Distance(squares)


def _torque_by_stretch(model: LoadedModel, motion: Motion) -> Float[Array, " s"]:
    """Mean square of the torque's error over what slides of all joints, by stretches [N² m²]."""
    squares = log_error(model, motion) ** 2
    step = motion.interval * motion.lowpass.factor
    starts = stretches(len(squares), step)
    counts = np.add.reduceat(motion.settled, starts, axis=0, dtype=float).sum(axis=1)
    sums = np.add.reduceat(squares, starts, axis=0).sum(axis=1)
    return np.asarray(sums[counts > 0.0] / counts[counts > 0.0])


@dataclass(frozen=True, eq=False)
class Contest:
    """One file against the URDF alone."""

    form: str
    nominal: Distance
    written: Distance
    tried: int = 1  # candidates that the file was chosen from on the same recordings

    def ratio(self, name: str) -> tuple[float, float, float]:
        """The file's error over the nominal one's, and the bounds that are sure.

        1, 0 and ∞ where nothing is told.
        """
        squares = self.written.squares[name] + LEAST[name] ** 2
        rivals = self.nominal.squares[name] + LEAST[name] ** 2
        if not len(squares):
            return 1.0, 0.0, np.inf
        sure = 1.0 - (1.0 - LEVEL) / (self.tried * len(LEAST))
        logarithms = [float(log_ratio(squares, rivals, p)) for p in (0.5, 1.0 - LEVEL, sure)]
        with np.errstate(over="ignore"):
            middle, low, high = np.exp(logarithms)
        return float(middle), float(low), float(high)

    @property
    def gains(self) -> list[str]:
        """Errors that are surely smaller than the nominal one's."""
        return [name for name in LEAST if self.ratio(name)[2] < 1.0]

    @property
    def harms(self) -> list[str]:
        """Errors that are surely larger."""
        return [name for name in LEAST if self.ratio(name)[1] > 1.0]

    @property
    def beats(self) -> bool:
        """Whether the file is to stand in the URDF's place."""
        return bool(self.gains) and not self.harms

    def to_dict(self) -> dict[str, object]:
        """Its record; null stands for NaN and ∞, which JSON doesn't know.

        Returns:
            "candidates", "beats", and for each quantity of `LEAST` its errors "nominal" and
            "written", their "ratio", and its bounds "low" and "high".
        """
        record: dict[str, object] = {"candidates": self.tried, "beats": self.beats}
        for name in LEAST:
            ratio, low, high = self.ratio(name)
            record[name] = {
                "nominal": _finite(self.nominal.rms(name)),
                "written": _finite(self.written.rms(name)),
                "ratio": ratio,
                "low": low,
                "high": _finite(high),
            }
        return record


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class Promotion:
    """The verdict on all files of an arm."""

    contests: tuple[Contest, ...]
    horizon: float  # of the replays [s]
    tool: str  # the link whose place is compared
    in_sample: bool  # whether a recording is one that the model was fitted on
    accepted: bool = False  # whether that was accepted

    @property
    def passed(self) -> bool:
        """Whether every file beats the URDF alone, on motion that it was not made from."""
        held_out = self.accepted or not self.in_sample
        return held_out and all(contest.beats for contest in self.contests)

    def to_dict(self) -> dict[str, object]:
        """Its record.

        Returns:
            "passed", "in_sample", "horizon_s", "tool", "level", and "forms": by the format's name
            what `Contest.to_dict` gives.
        """
        return {
            "passed": self.passed,
            "in_sample": self.in_sample,
            "horizon_s": self.horizon,
            "tool": self.tool,
            "level": LEVEL,
            "forms": {contest.form: contest.to_dict() for contest in self.contests},
        }


def judge_model(
    model: HybridModel,
    runs: Sequence[Motion],
    in_sample: bool,
    accepted: bool,
    horizon: float = WINDOW,
) -> Promotion:
    """The verdict on a fitted model itself, laws and net included.

    Args:
        model: The model.
        runs: Recordings, of one payload or of several.
        in_sample: Whether the model was fitted on one of them.
        accepted: Whether that is accepted.
        horizon: Length of the replays [s].
    """
    contest = contest_of_model(model, runs, horizon)
    return Promotion((contest,), horizon, tool_of(model.nominal), in_sample, accepted)


def contest_of_model(
    model: HybridModel,
    runs: Sequence[Motion],
    horizon: float = WINDOW,
) -> Contest:
    """A fitted model against the URDF alone, both in Pinocchio."""
    arm = model.nominal
    stated = IdentifiedArm.as_urdf(arm).losses
    nominal = []
    fitted = []
    for motions in _by_payload([motion.select(model.joint_names) for motion in runs]):
        urdf = LoadedUrdf(arm, stated, motions[0].payload)
        hybrid = LoadedHybrid(model, motions)
        nominal.append(measure_distance(urdf, motions, arm, horizon))
        fitted.append(measure_distance(hybrid, motions, arm, horizon))
    return Contest(LoadedHybrid.form, _joined(nominal), _joined(fitted))


def _by_payload(runs: Sequence[Motion]) -> list[list[Motion]]:
    """Runs that carry the same."""
    groups: dict[tuple[float, ...], list[Motion]] = {}
    for motion in runs:
        payload = motion.payload
        key = () if payload is None else (payload.mass_kg, *map(float, payload.com_m))
        groups.setdefault(key, []).append(motion)
    return list(groups.values())


def _joined(distances: Sequence[Distance]) -> Distance:
    squares = {}
    for name in LEAST:
        squares[name] = np.concatenate([distance.squares[name] for distance in distances])
    return Distance(squares)


def in_words(promotion: Record) -> list[str]:
    """The verdict of a record, a line a file."""
    lines = []
    for form, contest in promotion["forms"].items():
        parts = []
        for name, (what, unit, factor) in SAID.items():
            row = contest[name]
            if row["nominal"] is None:
                parts.append(f"{what} not told: the runs are shorter than three horizons")
                continue
            numbers = f"{factor * row['nominal']:.3g} -> {factor * row['written']:.3g} {unit}"
            parts.append(f"{what} {numbers} ({_sure(row)})")
        verdict = "beats the URDF alone" if contest["beats"] else "does NOT beat the URDF alone"
        lines.append(f"{form}: {', '.join(parts)}: {verdict}")
    if promotion["in_sample"]:
        lines.append(IN_SAMPLE)
    replays = f"after {promotion['horizon_s']:g} s of logged torque alone"
    lines.append(f"replay and tool ({promotion['tool']}) are {replays}")
    return lines


def _sure(row: Record) -> str:
    """What is sure of a ratio."""
    if row["high"] is not None and row["high"] < 1.0:
        return f"surely at most {row['high']:.2f} times"
    if row["low"] > 1.0:
        return f"surely {row['low']:.2f} times or more"
    return "not sure"
