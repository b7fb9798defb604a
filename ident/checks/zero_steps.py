"""A joint's zero that moves once in a session: the zeros of early runs against those of late ones.

All runs follow one model. Where a joint's zero lies elsewhere by δ, every joint i is off by

    e_i = δ ∂tau_i / ∂q_j

beside losses of the run's own, for friction drifts. So each run says by itself where its zero is, once, however many
samples it has. One cut parts early runs from late ones; Student's t holds the step between their means against the
scatter within them, and its chance counts for every joint and every cut. What another load of the hand explains better
is no step of a zero.

Source: Student (1908), Bonferroni's bound, and Schwarz's criterion (1978) between load and zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float
from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.foretold import LOSSES, ROUNDING, RunStates, fit
from ident.checks.parting import ComparedRuns, Parting, RunDifference, followed
from ident.checks.run_changes import RunChange
from ident.robot.arm import ArmModel
from ident.robot.chain import PER_LINK

FEWEST_STATES = 2 * LOSSES
# Of a link's ten inertial parameters: its mass and first moments, which are what gravity feels of a load.
OF_LOAD = slice(0, 4)


@dataclass(frozen=True)
class ZeroStep:
    """A joint whose zero moves between two runs."""

    joint: int  # column
    first: int  # number of the first run behind the step, among those that are compared
    size: float  # by how much the joint is read too far behind it [rad]
    chance: float  # of so clear a step by chance, over all joints and cuts [1]


@dataclass(frozen=True, eq=False)
class Sides:
    """Normal equations of each run: what its torques say of changes, each by its column.

    Squares are of what is left beside the run's own losses, in units of the joints' usual errors, and means over
    states: a run counts once at each joint.
    """

    normal: Float[Array, "R c c"]
    right: Float[Array, "R c"]
    left: Float[Array, " R"]  # square that is left where nothing changes
    joints: int  # how many joints' errors stand in all that is left

    def gain(self, columns: list[int], late: Bool[Array, " R"]) -> float:
        """By how much all that is left shrinks where some changes are others on both sides of a cut, against one."""
        sides = sum(self._explained(columns, side) for side in (late, ~late))
        return sides - self._explained(columns, np.ones_like(late))

    @property
    def count(self) -> int:
        """How many errors there are: one of each run at each joint."""
        return len(self.left) * self.joints

    def evidence(self, columns: list[int], late: Bool[Array, " R"]) -> float:
        """The logarithm of the likelihood that is gained, the errors' size being open [nats]."""
        total = float(self.left.sum())
        rest = max(total - self.gain(columns, late), ROUNDING)
        return float(0.5 * self.count * np.log(total / rest))

    def _explained(self, columns: list[int], runs: Bool[Array, " R"]) -> float:
        """By how much it shrinks where some runs have the same change."""
        normal = self.normal[runs].sum(axis=0)[np.ix_(columns, columns)]
        right = self.right[runs].sum(axis=0)[columns]
        return float(right @ np.linalg.lstsq(normal, right, rcond=ROUNDING)[0])


def find_zero_step(compared: ComparedRuns) -> RunDifference | None:
    """The step of a zero that explains most, of those that no chance explains; None without any.

    Args:
        compared: The runs of a session that are long enough, in their order.
    """
    if not cuts_of(len(compared.runs)):
        return None
    sides = make_sides(compared)
    steps = list(all_steps(sides, compared.arm.n, len(compared.runs)))
    clear = [step for step in steps if step.chance * len(steps) < LIMIT.step_chance]
    if not clear:
        return None

    def gain(step: ZeroStep) -> float:
        return sides.gain([step.joint], is_late(step.first, len(compared.runs)))

    best = max(clear, key=gain)
    if is_load(sides, best, compared.arm.n):
        return None
    return confirm(compared, replace(best, chance=best.chance * len(steps)))


def confirm(compared: ComparedRuns, step: ZeroStep) -> RunDifference | None:
    """What the runs on the shorter side of a step have otherwise than the rest, if reading them so says the same.

    There the zero is followed to where the rest foretell these runs best, not by derivatives: it must end nearer to
    the step than to none, and the runs must be foretold better so.
    """
    late = is_late(step.first, len(compared.runs))
    is_odd = ~late if (~late).sum() < late.sum() else late
    parting = Parting(compared, tuple(np.flatnonzero(is_odd).tolist()))
    size = step.size if is_odd[-1] else -step.size

    def cost(change: RunChange) -> float:
        return float(np.nansum(parting.errors_of_odd(change)))

    change = followed(RunChange("zero", (step.joint,), size), cost)
    is_nearer_to_none = abs(change.size - size) > abs(change.size)
    if is_nearer_to_none or cost(change) >= float(np.nansum(parting.errors_of_odd())):
        return None
    gain = -float(np.log(max(step.chance, ROUNDING)))
    return parting.difference(change, gain, parting.errors_of_odd(change))


