"""Whether the model of one set foretells the other.

The verdict rests on it, whatever law is named or none.

With the model solved on one set alone, let m_p be the mean square that it leaves of part p of the
other set, in units of its noise, what its coefficients are unsure of, and friction as it varies
from run to run: rᵀV⁻¹r a row. Three such means are compared, as logarithms: a_p across the sets,
b_p of the same rows by the model of the other parts of their own set, and c_q of the parts of the
first set by the others of that. If nothing changed, then neither

    mean(a) − mean(c)    nor    mean(a − b)

is more than the scatter between parts makes it: the first fails where the arm changed, or moves
where its model is worse; the second where the arm changed, or its own parts are more alike. So a
change is where both are beyond chance, and the less certain of them decides. Both directions are
tested at each joint, for a set that moves little may foretell nothing and yet be foretold. Friction
of another day differs; what that may do by chance counts as expected.

Parts of one arm differ by more than noise does, and a model of few of them foretells others badly
though nothing changed. How much the first difference is then is told by sets of permuted parts
(`permuted_sets`), half of either side each, beside the likeliest set of changes: it counts from
their mean on, and is at least as uncertain as they scatter.

Source: Fisher 1935 (permutations); Chow 1960 (a model of one sample tested by its predictions of
another); Bartlett and Kendall 1946 (log variances compared as means); Berger 1982 (a claim that
needs two tests has the larger p-value).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import polygamma
from scipy.stats import t as student

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.models_of_parts import PartModels, PartSums, SolvedModel
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.settings import CHANGE
from ident.records import JsonRecord
from ident.regression.design import Group

# Tests of each joint: two directions, with friction free within its usual variation and the same in
# all runs.
WAYS = 4


@dataclass(frozen=True)
class ForetoldJoint:
    """A joint of which the model of one set does not foretell the other."""

    joint: str  # its name
    error: float  # error of one set by the model of the other [N m]
    usual: float  # what of that the sets' own runs leave, foretold by each other [N m]
    # Root mean square of the error across the sets over that within them, each over what it should
    # be.
    ratio: float
    low: float  # 95 % interval of that
    high: float
    p_value: float  # corrected for the number of joints and directions
    # Whether the later set is not foretold by the earlier one; else the earlier by the later.
    forwards: bool

    def to_dict(self) -> JsonRecord:
        """Its record.

        Returns:
            `joint`, `error_Nm`, `usual_Nm`, `ratio` with `low` and `high`, `p_value`, and
            `direction` (`later_by_earlier` or `earlier_by_later`).
        """
        return {
            "joint": self.joint,
            "error_Nm": self.error,
            "usual_Nm": self.usual,
            "ratio": self.ratio,
            "low": self.low,
            "high": self.high,
            "p_value": self.p_value,
            "direction": "later_by_earlier" if self.forwards else "earlier_by_later",
        }


class _Logs(NamedTuple):
    """Logarithms of mean squares by part and joint, and of the rows behind them."""

    across: Float[Array, "k n"]  # of one set by the other's model
    within: Float[Array, "k n"]  # of the same parts by the model of their own set's others
    home: Float[Array, "m n"]  # of the model's own set, each part by the others


class _Test(NamedTuple):
    """Rise of a joint's logarithm across the sets."""

    rise: float
    reach: float  # half-width of its 95 % interval
    p_value: float  # of this joint alone


def find_unforetold(
    design: PairedDesign, changes: Sequence[Group] = ()
) -> tuple[ForetoldJoint, ...]:
    """The joints of which one set's model does not foretell the other.

    Args:
        design: Both sets of runs.
        changes: The likeliest set of changes, beside which permuted parts differ by chance alone.

    Returns:
        In the joints' order; empty where a set has one part only.
    """
    spread = design.sums.evidence.spread
    counts = design.sides.counts
    of_runs = sum(1.0 / count for count in counts)
    between = CHANGE.day_to_day**2 + spread**2 * of_runs
    sums = PartSums(design)
    parts_later = int(sums.later.sum())
    parts_earlier = int((~sums.later).sum())
    if min(parts_later, parts_earlier) < 2:
        return ()
    # What friction of another day may do by chance; its two levels have a χ² of two degrees of
    # freedom.
    most = spread**2 - 2.0 * np.log(CHANGE.risen_by_chance) * between
    free = PartModels(sums, np.sqrt(spread**2 + between))
    alike = PartModels(sums, spread)
    surest: dict[int, ForetoldJoint] = {}
    for models, within, across in ((free, None, None), (alike, spread**2, most)):
        permuted = replace(models, sums=PartSums(design, tuple(changes)))
        for j, joint in _unforetold_of(models, permuted, within, across):
            if j not in surest or joint.p_value < surest[j].p_value:
                surest[j] = joint
    return tuple(surest[j] for j in sorted(surest))


