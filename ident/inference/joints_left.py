"""What is left at each joint beside the named effects, in numbers that carry over between arms.

A second calibration turns them into the probability that something without a name is left there.
What drives a whole arm's error (friction that drifts, a coarse encoder, a loose loop) is at all its
joints; a cause at one of them stands out beside the others. So each joint is told by what is left
there and by how far that is above the others' median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.inference.infer import Inferred
from ident.inference.revision import discrepancy_at
from ident.inference.scales import signed_log, squashed
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group

# Features that are compared with those of the arm's other joints.
COMPARED = (
    "log_smooth_nats",
    "log_smooth_nats_a_row",
    "smooth_share",
    "log_dispersion",
    "log_left_over_noise",
    "log_friction_spread",
)
BESIDE = "_beside_others"


@dataclass(frozen=True)
class Repeated:
    """What the same angles of other runs predict of what is left at a joint: a function of the
    state, too, though no smooth one.

    Attributes:
        share: Share of the residual squares, at most 1; below 0 where the prediction is worse than
            none.
        error: Its standard error over parts of the session.
    """

    share: float
    error: float


NOT_TESTED = Repeated(0.0, 1.0)
"""Where too little is there to look for what repeats."""


@dataclass(frozen=True, eq=False)
class JointLeft:
    """What is left at a joint beside the chosen effects."""

    joint: int
    features: Mapping[str, float]
    kind: str | None  # block of the discrepancy that explains most: state, memory, time or coupling

    @property
    def share(self) -> float:
        """Share of the joint's squares that its discrepancy explains."""
        return self.features["smooth_share"]

    def with_repeated(self, repeated: Repeated) -> JointLeft:
        """The same with what repeats by the angle among the features."""
        share = max(repeated.share, 0.0)
        again = {
            "repeated_share": share,
            "repeated_in_errors": squashed(share, repeated.error),
        }
        return replace(self, features={**self.features, **again})


def describe_joints(fine: Inferred, names: Sequence[Group], tuned: HeldOut) -> list[JointLeft]:
    """What is left at each joint that has rows, beside some of the chosen effects.

    Discrepancies are estimated beside these alone: what an unlikely effect explains is open.

    Args:
        fine: The set on fine grids.
        names: Those of its effects that are likelier than not.
        tuned: Scores of models on parts that a fit never saw, by the set's variances.
    """
    model = fine.model
    evidence = model.sums.evidence
    with_rows = [j for j in range(evidence.layout.n) if evidence.samples[j] >= 1.0]
    warm = len(names) == len(fine.chosen)
    variances = {}
    nats_of_smooth = {}
    for j in with_rows:
        variances[j], nats_of_smooth[j] = discrepancy_at(model, j, names, warm=warm)
    beside = model.with_discrepancy(variances)
    residual = beside.residual(names)
    smooth_share = beside.smooth_share(names)
    score = tuned.score(names)
    alone = tuned.score()
    left = []
    for j in with_rows:
        rows = evidence.samples[j]
        level = max(float(evidence.whitening.level[j]), 1e-12)
        of_joints = [group for group in names if group.effect.rows == "own"]
        here = [group for group in of_joints if group.joint == j]
        dispersion = model.components.dispersion[j] * max(residual.mean_square[j], 1.0)
        left_over = max(float(score.rms[j]), 1e-12)
        left_alone = max(float(alone.rms[j]), 1e-12)
        features = {
            "log_smooth_nats": signed_log(nats_of_smooth[j]),
            "log_smooth_nats_a_row": float(np.log1p(1e3 * nats_of_smooth[j] / rows)),
            "smooth_share": float(smooth_share[j]),
            "log_dispersion": float(np.log(dispersion)),
            "log_left_over_noise": float(np.log(left_over / level)),
            "log_before_over_noise": float(np.log(left_alone / level)),
            "log_friction_spread": float(np.log(model.components.friction[j])),
            "names_here": float(len(here)),
            "names_a_joint": len(names) / evidence.layout.n,
            "log_rows": float(np.log(rows)),
        }
        here_left = JointLeft(j, features, residual.kind_of(j))
        left.append(here_left.with_repeated(NOT_TESTED))
    return left


def beside_others(joints: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Each joint's features, with how far they are above the median of the arm's other joints.

    Args:
        joints: Features of all joints that have rows.

    Returns:
        New dicts in the same order; the differences are 0 for an only joint.
    """
    table = np.array([_compared(features) for features in joints])
    compared = []
    for k, features in enumerate(joints):
        others = np.delete(table, k, axis=0)
        above = np.zeros(len(COMPARED))
        if len(others):
            above = table[k] - np.median(others, axis=0)
        differences = {}
        for name, difference in zip(COMPARED, above, strict=True):
            differences[f"{name}{BESIDE}"] = float(difference)
        compared.append({**features, **differences})
    return compared


def _compared(features: Mapping[str, float]) -> list[float]:
    """Those of a joint's features that are compared with other joints'."""
    return [features[name] for name in COMPARED]
