"""A joint's zero that moves once in a session: the zeros of early runs against those of late ones.

All runs follow one model. Where a joint's zero lies elsewhere by δ, every joint i is off by

    e_i = δ ∂tau_i / ∂q_j

beside losses of the run's own, for friction drifts. So each run says by itself where its zero is, once, however many
samples it has. One cut parts early runs from late ones; Student's t holds the step between their means against the
scatter within them, and its chance counts for every joint and every cut. What another load of the hand explains better
is no step of a zero.

Source: Student (1908), Bonferroni's bound, and for load against zero Schwarz's criterion (1978).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float
from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.foretold import LOSSES, RunStates, fit
from ident.checks.parting import ComparedRuns

STEP_RAD = 1e-3  # for derivatives by central differences
# Fewer runs have no scatter within both parts.
FEWEST_RUNS = 4
FEWEST_STATES = 2 * LOSSES
# Of a link's ten inertial parameters: its mass and first moments, which are what gravity feels of a load.
OF_LOAD = slice(0, 4)
PER_LINK = 10
TINY = 1e-12


@dataclass(frozen=True)
class ZeroStep:
    """A joint whose zero moves between two runs."""

    joint: int  # column
    first: int  # number of the first run behind the step, among those that are compared
    size: float  # [rad]
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
        """By how much all that is left shrinks where some columns step once."""
        side = np.where(late, 0.5, -0.5)
        normal = self.normal[:, columns][:, :, columns]
        total = np.einsum("r,rcd->cd", side**2, normal)
        right = side @ self.right[:, columns]
        solution = np.linalg.lstsq(total, right, rcond=TINY)[0]
        return float(right @ solution)


def find_zero_step(compared: ComparedRuns) -> ZeroStep | None:
    """The step of a zero that explains most, of those that no chance explains; None without any.

    Args:
        compared: The runs of a session that are long enough, in their order.
    """
    if len(compared.runs) < FEWEST_RUNS:
        return None
    sides = make_sides(compared)
    steps = list(all_steps(sides, compared.arm.n, len(compared.runs)))
    clear = [step for step in steps if step.chance * len(steps) < LIMIT.chance]
    if not clear:
        return None

    def gain(step: ZeroStep) -> float:
        return sides.gain([step.joint], is_late(step.first, len(compared.runs)))

    best = max(clear, key=gain)
    if is_load(sides, best, compared.arm.n):
        return None
    return replace(best, chance=best.chance * len(steps))


def is_late(first: int, runs: int) -> Bool[Array, " R"]:
    """Which runs lie behind a cut."""
    return np.asarray(np.arange(runs) >= first)


def all_steps(sides: Sides, joints: int, runs: int) -> Iterator[ZeroStep]:
    """A step of each joint's zero at each cut with two runs or more on both of its sides."""
    for joint in range(joints):
        weight = sides.normal[:, joint, joint]
        estimate = sides.right[:, joint] / np.maximum(weight, TINY)
        for first in range(2, runs - 1):
            late = is_late(first, runs)
            if weight[late].sum() > TINY and weight[~late].sum() > TINY:
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
    size = means[1] - means[0]
    chance = 2.0 * student.sf(abs(size) / max(float(error), TINY), freedom)
    return ZeroStep(joint, int(np.argmax(late)), size, float(chance))


def is_load(sides: Sides, step: ZeroStep, joints: int) -> bool:
    """Whether another load of the hand from the same run on explains more than the step, its numbers counted."""
    late = is_late(step.first, len(sides.left))
    load = list(range(joints, sides.normal.shape[1]))
    total = float(sides.left.sum())
    count = len(sides.left) * sides.joints
    with_zero = max(total - sides.gain([step.joint], late), TINY)
    with_load = max(total - sides.gain(load, late), TINY)
    cost = 0.5 * (len(load) - 1) * np.log(count)
    return bool(0.5 * count * np.log(with_zero / with_load) > cost)


def make_sides(compared: ComparedRuns) -> Sides:
    """The normal equations of all runs: zeros of the joints first, then the load's mass and moments."""
    tables, runs = compared.tables, compared.runs
    coefficients = fit(compared.sums.mean(axis=0), len(runs)).coefficients
    columns = [changes_of(compared, run, coefficients) for run in runs]
    parts = [beside_losses(tables.table(run), run, coefficients, own) for run, own in zip(runs, columns, strict=True)]
    left = np.array([squares[:, -1, -1] for squares in parts])
    seen = left > 0.0
    usual = np.where(seen.any(axis=0), left.sum(axis=0) / np.maximum(seen.sum(axis=0), 1), np.inf)
    sums = np.array([np.sum(squares / usual[:, None, None], axis=0) for squares in parts])
    return Sides(sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1], int(np.isfinite(usual).sum()))


def changes_of(compared: ComparedRuns, run: RunStates, coefficients: Float[Array, "n p"]) -> Float[Array, "n T c"]:
    """What each joint's torque changes by, for a zero of each joint and for a load of the hand."""
    arm, tables = compared.arm, compared.tables
    columns = []
    for joint in range(arm.n):
        moved = np.zeros(arm.n)
        moved[joint] = 0.0 if arm.sliding_joints[joint] else STEP_RAD
        after = tables.foretell(replace(run, q=run.q + moved), coefficients)
        before = tables.foretell(replace(run, q=run.q - moved), coefficients)
        columns.append((after - before) / (2.0 * STEP_RAD))
    regressor = arm.regressor(run.q, run.dq, run.ddq)
    load = regressor[:, :, -PER_LINK:][:, :, OF_LOAD]
    zeros = np.stack(columns, axis=-1)
    return np.asarray(np.concatenate([zeros, load], axis=-1).transpose(1, 0, 2))


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
