"""Decision rules: from search results to a verdict, and the size of unexplained residuals.

In: held-out scores, noise floors and discrepancies of each joint, and the estimates. Out: one of `no_gap`, `named`,
`partial`, `none_of_catalogue`; the unexplained residual of each joint; the effects' probabilities discounted by how
well a discrepancy (a flexible function of the joint's state) explains the same torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.gap.ceiling import Ceiling
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.selection.name_probability import Estimate
from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.diagnosis.selection.tolerance import Tolerance
from ident.diagnosis.settings import USUAL_VERDICT, VerdictSettings
from ident.regression.cross_validation import HeldOutScore
from ident.regression.gram import Evidence
from ident.regression.posterior import Beside


def find_floors(
    evidence: Evidence, ceilings: Sequence[Ceiling], last: HeldOutScore, settings: VerdictSettings = USUAL_VERDICT
) -> Float[Array, " n"]:
    """Floor of each joint's error [N m]: its noise, or its ceiling where that is significant and higher."""
    ratio = np.array([c.ratio * c.significant for c in ceilings])
    return np.minimum(np.maximum(settings.noise_margin * evidence.floor, ratio * last.rms), last.rms)


@dataclass(frozen=True, eq=False)
class ResidualExcess:
    """Residual of each joint beyond noise and the between-run variation of friction."""

    leftover: Float[Array, " n"]  # unexplained residual in units of its threshold; above 1 it is significant
    noise: Float[Array, " n"]  # noise by the joint's innovation variance [N m]

    @property
    def present(self) -> Bool[Array, " n"]:
        """Joints with a significant unexplained residual."""
        return self.leftover > 1.0


def find_unexplained(
    found: SearchResults,
    ceilings: Sequence[Ceiling],
    evidence: Evidence,
    settings: VerdictSettings = USUAL_VERDICT,
    law_share: float = USUAL_SELECTION.least_own_share,
) -> ResidualExcess:
    """The unexplained residual of each joint, in units of its threshold.

    It is the larger of two measures. One is what a discrepancy explains. The other is the error over the innovation
    (the part that past samples do not predict), if it is far above that of the median joint, or over the noise. The
    run's own level of friction does not count, for it varies; nor does `law_share` of the mean square that accepted
    effects closed, for no real law is exactly the catalogue's.

    Args:
        found, ceilings, evidence: Accepted effects; what a discrepancy explains at each joint; the noise.
        settings, law_share: Thresholds, and the share of an effect's mean square that its law may leave.
    """
    whitening, moved = evidence.whitening, evidence.weights.sum(axis=0) > 0
    last, steady = found.ladder[-1], np.array([ceiling.before for ceiling in ceilings])
    misfit = law_share * np.maximum(found.ladder[0].rms ** 2 - last.rms**2, 0.0)
    typical = np.sqrt(np.maximum(np.minimum.reduce([last.rms, last.typical_rms, steady]) ** 2 - misfit, 0.0))
    colour = typical / np.maximum(whitening.innovation, 1e-12)
    usual = float(np.median(colour[moved])) if moved.any() else 1.0
    seen = np.array([c.significant * (c.before**2 - c.rms**2) for c in ceilings])
    learnt = np.maximum(seen - misfit, 0.0) / np.maximum(steady**2, 1e-24)
    # An excess that all joints share is an error of the noise estimate, up to a point.
    excess = (typical / np.maximum(evidence.floor, 1e-12)) ** 2
    shared = max(float(np.median(excess[moved])), 1.0) if moved.any() else 1.0
    much = excess / min(settings.much_left * shared, settings.far_left)
    exceedance = np.maximum(colour / max(settings.stands_out * usual, 1e-12), much)
    beyond = typical**2 / np.maximum((1.0 + settings.least_gap_share) * whitening.level**2, 1e-24)
    leftover = np.maximum(learnt / settings.least_gap_share, np.minimum(beyond, exceedance))
    return ResidualExcess(np.where(moved, leftover, 0.0), np.minimum(evidence.floor, usual * whitening.innovation))