def cuts_of(runs: int) -> range:
    """Numbers of the runs that a late side may begin with: two runs or more are on both sides."""
    return range(2, runs - 1)


def is_late(first: int, runs: int) -> Bool[Array, " R"]:
    """Which runs lie behind a cut."""
    return np.asarray(np.arange(runs) >= first)


def all_steps(sides: Sides, joints: int, runs: int) -> Iterator[ZeroStep]:
    """A step of each joint's zero at each cut with two runs or more on both of its sides."""
    for joint in range(joints):
        weight = sides.normal[:, joint, joint]
        estimate = sides.right[:, joint] / np.maximum(weight, ROUNDING)
        for first in cuts_of(runs):
            late = is_late(first, runs)
            if weight[late].sum() > ROUNDING and weight[~late].sum() > ROUNDING:
                yield step_between(estimate, weight, late, joint)


def step_between(
    estimate: Float[Array, " R"], weight: Float[Array, " R"], late: Bool[Array, " R"], joint: int
) -> ZeroStep:
    """Student's t of weighted estimates on both sides of a cut.

    Args:
        estimate: Zero of each run [rad].
        weight: How much each says.
        late: Which runs lie behind the cut.
        joint: Whose zero.
    """
    means = [float(np.average(estimate[side], weights=weight[side])) for side in (~late, late)]
    scatter = estimate - np.where(late, means[1], means[0])
    freedom = len(estimate) - 2
    variance = float(weight @ scatter**2) / freedom
    error = np.sqrt(variance * (1.0 / weight[late].sum() + 1.0 / weight[~late].sum()))
    size = means[0] - means[1]  # an angle that is read too far is off by minus that
    chance = 2.0 * student.sf(abs(size) / max(float(error), ROUNDING), freedom)
    return ZeroStep(joint, int(np.argmax(late)), size, float(chance))


def is_load(sides: Sides, step: ZeroStep, joints: int) -> bool:
    """Whether another load of the hand from the same run on explains more than the step, its numbers counted."""
    late = is_late(step.first, len(sides.left))
    load = list(range(joints, sides.normal.shape[1]))
    more = sides.evidence(load, late) - sides.evidence([step.joint], late)
    return more > 0.5 * (len(load) - 1) * np.log(sides.count)


def make_sides(compared: ComparedRuns) -> Sides:
    """The normal equations of all runs: zeros of the joints first, then the load's mass and moments."""
    tables, runs = compared.tables, compared.runs
    coefficients = fit(compared.sums.mean(axis=0), len(runs)).coefficients
    parts = []
    for run in runs:
        changes = changes_of(compared.arm, run)
        parts.append(beside_losses(tables.table(run), run, coefficients, changes))
    left = np.array([squares[:, -1, -1] for squares in parts])
    seen = left > 0.0
    usual = np.where(seen.any(axis=0), left.sum(axis=0) / np.maximum(seen.sum(axis=0), 1), np.inf)
    sums = np.array([np.sum(squares / usual[:, None, None], axis=0) for squares in parts])
    return Sides(sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1], int(np.isfinite(usual).sum()))


def changes_of(arm: ArmModel, run: RunStates) -> Float[Array, "n T c"]:
    """What each joint's torque changes by, for a zero of each joint that turns and for a load of the hand."""
    zeros, _, _ = arm.derivatives(run.q, run.dq, run.ddq)
    turning = np.where(arm.sliding_joints, 0.0, 1.0)
    regressor = arm.regressor(run.q, run.dq, run.ddq)
    load = regressor[:, :, -PER_LINK:][:, :, OF_LOAD]
    changes = np.concatenate([zeros * turning, load], axis=-1)
    return np.asarray(changes.transpose(1, 0, 2))


def beside_losses(
    table: Float[Array, "n T k"], run: RunStates, coefficients: Float[Array, "n p"], changes: Float[Array, "n T c"]
) -> Float[Array, "n d d"]:
    """Inner products of changes, and last of what is left, beside losses of the run's own; 0 of joints that stand."""
    squares = np.zeros((len(table), changes.shape[2] + 1, changes.shape[2] + 1))
    for joint, rows in enumerate(run.moves.T):
        if rows.sum() < FEWEST_STATES:
            continue
        left = table[joint][:, -1] - table[joint][:, :-1] @ coefficients[joint]
        whole = np.column_stack([changes[joint], left])[rows]
        losses, _ = np.linalg.qr(table[joint][rows, -1 - LOSSES : -1])
        whole = whole - losses @ (losses.T @ whole)
        squares[joint] = whole.T @ whole / rows.sum()
    return squares
