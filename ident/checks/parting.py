"""One parting of a session's runs, the odd ones against the rest: what the odd ones have otherwise.

What is gained is the sum over runs and joints of the logarithm by which errors shrink
(`between_runs`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.foretold import Fit, RunStates, RunTables, fit, fits_among, mean_error, states_of
from ident.checks.run_changes import (
    OF_TORQUES,
    OTHER_ARM,
    RunChange,
    discrete_changes,
    scale_changes,
    zero_changes,
)
from ident.checks.settings import BETWEEN_RUNS as LIMIT
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

FIRST_STEP = np.pi / 12.0  # of a zero that is followed [rad]


@dataclass(frozen=True, eq=False)
class RunDifference:
    """What some runs have otherwise than the rest."""

    odd: tuple[str, ...]  # their names
    change: RunChange
    gain: float  # by how much all errors shrink together [nats]
    before: Float[Array, " n"]  # their root mean square errors, foretold by the rest [N m]
    # And with the change undone; as they are among themselves where the arm is another.
    after: Float[Array, " n"]
    usual: Float[Array, " n"]  # that of the rest among themselves


class ComparedRuns:
    """The runs of a session that are long enough, each foretold by all the others."""

    def __init__(self, session: Session, arm: ArmModel) -> None:
        self.arm = arm
        self.runs = [states for states in map(states_of, session.runs) if states is not None]

    @cached_property
    def tables(self) -> RunTables:
        """Makes the inner products (`RunTables`) of these runs with their arm."""
        return RunTables(self.arm, self.runs)

    @cached_property
    def sums(self) -> Float[Array, "R n c c"]:
        """Inner products of each run's columns and torque, by joint."""
        return np.array([self.tables.sums(run) for run in self.runs])

    @cached_property
    def errors(self) -> Float[Array, "R n"]:
        """Logarithm of each run's root mean square error by joint, foretold by all the others."""
        return self.tables.errors_among(self.sums)

    @cached_property
    def errors_beside_losses(self) -> Float[Array, "R n"]:
        """The same as `errors`, each run with friction, rotors and offsets of its own."""
        return self.tables.errors_among(self.sums, own_losses=True)


