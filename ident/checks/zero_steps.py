"""A joint's zero that moves once in a session: the zeros of early runs against those of late ones.

All runs follow one model. Where a joint's zero lies elsewhere by δ, every joint i is off by

    e_i = δ ∂tau_i / ∂q_j

beside losses of the run's own, for friction drifts. So each run says by itself where its zero is,
once, however many samples it has. One cut parts early runs from late ones; Student's t holds the
step between their means against the scatter within them, and its chance counts for every joint and
every cut. What another load of the hand explains better is no step of a zero.

Source: Student (1908), Bonferroni's bound, and Schwarz's criterion (1978) between load and zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from ident.arrays import Array, Bool, Float
from ident.checks.foretold import LOSSES, ROUNDING, RunStates, fit, mean_error
from ident.checks.parting import ComparedRuns, Parting, RunDifference, followed
from ident.checks.run_changes import RunChange
from ident.checks.settings import BETWEEN_RUNS as LIMIT
from ident.robot.arm import ArmModel
from ident.robot.chain import PER_LINK

FEWEST_STATES = 2 * LOSSES
# Of a link's ten inertial parameters: its mass and first moments, as gravity feels a load.
OF_LOAD = slice(0, 4)


@dataclass(frozen=True)
class ZeroStep:
    """A joint whose zero moves between two runs."""

    joint: int  # column
    first: int  # number of the first run behind the step, among those that are compared
    size: float  # by how much the joint is read too far behind it [rad]
    chance: float  # of so clear a step by chance [1]


@dataclass(frozen=True, eq=False)
class RunEquations:
    """Normal equations of each run: what its torques say of changes, each by its column.

    Squares are of what is left beside the run's own losses, in units of the joints' usual errors,
    and means over states: a run counts once at each joint.
    """

    normal: Float[Array, "R c c"]
    right: Float[Array, "R c"]
    left: Float[Array, " R"]  # square that is left where nothing changes
    joints: int  # how many joints' errors stand in all that is left

    @property
    def count(self) -> int:
        """How many errors there are: one of each run at each joint."""
        return len(self.left) * self.joints

    def evidence(self, columns: list[int], late: Bool[Array, " R"]) -> float:
        """Gain of log likelihood by changes from a cut on, the errors' size being open [nats].

        Args:
            columns: Columns of the changes.
            late: Which runs lie behind the cut.
        """
        total = float(self.left.sum())
        rest = max(total - self.gain(columns, late), ROUNDING)
        return float(0.5 * self.count * np.log(total / rest))

    def gain(self, columns: list[int], late: Bool[Array, " R"]) -> float:
        """By how much the squares that are left shrink where changes differ on both sides of a cut.

        Args:
            columns: Columns of the changes.
            late: Which runs lie behind the cut.
        """
        everywhere = np.ones_like(late)
        both_sides = self._explained(columns, late) + self._explained(columns, ~late)
        return both_sides - self._explained(columns, everywhere)

    def _explained(self, columns: list[int], runs: Bool[Array, " R"]) -> float:
        """By how much it shrinks where some runs have the same change."""
        normal = self.normal[runs].sum(axis=0)[np.ix_(columns, columns)]
        right = self.right[runs].sum(axis=0)[columns]
        solution, *_ = np.linalg.lstsq(normal, right, rcond=ROUNDING)
        return float(right @ solution)


def find_zero_step(compared: ComparedRuns) -> RunDifference | None:
    """The step of a zero that explains most, of those that no chance explains; None without any.

    Args:
        compared: The runs of a session that are long enough, in their order.
    """
    runs = len(compared.runs)
    if not cuts_of(runs):
        return None
    equations = make_equations(compared)
    steps = list(all_steps(equations, compared.arm.n))
    clear = [step for step in steps if step.chance * len(steps) < LIMIT.chance]
    if not clear:
        return None

    def gain(step: ZeroStep) -> float:
        return equations.gain([step.joint], is_late(step.first, runs))

    best = max(clear, key=gain)
    if is_load(equations, best, compared.arm.n):
        return None
    return confirm(compared, replace(best, chance=best.chance * len(steps)))


def confirm(compared: ComparedRuns, step: ZeroStep) -> RunDifference | None:
    """What the runs on the shorter side have otherwise, if reading them so says the same.

    The zero is followed to where the rest foretell these runs best, not by derivatives: it must
    end nearer to the step than to none, and the joint that it helps most must then be foretold more
    nearly as the rest foretell each other than as these were recorded: what hardly helps, or where
    nothing was worse than usual, is not what they have. So must all joints together: runs that are
    foretold far worse at other joints have something else, which a zero may imitate at one.

    Returns:
        The difference; None where it is not confirmed.
    """
    late = is_late(step.first, len(compared.runs))
    is_odd = ~late if (~late).sum() < late.sum() else late
    odd = tuple(np.flatnonzero(is_odd).tolist())
    parting = Parting(compared, odd)
    size = step.size if is_odd[-1] else -step.size

    def cost(change: RunChange) -> float:
        return float(np.nansum(parting.errors_of_odd(change)))

    change = followed(RunChange("zero", (step.joint,), size), cost)
    is_nearer_to_none = abs(change.size - size) > abs(change.size)
    before = parting.errors_of_odd()
    after = parting.errors_of_odd(change)
    if is_nearer_to_none or np.nansum(after) >= np.nansum(before):
        return None
    usual = mean_error(parting.usual)
    clearest = int(np.nanargmax(before - after))
    is_worse = before[clearest] > usual[clearest]
    if not is_worse or after[clearest] >= 0.5 * (before[clearest] + usual[clearest]):
        return None
    if beyond(after, usual) >= 0.5 * beyond(before, usual):
        return None
    gain = -float(np.log(max(step.chance, ROUNDING)))
    return parting.difference(change, gain, after)


def beyond(errors: Float[Array, " n"], usual: Float[Array, " n"]) -> float:
    """By how much joints are foretold worse than usual, summed over those that are.

    Args:
        errors, usual: Logarithms of errors, by joint.
    """
    return float(np.nansum(np.maximum(errors - usual, 0.0)))


def cuts_of(runs: int) -> range:
    """Numbers of the runs that a late side may begin with, so that both sides have two runs or
    more.

    Args:
        runs: Number of runs; below four there is no cut.
    """
    return range(2, runs - 1)


def is_late(first: int, runs: int) -> Bool[Array, " R"]:
    """Which of so many runs lie behind a cut: those from `first` on."""
    return np.asarray(np.arange(runs) >= first)


def all_steps(equations: RunEquations, joints: int) -> Iterator[ZeroStep]:
    """A step of each joint's zero at each cut, where both sides say anything of it.

    Args:
        equations: The runs' equations, zeros of the joints first.
        joints: Number of joints.
    """
    runs = len(equations.left)
    for joint in range(joints):
        weight = equations.normal[:, joint, joint]
        estimate = equations.right[:, joint] / np.maximum(weight, ROUNDING)
        for first in cuts_of(runs):
            late = is_late(first, runs)
            if min(weight[late].sum(), weight[~late].sum()) > ROUNDING:
                yield step_between(estimate, weight, late, joint)


def step_between(
    estimate: Float[Array, " R"],
    weight: Float[Array, " R"],
    late: Bool[Array, " R"],
    joint: int,
) -> ZeroStep:
    """The step of a joint's zero at a cut, and how likely chance makes it as large (Student's t).

    Args:
        estimate: Zero of each run [rad].
        weight: How much each says.
        late: Which runs lie behind the cut.
        joint: Whose zero.
    """
    before = float(np.average(estimate[~late], weights=weight[~late]))
    behind = float(np.average(estimate[late], weights=weight[late]))
    scatter = estimate - np.where(late, behind, before)
    freedom = len(estimate) - 2
    variance = float(weight @ scatter**2) / freedom
    of_late = 1.0 / weight[late].sum()
    of_early = 1.0 / weight[~late].sum()
    error = np.sqrt(variance * (of_late + of_early))
    size = before - behind  # an angle that is read too far is off by minus that
    ratio = abs(size) / max(float(error), ROUNDING)
    chance = 2.0 * float(stdtr(freedom, -ratio))
    return ZeroStep(joint, int(np.argmax(late)), size, chance)


def is_load(equations: RunEquations, step: ZeroStep, joints: int) -> bool:
    """Whether another load of the hand from that run on explains more, its numbers counted."""
    late = is_late(step.first, len(equations.left))
    load = list(range(joints, equations.normal.shape[1]))
    more = equations.evidence(load, late) - equations.evidence([step.joint], late)
    return more > 0.5 * (len(load) - 1) * np.log(equations.count)


def make_equations(compared: ComparedRuns) -> RunEquations:
    """The normal equations of all runs: zeros of the joints, then the load's mass and moments."""
    runs = compared.runs
    coefficients = fit(compared.sums.mean(axis=0), len(runs)).coefficients
    squares = []
    for run in runs:
        table = compared.tables.table(run)
        changes = changes_of(compared.arm, run)
        squares.append(beside_losses(table, run, coefficients, changes))
    left = np.array([square[:, -1, -1] for square in squares])
    moved_runs = np.maximum((left > 0.0).sum(axis=0), 1)
    usual = left.sum(axis=0) / moved_runs
    moves = usual > 0.0
    scale = np.where(moves, 1.0 / np.where(moves, usual, 1.0), 0.0)
    sums = np.einsum("rjcd,j->rcd", np.array(squares), scale)
    return RunEquations(
        sums[:, :-1, :-1],
        sums[:, :-1, -1],
        sums[:, -1, -1],
        int(moves.sum()),
    )


