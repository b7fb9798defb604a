"""What goal and position tell of a servo, joint by joint.

    J q'' + D q' + F s + g(q) = K (u(t − d) − q),   divided by K:
    u(t − d) − q = (J/K) q'' + (D/K) q' + (F/K) s + o + g(q)/K

Inertia over gain, lag, half the dead band, offset of the zero, and droop under load stand linear in
what is measured; the delay is searched on a grid. As everywhere, a parameter is reported only if
leaving it out costs on stretches that the fit never saw, more than chance would among all
parameters and joints. All but the zero's offset are positive in every fit: beside an inertia or a
droop below zero a later delay and a wider dead band fit as well.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import nnls
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int, least_squares
from ident.recordings.recording import TelemetryIssue
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.servos.goal_runs import GoalRun
from ident.servos.settings import SERVO as LIMIT

if TYPE_CHECKING:
    from ident.servos.rolled_out import RolledOut
    from ident.servos.told_runs import ToldRun

# What is reported, by figure: its unit, its words, and the reason where it is not.
TEXT = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
FIGURES: dict[str, dict[str, Any]] = TEXT["figures"]
COLUMNS = ("inertia_s2", "lag_s", "dead_band_rad", "zero_rad", "droop_rad_Nm")
SCHEMA = "ident.servo/1"
ZERO = COLUMNS.index("zero_rad")  # the only column whose coefficient may have either sign
LEAST = 1e-10  # share of the largest singular value below which one is rounding
# Figures that say how late a joint is after its goals.
LATE = {"delay_s", "total_lag_s"}


Figures = dict[str, tuple[float, float, float]]
"""Figures of a joint by name: the value, and both ends of its 95 % interval."""
Rows = tuple[Float[Array, " R"], Float[Array, "R k"], Int[Array, " R"]]
"""Rows of one joint at one delay: error, what each of `COLUMNS` multiplies, piece of each row."""


@dataclass(frozen=True, eq=False)
class ServoJoint:
    """What is reported of one joint."""

    joint: str  # its name
    figures: Figures  # what is reported
    untold: dict[str, str]  # figures that are not, with the reason and what would help
    # Following error on stretches left out: as it is, and less what the figures say [rad].
    rms_before: float
    rms_after: float


def fit_servos(runs: Sequence[GoalRun], arm: ArmModel | None) -> tuple[ServoJoint, ...]:
    """All joints."""
    joints = runs[0].motion.joints
    tests = len(joints) * (len(COLUMNS) + 1)
    gravity = [
        None if arm is None else run.motion.filtered(arm.gravity(run.motion.q)) for run in runs
    ]
    return tuple(_fit_joint(runs, gravity, j, name, tests) for j, name in enumerate(joints))


def _fit_joint(
    runs: Sequence[GoalRun], gravity: Sequence[Array | None], j: int, joint: str, tests: int
) -> ServoJoint:
    travels = [float(np.ptp(run.motion.q[:, j])) for run in runs]
    travel = max(travels)
    if travel < LIMIT.least_travel:
        return _silent(joint, f"it moves by {travel:.3f} rad only: move it farther")
    delays = np.arange(0.0, LIMIT.longest_delay, LIMIT.delay_step)
    table = [_rows(runs, gravity, j, float(delay)) for delay in delays]
    pieces = len(np.unique(table[0][2]))
    if pieces < LIMIT.least_pieces:
        what = f"{pieces} stretches of {LIMIT.piece_s:g} s in which it moves clear of reversals"
        return _silent(joint, f"{what}: record {LIMIT.least_pieces} or more")
    losses = np.stack([_held_out(rows) for rows in table])
    best = int(np.argmin(losses.sum(axis=1)))
    reach = float(stdtrit(pieces - 1, 1.0 - 0.5 * LIMIT.false / tests))
    # Held at zero, a fit may err by whole pieces, which leaves nothing sure; free, it may follow
    # anything. A delay is open where neither tells that it is worse.
    free = np.stack([_held_out(rows, either_sign=True) for rows in table])
    is_near = [
        no_worse(loss, losses[best]) and no_worse(other, free[best])
        for loss, other in zip(losses, free, strict=True)
    ]
    near = _reached_from(best, np.array(is_near))
    low = float(delays[near].min())
    high = float(delays[near].max())
    sure = not no_worse(losses[0], losses[best], reach)
    rows = table[best if sure else 0]
    # The grid's neighbours too: the truth lies between its points.
    open_ = np.flatnonzero(np.convolve(near, np.ones(3), mode="same") > 0.0)
    figures, untold = _linear(rows, [table[k] for k in open_], reach)
    if sure:
        value = float(delays[best])
        # the lowest point of the parabola through the best delay and its neighbours
        if 0 < best < len(delays) - 1:
            before, lowest, after = losses.sum(axis=1)[best - 1 : best + 2]
            bend = before - 2.0 * lowest + after
            if bend > 0.0:
                value += float(0.5 * LIMIT.delay_step * (before - after) / bend)
        figures["delay_s"] = value, max(low - LIMIT.delay_step, 0.0), high + LIMIT.delay_step
    else:
        untold["delay_s"] = (
            "a later goal and a slower joint are the same here: move it faster, with sudden starts"
        )
    figures |= _total_lag(table, near, best)
    droop, least, most = figures.get("droop_rad_Nm", (0.0, 0.0, 0.0))
    if least > 0.0:  # it tells the stiffness
        figures["gain_Nm_rad"] = 1.0 / droop, 1.0 / most, 1.0 / least
    after = np.sqrt(losses[best if sure else 0].sum() / len(rows[0]))
    before = np.sqrt(np.mean(table[0][0] ** 2))
    return ServoJoint(joint, figures, untold, float(before), float(after))


def _reached_from(best: int, is_near: Bool[Array, " D"]) -> Bool[Array, " D"]:
    """The delays about the best one that are not surely worse.

    Behind one that is, errors are larger still and differ more from piece to piece: nothing is sure
    of them.
    """
    far = np.flatnonzero(~is_near)
    first = int(far[far < best].max(initial=-1)) + 1
    last = int(far[far > best].min(initial=len(is_near)))
    places = np.arange(len(is_near))
    return (first <= places) & (places < last)


def _silent(joint: str, reason: str) -> ServoJoint:
    return ServoJoint(
        joint, {}, dict.fromkeys((*COLUMNS, "delay_s"), reason), float("nan"), float("nan")
    )


def _rows(runs: Sequence[GoalRun], gravity: Sequence[Array | None], j: int, delay: float) -> Rows:
    """Everything goes through the run's filter, the error as the columns."""
    errors = []
    tables = []
    pieces = []
    first = 0
    for run, load in zip(runs, gravity, strict=True):
        motion = run.motion
        rows: Bool[Array, " t"] = motion.settled[:, j]
        ddq = motion.ddq[:, j]
        dq = motion.dq[:, j]
        motions = motion.filtered(np.column_stack([ddq, dq, np.sign(dq)]))
        columns = [motions, np.ones((len(motions), 1))]
        if load is not None:
            columns.append(load[:, j : j + 1])
        goal = motion.filtered(run.goal_at(j, delay))
        errors.append((goal - motion.tau_filtered[:, j])[rows])
        tables.append(np.concatenate(columns, axis=1)[rows])
        since = motion.time[motion.coarse] - motion.time[0]
        number = (since // LIMIT.piece_s).astype(int)
        pieces.append(first + number[rows])
        first += int(number[-1]) + 1
    return np.concatenate(errors), np.concatenate(tables), np.concatenate(pieces)


def _held_out(
    rows: Rows, without: int | None = None, either_sign: bool = False
) -> Float[Array, " P"]:
    """Squared error of each piece by a fit without its fold of pieces.

    Args:
        rows: Error, columns and piece of each row.
        without: Index of a column that the fit lacks; None for none.
        either_sign: Whether all coefficients may be below zero.
    """
    error, columns, piece = rows
    used = [k for k in range(columns.shape[1]) if k != without]
    limited = np.array([k != ZERO for k in used])
    x = columns[:, used]
    scale = np.linalg.norm(x, axis=0)
    x = x / np.where(scale > 0.0, scale, 1.0)
    names, index = np.unique(piece, return_inverse=True)
    fold = (np.arange(len(names)) * LIMIT.parts // len(names))[index]
    left = np.empty_like(error)
    whole = x.T @ x
    target = x.T @ error
    for k in range(LIMIT.parts):
        out = fold == k
        unseen = x[out]
        normal = whole - unseen.T @ unseen
        right = target - unseen.T @ error[out]
        beta = least_squares(normal, right, LEAST)
        if not either_sign and (beta[limited] < 0.0).any():
            beta = _not_negative(normal, right, limited)
        left[out] = error[out] - unseen @ beta
    return np.bincount(index, left**2, minlength=len(names))


def _not_negative(
    normal: Float[Array, "k k"], right: Float[Array, " k"], limited: Bool[Array, " k"]
) -> Float[Array, " k"]:
    """Least squares by normal equations under coefficients that are not below zero.

    Args:
        normal, right: The equations, of columns of unit length.
        limited: Of which columns; others may have either sign.
    """
    root = np.linalg.cholesky(normal + LEAST * np.trace(normal) * np.eye(len(normal))).T
    free = np.flatnonzero(~limited)
    signed = np.concatenate([root, -root[:, free]], axis=1)
    both, _ = nnls(signed, np.linalg.solve(root.T, right))
    beta = both[: len(normal)].copy()
    beta[free] -= both[len(normal) :]
    return beta


def no_worse(
    tried: Float[Array, " P"], best: Float[Array, " P"], reach: float | None = None
) -> bool:
    """Whether an error on pieces is not surely larger than another, piece against piece.

    Args:
        tried: Error on each piece.
        best: The other's, on the same pieces.
        reach: Standard errors that are allowed; None for those of the usual level.
    """
    apart = tried - best
    count = len(apart)
    if reach is None:
        reach = float(stdtrit(count - 1, 0.5 + 0.5 * LIMIT.level))
    squares = np.sum((apart - apart.mean()) ** 2)
    error = np.sqrt(count * squares / (count - 1))
    return bool(apart.sum() <= reach * error)


def _linear(rows: Rows, near: Sequence[Rows], reach: float) -> tuple[Figures, dict[str, str]]:
    """Figures that are linear in the columns, and those that are not reported.

    An interval spans those at all delays that are not surely worse: what the delay leaves open, the
    figures leave open.
    """
    beta, std, count = _solve(rows)
    whole = _held_out(rows)
    usual = float(stdtrit(count - 1, 0.5 + 0.5 * LIMIT.level))
    others = [_solve(at_delay)[:2] for at_delay in near]
    lows = [b - usual * s for b, s in others]
    low = np.min([beta - usual * std, *lows], axis=0)
    highs = [b + usual * s for b, s in others]
    high = np.max([beta + usual * std, *highs], axis=0)
    figures: Figures = {}
    untold: dict[str, str] = {}
    for k, name in enumerate(COLUMNS[: len(beta)]):
        needed = not no_worse(_held_out(rows, k), whole, reach)
        positive = name == "zero_rad" or beta[k] > 0.0
        if needed and positive and abs(beta[k]) > reach * std[k] and low[k] * high[k] > 0.0:
            figures[name] = (
                float(beta[k]),
                float(low[k]),
                float(high[k]),
            )
        else:
            untold[name] = FIGURES[name]["reason"]
    if len(beta) < len(COLUMNS):
        untold["droop_rad_Nm"] = "nobody knows what the joint carries: give --robot"
    elif float(np.std(rows[1][:, -1])) < LIMIT.least_gravity:
        figures.pop("droop_rad_Nm", None)
        untold["droop_rad_Nm"] = (
            "gravity hardly changes at this joint: move the arm so that it carries more and less"
        )
    return figures, untold


def _solve(rows: Rows) -> tuple[Float[Array, " k"], Float[Array, " k"], int]:
    """Least squares, standard deviations by how the pieces differ, and their number.

    A coefficient that would be below zero is zero, without a deviation.

    Source: Liang and Zeger 1986, the sandwich over clusters.
    """
    error, columns, piece = rows
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    x = columns / scale
    normal = x.T @ x
    right = x.T @ error
    bread = np.linalg.pinv(normal, rcond=LEAST, hermitian=True)
    beta = bread @ right
    limited = np.arange(x.shape[1]) != ZERO
    if (beta[limited] < 0.0).any():
        beta = _not_negative(normal, right, limited)
        x = np.where(limited & (beta <= 0.0), 0.0, x)
        bread = np.linalg.pinv(x.T @ x, rcond=LEAST, hermitian=True)
    left = error - x @ beta
    names, index = np.unique(piece, return_inverse=True)
    scores = np.zeros((len(names), x.shape[1]))
    np.add.at(scores, index, x * left[:, None])
    count = len(names)
    meat = scores.T @ scores
    covariance = bread @ meat @ bread * count / max(1, count - x.shape[1])
    return beta / scale, np.sqrt(np.diag(covariance)) / scale, len(names)


def _total_lag(table: Sequence[Rows], near: Bool[Array, " D"], best: int) -> Figures:
    """Delay and lag together [s]: what slow motion sees, hardly by how the two share it."""
    totals = {}
    for k in {best, *map(int, np.flatnonzero(near))}:
        beta, std, count = _solve(table[k])
        reach = float(stdtrit(count - 1, 0.5 + 0.5 * LIMIT.level))
        middle = float(beta[1]) + k * LIMIT.delay_step
        half = reach * float(std[1])
        totals[k] = (middle, middle - half, middle + half)
    low = min(total[1] for total in totals.values())
    high = max(total[2] for total in totals.values())
    return {"total_lag_s": (totals[best][0], low, high)} if low > 0.0 else {}


@dataclass(frozen=True, eq=False)
class ServoArm(Result):
    """All joints of a position-only arm."""

    robot: str  # its name, or of the session where nobody knows it
    joints: tuple[ServoJoint, ...]  # what is reported of each
    rolled: tuple[RolledOut, ...] = ()  # models that roll out, where they were asked for
    telemetry: tuple[TelemetryIssue, ...] = ()  # what was seen of the log's clock
    # Goals, positions and what the figures say of them, for a page.
    curves: tuple[ToldRun, ...] = ()
    hold_s: float = 0.0  # how long a goal is held in the log

    def to_dict(self) -> dict[str, Any]:
        joints = {}
        for joint in self.joints:
            reported = {
                name: {"value": value, "low": low, "high": high}
                for name, (value, low, high) in joint.figures.items()
            }
            errors = {"rms_before_rad": joint.rms_before, "rms_after_rad": joint.rms_after}
            joints[joint.joint] = {
                "figures": {
                    name: {**figure, "unit": FIGURES[name]["unit"]}
                    for name, figure in reported.items()
                },
                "class": {
                    name: FIGURES[name]["class"] for name in reported if "class" in FIGURES[name]
                },
                "not_told": dict(joint.untold),
                "heldout": None if np.isnan(joint.rms_before) else errors,
            }
        for model in self.rolled:
            joints[model.joint]["roll_out"] = model.to_dict()
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "telemetry": [issue.to_dict() for issue in self.telemetry],
            "joints": joints,
            "provenance": self.provenance.to_dict(),
        }