class Parting:
    """Odd runs against the rest."""

    def __init__(self, session: ComparedRuns, odd: tuple[int, ...]) -> None:
        self.session = session
        self.odd = list(odd)
        self.rest = [number for number in range(len(session.runs)) if number not in odd]
        self.runs = [session.runs[number] for number in odd]

    @cached_property
    def others(self) -> Fit:
        """The fit to all runs that are not odd."""
        return fit(self.session.sums[self.rest].mean(axis=0), len(self.rest))

    @cached_property
    def _among(self) -> Fit:
        """What each of the rest is foretold by: the other ones of the rest."""
        return fits_among(self.session.sums[self.rest])

    @cached_property
    def usual(self) -> Float[Array, "r n"]:
        """Logarithm of the errors of the runs that are not odd, foretold by one another."""
        return self.session.tables.errors_of(self.session.sums[self.rest], self._among)

    @cached_property
    def foretold(self) -> Bool[Array, " n"]:
        """The joints whose torque in the odd runs the rest can foretell.

        A joint that moves in the odd runs alone has friction and inertia that the rest know nothing
        of.
        """
        sums = self.session.sums
        left_open = self.others.open_square(sums[self.odd]).mean(axis=0)
        of_rest = self._among.open_square(sums[self.rest])
        as_usual = np.max(of_rest, axis=0) + np.exp(2.0 * mean_error(self.usual))
        return np.asarray(left_open < as_usual)

    def excess(self) -> float:
        """By how much the rest foretell the odd runs worse than runs are foretold, where it is
        most.

        Logarithm of a ratio of errors; usual is each run foretold by all others. −∞ where no joint
        can be compared.
        """
        errors = self.session.errors
        worse = self.errors_of_odd() - mean_error(errors[self.rest])
        return float(np.max(worse, initial=-np.inf, where=np.isfinite(worse)))

    def errors_of_odd(self, change: RunChange | None = None) -> Float[Array, " n"]:
        """Mean logarithm of the odd runs' errors, foretold by the rest, by joint.

        Args:
            change: What is undone in the odd runs first; nothing if None.
        """
        sums = self._sums_of_odd(change)
        return mean_error(self.session.tables.errors_of(sums, self.others))

    def _sums_of_odd(self, change: RunChange | None) -> Float[Array, "k n c c"]:
        if change is None:
            return self.session.sums[self.odd]
        return np.array([self.session.tables.sums(change.undo(run)) for run in self.runs])

    def possible(self) -> float:
        """The most that any change can gain: as if the odd runs became like the rest [nats]."""
        return self._gain(self.session.errors, mean_error(self.usual), self.usual)

    def _gain(
        self,
        before: Float[Array, "R n"],
        of_odd: Float[Array, "... n"],
        of_rest: Float[Array, "r n"],
    ) -> float:
        """What is gained at joints that are foretold [nats].

        Args:
            before: Errors of all runs.
            of_odd, of_rest: Errors of the odd runs and of the rest afterwards.
        """
        gained = np.nansum((before[self.odd] - of_odd)[:, self.foretold])
        gained += np.nansum((before[self.rest] - of_rest)[:, self.foretold])
        return float(gained)

    def another_arm(self, least: float) -> RunDifference | None:
        """The odd runs as ones of another arm; None where less is gained than `least` [nats].

        As much has to be gained where each run has friction, rotors and offsets of its own: on a
        sound arm they drift with its warmth, which is no other arm.
        """
        session = self.session
        among = self._among_themselves(self.usual, own_losses=False)
        gain = self._gain(session.errors, among, self.usual)
        if gain <= least:
            return None
        usual = session.tables.errors_of(session.sums[self.rest], self._among, own_losses=True)
        beside_losses = self._among_themselves(usual, own_losses=True)
        if self._gain(session.errors_beside_losses, beside_losses, usual) <= least:
            return None
        return self.difference(RunChange(OTHER_ARM, ()), gain, mean_error(among))

    def _among_themselves(
        self, usual: Float[Array, "r n"], own_losses: bool
    ) -> Float[Array, "k n"]:
        """Errors of the odd runs, each foretold by the other odd ones; none is below the rest's.

        Smaller torques have smaller errors. A run alone is foretold from half to half; halves are
        more alike than runs: the most that one of the rest gains so is added.

        Args:
            usual: Errors of the rest.
            own_losses: Whether errors are beside losses of each run's own.
        """
        tables = self.session.tables
        if len(self.odd) > 1:
            errors = tables.errors_among(self.session.sums[self.odd], own_losses)
        else:
            of_rest = np.array([self._by_halves(number, own_losses) for number in self.rest])
            gained = usual - of_rest
            most = np.max(gained, axis=0, initial=0.0, where=np.isfinite(gained))
            errors = self._by_halves(self.odd[0], own_losses)[None] + most
        return np.maximum(errors, mean_error(usual))

    def _by_halves(self, number: int, own_losses: bool) -> Float[Array, " n"]:
        """A run's errors where each half of it foretells the other."""
        tables = self.session.tables
        halves = np.array([tables.sums(half) for half in self.session.runs[number].halves()])
        return mean_error(tables.errors_among(halves, own_losses))

    def conventions(self, least: float) -> Iterator[RunDifference]:
        """Conventions of the odd runs by which more is gained than `least` [nats].

        And more than the number of conventions makes likely.
        """
        changes = [
            change for change in self._changes() if can_be_judged(change, self.foretold, self.runs)
        ]
        if not changes:
            return
        errors = [self.errors_of_odd(change) for change in changes]
        costs = []
        for change, left in zip(changes, errors, strict=True):
            costs.append(float(np.nansum(left[self.foretold])) + self._units(change))
        least += float(np.log(len(changes)))
        for place in np.argsort(costs)[: LIMIT.closer]:
            change = changes[int(place)]
            gain, sure = self._gains_of(change)
            if sure > least:
                yield self.difference(change, gain, errors[int(place)])

    def _units(self, change: RunChange) -> float:
        """What a change of torque's unit adds to logarithms of errors, where joints move."""
        moving = np.mean([run.moves.any(axis=0) for run in self.runs], axis=0)
        units = moving * change.log_units(self.session.arm.n)
        return float(units[self.foretold].sum())

    def _gains_of(self, change: RunChange) -> tuple[float, float]:
        """What all runs gain by a change of the odd ones [nats].

        And how much of it no drift of friction explains.
        """
        session = self.session
        sums = np.array(session.sums)
        sums[self.odd] = self._sums_of_odd(change)
        cost = len(self.odd) * self._units(change)
        after = session.tables.errors_among(sums)
        gain = self._gain(session.errors, after[self.odd], after[self.rest]) - cost
        if change.kind != "effort_scale":
            return gain, gain
        after = session.tables.errors_among(sums, own_losses=True)
        beside_losses = (
            self._gain(session.errors_beside_losses, after[self.odd], after[self.rest]) - cost
        )
        return gain, min(gain, beside_losses)

    def _changes(self) -> Iterator[RunChange]:
        """All that may be otherwise in the odd runs."""
        arm = self.session.arm
        yield from discrete_changes(arm.n, arm.sliding_joints)
        foretold = [
            self.session.tables.foretell(run, self.others.coefficients) for run in self.runs
        ]
        yield from scale_changes(self.runs, np.concatenate(foretold))

        def cost(change: RunChange) -> float:
            return float(np.nansum(self.errors_of_odd(change)))

        for joint in range(arm.n):
            tried = list(zero_changes(arm, joint))
            if tried:
                yield followed(min(tried, key=cost), cost)

    def difference(
        self, change: RunChange, gain: float, after: Float[Array, " n"]
    ) -> RunDifference:
        """What is told of a change of the odd runs.

        Args:
            change: The change.
            gain: By how much all errors shrink together [nats].
            after: Logarithms of the errors that it leaves.

        Returns:
            With its errors as such, not as logarithms.
        """
        names = tuple(run.name for run in self.runs)
        before = self.errors_of_odd()
        usual = mean_error(self.usual)
        return RunDifference(names, change, gain, np.exp(before), np.exp(after), np.exp(usual))