def changes_of(arm: ArmModel, run: RunStates) -> Float[Array, "n T c"]:
    """What each joint's torque changes by: zeros of joints that turn, a load of the hand."""
    zeros, _, _ = arm.derivatives(run.q, run.dq, run.ddq)
    turning = np.where(arm.sliding_joints, 0.0, 1.0)
    regressor = arm.regressor(run.q, run.dq, run.ddq)
    load = regressor[:, :, -PER_LINK:][:, :, OF_LOAD]
    changes = np.concatenate([zeros * turning, load], axis=-1)
    return np.asarray(changes.transpose(1, 0, 2))


def beside_losses(
    table: Float[Array, "n T k"],
    run: RunStates,
    coefficients: Float[Array, "n p"],
    changes: Float[Array, "n T c"],
) -> Float[Array, "n d d"]:
    """Inner products of changes, and last of what is left, beside losses of the run's own.

    Those of joints that stand are zero.
    """
    size = changes.shape[2] + 1
    squares = np.zeros((len(table), size, size))
    for joint, rows in enumerate(run.moves.T):
        if rows.sum() < FEWEST_STATES:
            continue
        columns = table[joint][rows]
        explained = columns[:, :-1] @ coefficients[joint]
        left = columns[:, -1] - explained
        whole = np.column_stack([changes[joint][rows], left])
        losses, _ = np.linalg.qr(columns[:, -1 - LOSSES : -1])
        whole = whole - losses @ (losses.T @ whole)
        squares[joint] = whole.T @ whole / rows.sum()
    return squares
