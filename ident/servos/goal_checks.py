"""Whether a log of goals and positions is fit for use: its clock, units, and whose goals they are.

A position follows its goal late and not wholly, but it follows that of its own joint, in the same
unit and direction. Each position is held against every goal, in the unit and direction nearest to
how it follows it; where another reading leaves surely less, the log is refused with that reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float
from ident.checks.angles import mend_angle_units
from ident.checks.clock import mend_clock_jumps, mend_order, split_at_gaps
from ident.checks.sampling import mend_jitter
from ident.checks.time_base import check_stated_rate, mend_time_base, mend_time_unit
from ident.errors import RecordingError
from ident.recordings.recording import Session, TelemetryIssue
from ident.servos.goal_runs import GoalRun
from ident.servos.servo_fit import no_worse
from ident.servos.settings import SERVO as LIMIT

STEPS = (
    mend_order,
    mend_clock_jumps,
    mend_time_unit,
    check_stated_rate,
    mend_time_base,
    mend_jitter,
    lambda session: mend_angle_units(session, None),
    split_at_gaps,
)
COUNTS = 4096.0 / (2.0 * math.pi)
# What a goal may be multiplied by to be in the position's unit and direction, and what that means.
READINGS = {
    1.0: "",
    -1.0: "turned round",
    math.radians(1.0): "read as degrees, the position as radians",
    math.degrees(1.0): "read as radians, the position as degrees",
    1.0 / COUNTS: "read as counts of a turn in 4096, the position as radians",
    COUNTS: "read as radians, the position as counts of a turn in 4096",
}
# Delays of goals that are tried [s].
DELAYS = np.linspace(0.0, LIMIT.longest_delay, 6)
TWO_TURNS = 4.0 * math.pi
COUNTS_REMEDY = (
    "write `counts_per_turn = 4096` (as many as the servo has) at the top of session.toml, or "
    '`angle_unit = "deg"` where it logs degrees'
)
SAME_UNIT = "log goal and position in one unit and direction, and each goal under its own joint"


def check_log(session: Session) -> tuple[Session, tuple[TelemetryIssue, ...]]:
    """A session of goals and positions with its clock mended, and what was seen.

    Raises:
        RecordingError: Its clock or its unit is wrong.
    """
    where = str(session.path or session.name)
    issues: list[TelemetryIssue] = []
    # Checks of the clock look at efforts, too: the position stands there.
    session = session.replace(runs=tuple(run.replace(effort=run.position) for run in session.runs))
    for step in STEPS:
        session, told = step(session)
        issues += told
        fatal = next((issue for issue in told if issue.severity == "fatal"), None)
        if fatal is not None:
            remedy = COUNTS_REMEDY if _in_counts(fatal, session) else fatal.remedy
            raise RecordingError(where, fatal.evidence.removeprefix(f"{session.name}: "), remedy)
    return session, tuple(issues)


def _in_counts(issue: TelemetryIssue, session: Session) -> bool:
    """Whether angles that are no radians go too far for degrees of joints within two turns."""
    farthest = max(float(np.abs(run.position).max()) for run in session.runs)
    # The session of an issue has been read as degrees already.
    return issue.issue == "units_degrees" and farthest > TWO_TURNS


@dataclass(frozen=True)
class Reading:
    """A position as it follows a goal."""

    goal: int  # number of the joint whose goal it is
    factor: float  # what the goal is multiplied by, one of `READINGS`, or 0 for none
    losses: Float[Array, " P"]  # squared error of each piece


def require_own_goals(runs: Sequence[GoalRun], where: str) -> None:
    """Passes if no position surely follows another goal, or its own in another unit or direction.

    Args:
        runs: Runs of a position-only arm.
        where: The recordings, for the message.

    Raises:
        RecordingError: One does.
    """
    joints = runs[0].motion.joints
    tests = len(joints) ** 2 * len(READINGS)
    for j, joint in enumerate(joints):
        if _travel([run.motion.q[:, j] for run in runs]) < LIMIT.least_travel:
            continue
        stated = _read(runs, j, j, 1.0)
        pieces = len(stated.losses)
        if pieces < LIMIT.least_pieces:
            continue
        reach = float(stdtrit(pieces - 1, 1.0 - 0.5 * LIMIT.false / tests))
        best = min(
            _other_readings(runs, j),
            key=lambda reading: float(reading.losses.sum()),
            default=stated,
        )
        # A soft servo hardly follows any goal: next to nothing beats its own, but not nothing.
        nothing = _read(runs, j, j, 0.0)
        if no_worse(stated.losses, best.losses, reach) or no_worse(
            nothing.losses, best.losses, reach
        ):
            continue
        words = READINGS[best.factor]
        goal = "its own goal" if best.goal == j else f"the goal of {joints[best.goal]}"
        read = f", {words}," if words else ""
        better = math.sqrt(stated.losses.sum() / max(best.losses.sum(), 1e-300))
        what = f"the position of {joint} follows {goal}{read} {better:.0f} times better than its "
        what += "goal as it stands"
        raise RecordingError(where, what, SAME_UNIT)


def _other_readings(runs: Sequence[GoalRun], j: int) -> Iterator[Reading]:
    """The goals of all joints that move, each in the unit and direction that is nearest."""
    for k in range(len(runs[0].motion.joints)):
        if _travel([run.goal[:, k] for run in runs]) <= 0.0:
            continue
        factor = _nearest_reading(_slope(runs, j, k))
        if k != j or factor != 1.0:
            yield _read(runs, j, k, factor)


def _slope(runs: Sequence[GoalRun], j: int, k: int) -> float:
    """How far a position goes for each radian of a goal, at the delay at which that is most."""
    best = 0.0
    for delay in DELAYS:
        along = 0.0
        square = 0.0
        for run in runs:
            goal = run.motion.filtered(run.goal_at(k, float(delay)))
            goal = goal - goal.mean()
            along += float(goal @ run.motion.tau_filtered[:, j])
            square += float(goal @ goal)
        best = max(best, along / max(square, 1e-300), key=abs)
    return best


def _nearest_reading(slope: float) -> float:
    """The unit and direction in which a goal is followed so far, as nearly as may be."""
    alike = [factor for factor in READINGS if factor * slope > 0.0]
    return min(alike, key=lambda factor: abs(math.log(slope / factor)), default=1.0)


def _travel(values: Sequence[Float[Array, " T"]]) -> float:
    """How far something goes in the run in which it goes farthest."""
    return max(float(np.ptp(row)) for row in values)


def _read(runs: Sequence[GoalRun], j: int, k: int, factor: float) -> Reading:
    """A position by a goal times a factor, with an offset in each run, at the best delay."""
    best = None
    for delay in DELAYS:
        losses = []
        for run in runs:
            motion = run.motion
            error = motion.tau_filtered[:, j] - factor * motion.filtered(
                run.goal_at(k, float(delay))
            )
            piece = ((motion.time[motion.coarse] - motion.time[0]) // LIMIT.piece_s).astype(int)
            losses.append(np.bincount(piece, (error - error.mean()) ** 2))
        reading = Reading(k, factor, np.concatenate(losses))
        if best is None or reading.losses.sum() < best.losses.sum():
            best = reading
    assert best is not None
    return best
