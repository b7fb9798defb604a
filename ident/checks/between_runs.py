"""Each run of a session held against the others: signs, zeros, scales, columns, clock, and whether it is this arm's.

The runs are parted, one against the rest or an earlier part against a later one. What a parting may gain is told by
foretelling: each run by a model of all others, and so again with a convention of the odd runs undone, or with a model
of their own. Evidence is the sum over runs and joints of the logarithm by which errors shrink: a run counts once at
each joint, however many samples it has, for runs differ more than their samples tell. It must exceed the logarithm of
the number of alternatives over the chance of a false alarm. Runs that only move otherwise are foretold badly, too, and
no change mends that.

Source: Bonferroni's bound on likelihood ratios of many alternatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.foretold import Fit, RunStates, RunTables, fit, fits_among, mean_error, states_of
from ident.checks.run_changes import OF_TORQUES, OTHER_ARM, RunChange, discrete_changes, scale_changes, zero_changes
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

FIRST_STEP = np.pi / 12.0  # of a zero that is followed [rad]
FEWEST_RUNS = 3  # of two runs nobody knows the odd one


@dataclass(frozen=True, eq=False)
class RunDifference:
    """What some runs have otherwise than the rest."""

    odd: tuple[str, ...]  # their names
    change: RunChange
    gain: float  # by how much all errors shrink together [nats]
    before: Float[Array, " n"]  # their root mean square errors, foretold by the rest [N m]
    after: Float[Array, " n"]  # and with the change undone; as they are among themselves where the arm is another
    usual: Float[Array, " n"]  # that of the rest among themselves


def partings(count: int) -> list[tuple[int, ...]]:
    """Each run alone; and the smaller of an earlier and a later part, both of more than one run."""
    alone = [(number,) for number in range(count)]
    parts = []
    for cut in range(2, count - 1):
        early, late = tuple(range(cut)), tuple(range(cut, count))
        parts.append(early if len(early) < len(late) else late)
    return alone + parts


class RunComparison:
    """The runs of a session, and what each parting of them says."""

    def __init__(self, runs: Sequence[RunStates], arm: ArmModel) -> None:
        self.runs = list(runs)
        self.arm = arm
        self.tables = RunTables(arm, runs)
        self.sums = np.array([self.tables.sums(run) for run in runs])
        self.errors = self.tables.errors_among(self.sums)
        self.partings = partings(len(self.runs))

    @cached_property
    def errors_beside_losses(self) -> Float[Array, "R n"]:
        """Errors of all runs, each foretold by all the others beside losses of its own."""
        return self.tables.errors_among(self.sums, own_losses=True)

    def find(self) -> RunDifference | None:
        """The likeliest difference; None where there is none."""
        found = []
        for odd in self._suspects():
            found += list(self._explain(odd))
        return max(found, key=lambda difference: difference.gain, default=None)

    def _suspects(self) -> list[tuple[int, ...]]:
        """Partings whose odd runs the rest foretell worst, by the joint at which it is worst."""
        excess = []
        for odd in self.partings:
            rest = self._rest(odd)
            errors = self.errors[list(odd)]
            if len(odd) > 1:
                others = fit(self.sums[rest].mean(axis=0), len(rest))
                errors = np.array([self.tables.error_of(self.sums[number], others) for number in odd])
            worse = mean_error(errors) - mean_error(self.errors[rest])
            excess.append(float(np.max(worse, initial=-np.inf, where=np.isfinite(worse))))
        worst = np.argsort(excess)[::-1][: LIMIT.suspects]
        return [self.partings[int(place)] for place in worst]

    def _rest(self, odd: tuple[int, ...]) -> list[int]:
        return [number for number in range(len(self.runs)) if number not in odd]

    def _explain(self, odd: tuple[int, ...]) -> Iterator[RunDifference]:
        """What the odd runs have otherwise, if the evidence says so: a convention, or all of it."""
        rest = self._rest(odd)
        others = fit(self.sums[rest].mean(axis=0), len(rest))
        among = fits_among(self.sums[rest])
        usual = self.tables.errors_of(self.sums[rest], among)
        foretold = self._foretellable(odd, others, among, usual)
        alternatives = float(np.log(len(self.partings) / LIMIT.chance))
        # As much is gained where the odd runs become like the rest.
        usual_mean = mean_error(usual)
        possible = float(np.nansum((self.errors[list(odd)] - usual_mean)[:, foretold]))
        possible += float(np.nansum((self.errors[rest] - usual)[:, foretold]))
        if possible < alternatives:
            return
        before = self._odd_errors(odd, others)

        def difference(change: RunChange, gain: float, after: Float[Array, " n"]) -> RunDifference:
            names = tuple(self.runs[number].name for number in odd)
            sizes = [np.exp(errors) for errors in (before, after, usual_mean)]
            return RunDifference(names, change, gain, *sizes)

        # Smaller torques have smaller errors: none count below the rest's.
        own = np.maximum(self._own_errors(odd, rest, usual), usual_mean)
        gain = float(np.nansum((self.errors[list(odd)] - own)[:, foretold]))
        gain += float(np.nansum((self.errors[rest] - usual)[:, foretold]))
        if min(gain, self._gain_beside_losses(odd, rest, among, foretold)) > alternatives:
            yield difference(RunChange(OTHER_ARM, ()), gain, mean_error(own))

        runs = [self.runs[number] for number in odd]
        # Shares of the odd runs in which each joint moves, so that it has an error in a unit.
        moving = np.mean([run.moves.any(axis=0) for run in runs], axis=0)

        def units(change: RunChange) -> float:
            return float((moving * change.log_units(self.arm.n))[foretold].sum())

        changes = [change for change in self._changes(odd, others) if can_be_judged(change, foretold, runs)]
        if not changes:
            return
        errors = [self._odd_errors(odd, others, change)[foretold] for change in changes]
        costs = [float(np.nansum(left)) + units(change) for left, change in zip(errors, changes, strict=True)]
        alternatives += float(np.log(len(changes)))
        for place in np.argsort(costs)[: LIMIT.closer]:
            change = changes[int(place)]
            sums = np.array(self.sums)
            for number in odd:
                sums[number] = self.tables.sums(change.undo(self.runs[number]))
            cost = len(odd) * units(change)
            fall = self.errors - self.tables.errors_among(sums)
            gain = float(np.nansum(fall[:, foretold])) - cost
            sure = gain
            if change.kind == "effort_scale":  # friction that drifts is no other unit
                fall = self.errors_beside_losses - self.tables.errors_among(sums, own_losses=True)
                sure = min(gain, float(np.nansum(fall[:, foretold])) - cost)
            if sure > alternatives:
                yield difference(change, gain, self._odd_errors(odd, others, change))

    def _foretellable(
        self, odd: tuple[int, ...], others: Fit, among: Sequence[Fit], usual: Float[Array, "r n"]
    ) -> Bool[Array, " n"]:
        """The joints whose torque in the odd runs the rest can foretell, as one that moves as they do.

        A joint that moves in the odd runs alone has friction and inertia that the rest know nothing of.

        Args:
            odd: Numbers of the odd runs.
            others: What the rest say together.
            among, usual: What each of the rest is foretold by, and its error.
        """
        left_open = np.mean([others.open_square(self.sums[number]) for number in odd], axis=0)
        rest = self._rest(odd)
        of_rest = np.array([fitted.open_square(self.sums[k]) for k, fitted in zip(rest, among, strict=True)])
        as_usual = of_rest.max(axis=0) + np.exp(2.0 * mean_error(usual))
        return np.asarray(left_open < as_usual)

    def _gain_beside_losses(
        self, odd: tuple[int, ...], rest: Sequence[int], among: Sequence[Fit], foretold: Bool[Array, " n"]
    ) -> float:
        """What is gained where the odd runs are of another arm, each run with friction, rotors and offsets of its own.

        On a sound arm losses drift with its warmth, which is no other arm.
        """
        errors = self.errors_beside_losses
        usual = self.tables.errors_of(self.sums[rest], among, own_losses=True)
        own = np.maximum(self._own_errors(odd, rest, usual, own_losses=True), mean_error(usual))
        gain = float(np.nansum((errors[list(odd)] - own)[:, foretold]))
        return gain + float(np.nansum((errors[rest] - usual)[:, foretold]))

    def _own_errors(
        self, odd: tuple[int, ...], rest: Sequence[int], usual: Float[Array, "r n"], own_losses: bool = False
    ) -> Float[Array, "k n"]:
        """Errors of the odd runs, each foretold by the other odd ones; beside losses of their own, if asked for.

        A run alone is foretold from half to half. Halves are more alike than runs: the most that one of the rest gains
        so is added.
        """
        if len(odd) > 1:
            return self.tables.errors_among(self.sums[list(odd)], own_losses)
        halves = np.array([self._by_halves(number, own_losses) for number in (*odd, *rest)])
        gained = np.max(usual - halves[1:], axis=0, initial=0.0, where=np.isfinite(usual - halves[1:]))
        return np.asarray(halves[:1] + gained)

    def _by_halves(self, number: int, own_losses: bool) -> Float[Array, " n"]:
        """A run's errors where each half of it foretells the other."""
        parts = np.array([self.tables.sums(part) for part in self.runs[number].halves()])
        return mean_error(self.tables.errors_among(parts, own_losses))

    def _odd_errors(self, odd: tuple[int, ...], others: Fit, change: RunChange | None = None) -> Float[Array, " n"]:
        """Mean logarithm of the odd runs' errors by joint, with a change undone."""
        found = []
        for number in odd:
            sums = self.sums[number]
            if change is not None:
                sums = self.tables.sums(change.undo(self.runs[number]))
            found.append(self.tables.error_of(sums, others))
        return mean_error(np.array(found))

    def _changes(self, odd: tuple[int, ...], others: Fit) -> Iterator[RunChange]:
        """All that may be otherwise in the odd runs."""
        yield from discrete_changes(self.arm.n, self.arm.sliding_joints)
        runs = [self.runs[number] for number in odd]
        foretold = np.concatenate([self.tables.foretell(run, others.coefficients) for run in runs])
        yield from scale_changes(runs, foretold)

        def cost(change: RunChange) -> float:
            return float(np.nansum(self._odd_errors(odd, others, change)))

        for joint in range(self.arm.n):
            tried = list(zero_changes(self.arm, joint))
            if tried:
                yield followed(min(tried, key=cost), cost)