def decide(
    found: SearchResults,
    names: Sequence[Estimate],
    left: Bool[Array, " n"],
    floors: Float[Array, " n"],
    tolerance: Tolerance,
    given: tuple[Float[Array, " n"], Float[Array, " n"]],
    settings: VerdictSettings = USUAL_VERDICT,
) -> str:
    """The verdict, by the share of the gap above noise that accepted effects close at the joints in question.

    The share is computed with tuned inertias and with the URDF's, and the larger one counts: a cause that tuning
    absorbs in part is credited with what it explains of the user's model. However much is closed, a joint with a
    significant unexplained residual that no likely effect is named at has a gap without a name. What tuned inertias
    hide counts where it is loud beside the floor: long recordings show any link to be off.

    Args:
        found, names: Search results, and the estimates with discounted probabilities.
        left: Joints with a significant unexplained residual.
        floors: Floor of each joint's error [N m].
        tolerance: Whether tuned inertias exceed the URDF's tolerance.
        given: Held-out errors with the URDF's inertias, without and with the effects [N m].
        settings: Shares that separate the verdicts.
    """
    hidden = tolerance.exceeded and bool(np.any(tolerance.torque > np.sqrt(settings.loud**2 - 1.0) * floors))
    if not found.accepted:
        return "none_of_catalogue" if left.any() or hidden or found.near_miss else "no_gap"
    joints, unnamed = left.copy(), left.copy()
    for item, name in zip(found.accepted, names, strict=True):
        joints[item.affected_joints] = True
        unnamed[item.named_joints] &= name.class_probability < settings.even_odds
    tuned = found.ladder[0].rms, found.ladder[-1].rms
    unit = np.maximum(floors[joints], 1e-9) ** 2
    # Mean squares in units of the floor, so that joints of different size add up.
    pairs = [(start[joints] ** 2 / unit, end[joints] ** 2 / unit) for start, end in (tuned, given)]
    share = max(float((old - new).sum() / max(np.maximum(old - 1.0, 0.0).sum(), 1e-12)) for old, new in pairs)
    if any(item.absorbed or item.group.effect.event for item in found.accepted) and not left.any():
        share = 1.0  # held-out error shows neither what tuning absorbs nor what happens once, at rest
    if share >= settings.named_from and not hidden and not unnamed.any():
        return "named"
    return "partial" if max(one.class_probability for one in names) >= settings.even_odds else "none_of_catalogue"


def discount_by_discrepancy(
    estimates: Sequence[Estimate], laws: Sequence[Beside], settings: VerdictSettings = USUAL_VERDICT
) -> list[Estimate]:
    """Estimates with probabilities discounted, and intervals widened, by what a discrepancy explains of the torque.

    The discount depends on the log Bayes factor that the law adds to the discrepancy alone, and on what the discrepancy
    still explains beside it; if that is much, the law's parameters compensate for some of it, and their intervals
    widen.

    Args:
        estimates, laws: The estimates, and for each the evidence of its law beside a discrepancy.
        settings: Parameters of the discount.
    """
    return [
        replace(
            one,
            probability=settings.trust(law) * one.probability,
            parameters={name: each.wider(settings.widening(law)) for name, each in one.parameters.items()},
        )
        for one, law in zip(estimates, laws, strict=True)
    ]


def score_outside(verdict: str, estimates: Sequence[Estimate], closed: float, leftover: Float[Array, " n"]) -> float:
    """Score from 0 to 1 of a cause outside the catalogue, for ranking sessions; it is no probability.

    Args:
        verdict, estimates: The verdict, and the estimates with discounted probabilities.
        closed, leftover: Share of the gap that the effects close, and unexplained residual of each joint.
    """
    most = float(leftover.max(initial=0.0))
    if estimates:
        explained = 1.0 if verdict == "named" else float(np.clip(closed, 0.0, 1.0))
        return 1.0 - explained * max(one.class_probability for one in estimates) / max(most, 1.0)
    open_share = most / (1.0 + most)
    return max(open_share, 0.5) if verdict == "none_of_catalogue" else min(open_share, 0.5)


def find_nearest(found: SearchResults, joints: Sequence[str]) -> dict[str, Any] | None:
    """Record of the best rejected candidate, if nothing was accepted and it is unlikely to be chance."""
    if found.accepted or found.near_miss is None:
        return None
    item = found.near_miss
    own = item.group.effect.rows == "own"
    most = item.group.joint if own else int(np.argmax(item.after.fall_from(item.before)))
    criteria = item.criteria
    return {
        "effect": item.group.effect.id,
        "joints": [joints[most]],
        "log_evidence": criteria.log_evidence,
        "rms_fall": criteria.rms_fall,
    }


def above_noise(gap: Mapping[str, Any], settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether a joint's error, as a diagnosis records its gap, is clearly above its noise."""
    return bool(gap["rms_Nm"] > settings.loud * (gap["noise_floor_Nm"] or np.inf))
