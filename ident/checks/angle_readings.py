"""One joint's angle by another convention: a motor's turns for the joint's, or counted from the
link before the last one.

A wrong factor scales the angle with its velocity: nothing in the channel shows it. The other joints
do, for they lift and swing what hangs behind. Each run is foretold by a model of all others, once as
the angle stands and once as each reading has it. Evidence is the sum over runs and over the other
joints of the logarithm by which errors shrink; it must exceed the logarithm of the number of
readings over the chance of a false alarm. The joint's own torque is left out: its friction and its
transmission may follow any multiple of its angle. And no other fault of the log may gain as much:
a joint's zero, a run that is otherwise, or a convention of the whole log.

Source: Bonferroni's bound on likelihood ratios of many alternatives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.checks.between_runs import find_difference
from ident.checks.conventions.reread import PLACES, RATES, read_conventions
from ident.checks.effort_kind import mend_effort_kind
from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.filtered_run import EffortSettings
from ident.checks.foretold import RunStates, RunTables, mean_error, states_of
from ident.checks.lateness import FEWEST_STATES
from ident.checks.parting import followed
from ident.checks.report import issue_of
from ident.checks.run_changes import RunChange, zero_changes
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel

FACTORS = (0.5, 2.0)  # from which a factor is followed


@dataclass(frozen=True)
class AngleReading:
    """How one joint's angle is to be read: factor · angle + share · the angle of the joint before."""

    joint: int  # its column
    factor: float = 1.0
    share: float = 0.0

    def of(self, values: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Angles, or their derivatives, of all joints."""
        read = np.array(values)
        read[:, self.joint] *= self.factor
        if self.share:
            read[:, self.joint] += self.share * read[:, self.joint - 1]
        return read

    def of_states(self, run: RunStates) -> RunStates:
        """A run's states."""
        return replace(run, q=self.of(run.q), dq=self.of(run.dq), ddq=self.of(run.ddq))

    def of_recording(self, run: Recording) -> Recording:
        """A run's channels."""
        channels = run.channels()
        names = [name for name in (*PLACES, *RATES) if name in channels]
        return run.replace(**{name: self.of(channels[name]) for name in names})


def readings(arm: ArmModel) -> Iterator[AngleReading]:
    """All that are tried: factors of joints that turn, and sums with the joint before, or differences."""
    for joint in range(arm.n):
        if arm.sliding_joints[joint]:
            continue
        for factor in FACTORS:
            yield AngleReading(joint, factor=factor)
        if joint and not arm.sliding_joints[joint - 1]:
            for share in (-1.0, 1.0):
                yield AngleReading(joint, share=share)


def pieces_of(session: Session) -> list[RunStates]:
    """The runs by their states, evenly chosen where there are many, halved where there are few."""
    states = [states_of(run) for run in session.runs]
    runs = [run for run in states if run is not None and len(run.q) >= FEWEST_STATES]
    runs = runs[:: max(1, len(runs) // LIMIT.most_pieces)]
    while runs and len(runs) < LIMIT.pieces:
        longest = max(range(len(runs)), key=lambda number: len(runs[number].q))
        if len(runs[longest].q) < 2 * FEWEST_STATES:
            return []
        runs[longest : longest + 1] = runs[longest].halves()
    return runs


class AngleComparison:
    """The pieces of a session, and what each reading of an angle says of them."""

    def __init__(self, runs: Sequence[RunStates], arm: ArmModel) -> None:
        self.runs = list(runs)
        self.arm = arm
        self.tables = RunTables(arm, runs)
        self.errors = self.errors_of(self.runs)

    def errors_of(self, runs: Sequence[RunStates]) -> Float[Array, "R n"]:
        """Logarithms of the errors of runs, each foretold by all the others."""
        return self.tables.errors_among(np.array([self.tables.sums(run) for run in runs]))

    def fall(self, reading: AngleReading) -> Float[Array, "R n"]:
        """By how much each error shrinks [nats]."""
        return self.errors - self.errors_of([reading.of_states(run) for run in self.runs])

    def gain_elsewhere(self, reading: AngleReading) -> float:
        """By how much the errors of all other joints shrink together [nats]."""
        return float(np.nansum(np.delete(self.fall(reading), reading.joint, axis=1)))

    def find(self) -> AngleReading | None:
        """The likeliest reading; None where the angles are best read as they stand."""
        tried = list(readings(self.arm))
        if not tried:
            return None
        best = max(tried, key=self.gain_elsewhere)
        if self.gain_elsewhere(best) < np.log(len(tried) / LIMIT.chance):
            return None
        return best if best.share else self.follow(best)

    def follow(self, reading: AngleReading) -> AngleReading:
        """A factor followed to where it gains most, by halving steps of its logarithm."""
        best = self.gain_elsewhere(reading)
        step = 0.5 * np.log(2.0)
        for _ in range(LIMIT.halvings):
            for change in (np.exp(-step), np.exp(step)):
                tried = replace(reading, factor=float(reading.factor * change))
                gain = self.gain_elsewhere(tried)
                if gain > best:
                    reading = tried
                    best = gain
            step *= 0.5
        return reading

    def gain_of_zeros(self) -> float:
        """The most that a joint's zero gains, moved in all runs [nats]."""

        def cost(change: RunChange) -> float:
            errors = self.errors_of([change.undo(run) for run in self.runs])
            return float(np.nansum(errors - self.errors))

        costs = [0.0]
        for joint in range(self.arm.n):
            tried = list(zero_changes(self.arm, joint))
            if tried:
                costs.append(cost(followed(min(tried, key=cost), cost)))
        return -min(costs)

    def gain_of_conventions(self, session: Session, settings: EffortSettings) -> float:
        """What the likeliest conventions of the whole log gain, gravity included [nats]."""
        reading = read_conventions(session, self.arm, settings)
        whole, issues = mend_effort_kind(reading.session, reading.judged, reading.is_compensated)
        if not reading.issues and not issues:
            return 0.0
        runs = pieces_of(whole)
        if not runs:
            return 0.0
        tables = RunTables(reading.judged, runs)
        errors = tables.errors_among(np.array([tables.sums(run) for run in runs]))
        return float(np.nansum(self.errors) - np.nansum(errors))


def check_angle_readings(
    session: Session, arm: ArmModel, settings: EffortSettings
) -> tuple[Session, list[TelemetryIssue]]:
    """Finds an angle by another convention; later checks see it as it is likeliest read."""
    runs = pieces_of(session)
    if not runs or session.effort_kind == "gravity_compensated":
        return session, []
    comparison = AngleComparison(runs, arm)
    reading = comparison.find()
    if reading is None:
        return session, []
    fall = comparison.fall(reading)
    gain = float(np.nansum(fall))
    if comparison.gain_of_zeros() >= gain:
        return session, []
    difference = find_difference(session, arm)
    if difference is not None and difference.gain >= gain:
        return session, []
    if comparison.gain_of_conventions(session, settings) >= gain:
        return session, []
    read = session.replace(runs=[reading.of_recording(run) for run in session.runs])
    return read, [tell(reading, comparison.errors, fall, session)]


def tell(
    reading: AngleReading,
    errors: Float[Array, "R n"],
    fall: Float[Array, "R n"],
    session: Session,
) -> TelemetryIssue:
    """The issue of a reading, with the joint whose errors shrink most.

    Args:
        reading: How the angle is to be read.
        errors: Logarithms of the errors as it stands, by run and joint.
        fall: By how much each shrinks [nats].
        session: The recordings.
    """
    joint = reading.joint
    shrinks = mean_error(fall)
    worst = int(np.nanargmax(shrinks))
    before = mean_error(errors)[worst]
    seen: dict[str, Any] = {
        "at": session.joints[worst],
        "before": float(np.exp(before)),
        "after": float(np.exp(before - shrinks[worst])),
    }
    if reading.share:
        seen["last"] = session.joints[joint - 1]
        seen["how"] = "minus" if reading.share < 0.0 else "plus"
        return issue_of("angle_coupled", session, [joint], joint, **seen)
    seen["factor"] = reading.factor
    seen["reported"] = 1.0 / reading.factor
    return issue_of("angle_scale", session, [joint], joint, **seen)