def _unforetold_of(
    models: PartModels,
    permuted: PartModels,
    within: Float[Array, " n"] | None,
    across: Float[Array, " n"] | None,
) -> list[tuple[int, ForetoldJoint]]:
    """The joints that one of two ways to count friction shows, with their indices.

    Args:
        models: Models of parts of both sets.
        permuted: The same with what changed.
        within, across: Variance of friction within a set, and across the sets; None where it is
            free in the sums.
    """
    sums = models.sums
    joints = sums.design.baseline.nominal.joint_names
    sets = {side: sums.later == side for side in (False, True)}
    home = {side: models.left_out(sets[side], within) for side in sets}
    # What changed may be more than both sets' common laws can be: then its own set foretells it by
    # nothing but itself.
    best_home: dict[bool, Float[Array, "k n"]] = {}
    for side, logs in home.items():
        best_home[side] = np.minimum(logs, models.left_out(sets[side], within, free=True))
    seen = sums.seen
    tests_made = WAYS * len(seen)
    # What permuted sets say; only needed where something is beyond chance.
    usual: Float[Array, "h n"] | None = None
    unforetold: list[tuple[int, ForetoldJoint]] = []
    for forwards in (True, False):
        model = models.solve(sets[not forwards])
        other = models.left(model, sets[forwards], across)
        of_direction = _Logs(other, best_home[forwards], home[not forwards])
        tests = _test(of_direction, sums.rows, seen)
        if any(tests_made * test.p_value < CHANGE.risen_by_chance for test in tests):
            usual = permuted.permuted_rises(within) if usual is None else usual
            tests = _test(of_direction, sums.rows, seen, usual)
        error = _error(sums.design, model, forwards)
        for j, test in zip(seen.tolist(), tests, strict=True):
            p_value = min(1.0, tests_made * test.p_value)
            if p_value < CHANGE.risen_by_chance:
                joint = _as_unforetold(joints[j], float(error[j]), test, p_value, forwards)
                unforetold.append((j, joint))
    return unforetold


def _as_unforetold(
    joint: str, error: float, test: _Test, p_value: float, forwards: bool
) -> ForetoldJoint:
    """A joint with its error [N m], and with the ratio of roots of mean squares that a test tells.

    A rise of a logarithm of squares by x is a ratio of roots of exp(x / 2).
    """
    ends = test.rise + test.reach * np.array([0.0, -1.0, 1.0])
    ratio, low, high = np.exp(0.5 * ends).tolist()
    return ForetoldJoint(joint, error, error / ratio, ratio, low, high, p_value, forwards)


def _test(
    logs: _Logs,
    rows: Float[Array, "K n"],
    seen: Int[Array, " s"],
    usual: Float[Array, "h n"] | None = None,
) -> list[_Test]:
    """The less certain of both differences, at each joint seen.

    The variance between parts is that within the sets: the joint's own or the mean of all joints,
    whichever is more, and at least that of a mean square of so many rows.

    Args:
        logs, rows, seen: Logarithms of mean squares, rows of each part and joint, and the joints.
        usual: Rises between permuted sets, by set and joint; none if None.
    """
    across, within, home = (log[:, seen] for log in logs)
    freedom = len(across) + len(home) - 2
    of_within = len(within) * within.var(axis=0)
    of_home = len(home) * home.var(axis=0)
    scatter = (of_within + of_home) / freedom
    least = polygamma(1, 0.5 * rows[:, seen]).mean(axis=0)
    variance = np.maximum(np.maximum(scatter, scatter.mean()), least)
    over_home = across.mean(axis=0) - home.mean(axis=0)
    over_home_square = variance * (1.0 / len(across) + 1.0 / len(home))
    over_within = (across - within).mean(axis=0)
    over_within_square = variance * (2.0 / len(across))
    if usual is not None:
        permuted = usual[:, seen]
        over_home = over_home - np.maximum(permuted.mean(axis=0), 0.0)
        by_permutation = permuted.var(axis=0)
        at_least = np.maximum(by_permutation, by_permutation.mean())
        over_home_square = np.maximum(over_home_square, at_least)
    pooled = freedom * len(seen)
    quantile = float(student.ppf(0.975, pooled))
    tested = []
    for rise, square in ((over_home, over_home_square), (over_within, over_within_square)):
        error = np.sqrt(square + CHANGE.usual_rise**2)
        tested.append((rise, quantile * error, student.sf(rise / error, pooled)))
    values = np.array(tested)
    worst = values[:, 2].argmax(axis=0)
    tests = []
    for k, number in enumerate(worst.tolist()):
        rise, reach, p_value = values[number, :, k].tolist()
        tests.append(_Test(rise, reach, p_value))
    return tests


def _error(design: PairedDesign, model: SolvedModel, later: bool) -> Float[Array, " n"]:
    """Root mean square of what a model leaves of one of the sets, joint by joint [N m]."""
    evidence = design.sums.evidence
    layout = evidence.layout
    error = np.zeros(layout.n)
    folds = design.sides.later_folds == later
    for j, local in enumerate(layout.local):
        is_torque = local == layout.size
        inside = np.flatnonzero((local < layout.tuned) | is_torque)
        coefficient = np.minimum(local[inside], layout.tuned - 1)
        weights = np.where(is_torque[inside], 1.0, model.weights[coefficient])
        sums = evidence.plain[j].part(inside)[folds].sum(axis=0)
        square = max(float(weights @ sums @ weights), 0.0)
        rows = max(float(evidence.weights[folds, j].sum()), 1e-300)
        error[j] = np.sqrt(square / rows)
    return error