def can_be_judged(
    change: RunChange, foretold: Bool[Array, " n"], runs: Sequence[RunStates]
) -> bool:
    """Whether the rest foretell the torques that a change is judged by.

    Torques of its own joints, or of all if it changes the motion. Of two joints that change places
    both have to move at once: one that stands takes no torque to be foretold.

    Args:
        change: The change.
        foretold: Joints whose torque the rest foretell.
        runs: The odd runs.
    """
    if change.kind in OF_TORQUES:
        return bool(foretold[list(change.joints)].all())
    if not foretold.all():
        return False
    if change.kind != "columns":
        return True
    moves = np.concatenate([run.moves[:, list(change.joints)] for run in runs])
    both = moves.all(axis=1).sum()
    either = moves.any(axis=1).sum()
    return bool(2 * both > either)


def followed(change: RunChange, cost: Callable[[RunChange], float]) -> RunChange:
    """A change with its size followed to where the cost is least, by halving steps.

    Args:
        change: A change of a zero [rad].
        cost: Cost of a change.
    """
    best = cost(change)
    step = FIRST_STEP
    for _ in range(LIMIT.halvings):
        for angle in (change.size - step, change.size + step):
            tried = replace(change, size=float(angle))
            tried_cost = cost(tried)
            if tried_cost < best:
                change = tried
                best = tried_cost
        step *= 0.5
    return change