def can_be_judged(change: RunChange, foretold: Bool[Array, " n"], runs: Sequence[RunStates]) -> bool:
    """Whether what a change says is foretold: torques of its own joints, or of all if it changes the motion.

    Of two joints that change places both have to move at once: one that stands takes no torque to be foretold.
    """
    if change.kind in OF_TORQUES:
        return bool(foretold[list(change.joints)].all())
    if change.kind == "columns":
        moves = np.concatenate([run.moves[:, list(change.joints)] for run in runs])
        both = moves.all(axis=1).sum()
        either = moves.any(axis=1).sum()
        return bool(foretold.all()) and bool(2 * both > either)
    return bool(foretold.all())


def followed(change: RunChange, cost: Callable[[RunChange], float]) -> RunChange:
    """A zero followed to where it costs least, by halving steps."""
    best, step = cost(change), FIRST_STEP
    for _ in range(LIMIT.halvings):
        for angle in (change.size - step, change.size + step):
            tried = replace(change, size=float(angle))
            tried_cost = cost(tried)
            if tried_cost < best:
                change, best = tried, tried_cost
        step *= 0.5
    return change


def find_difference(session: Session, arm: ArmModel) -> RunDifference | None:
    """What some runs of a session have otherwise than the rest; None where they are alike, or too few."""
    states = [run for run in map(states_of, session.runs) if run is not None]
    if len(states) < FEWEST_RUNS:
        return None
    return RunComparison(states, arm).find()
