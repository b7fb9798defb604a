"""What the evidence amounts to: no gap, a name, part of one, none of the catalogue; and what else must be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from ident.arrays import Array, Bool, Float
from ident.diagnosis.gap.trees import Ceiling
from ident.diagnosis.regression.cross_validation import HeldOutScore
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.selection.gates import SearchResults
from ident.diagnosis.selection.prior_check import Tolerance
from ident.diagnosis.settings import USUAL_VERDICT, VerdictSettings


def find_floors(
    evidence: Evidence, ceilings: Sequence[Ceiling], last: HeldOutScore, settings: VerdictSettings = USUAL_VERDICT
) -> Float[Array, " n"]:
    """What no model of the state can go below, joint by joint [N m]: the noise, or the ceiling where it is higher."""
    ratio = np.array([c.rms / c.before if c.before > 0 and c.sure else 0.0 for c in ceilings])
    return np.minimum(np.maximum(settings.noise_margin * evidence.floor, ratio * last.rms), last.rms)


def stands_out(evidence: Evidence, last: HeldOutScore, joint: int, settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether more is left at a joint than its noise: else there is nothing for trees to explain."""
    return bool(last.rms[joint] ** 2 > (1.0 + settings.least_gap_share) * evidence.floor[joint] ** 2)


def find_unexplained(
    found: SearchResults,
    ceilings: Sequence[Ceiling],
    evidence: Evidence,
    settings: VerdictSettings = USUAL_VERDICT,
) -> tuple[Bool[Array, " n"], Float[Array, " n"]]:
    """At which joints more than noise is left, and the noise that their innovation speaks for [N m].

    Unexplained is what trees can learn; and, whether they can or not, an error over innovation (what can't be foretold
    from one sample to the next) far above that of the middle joint, or far above the noise.
    """
    whitening, moved = evidence.whitening, evidence.weights.sum(axis=0) > 0
    typical = np.minimum(found.ladder[-1].rms, found.ladder[-1].typical_rms)
    colour = typical / np.maximum(whitening.innovation, 1e-12)
    usual = float(np.median(colour[moved])) if moved.any() else 1.0  # a joint that stands still says nothing of noise
    learnt = [c.sure and 1.0 - (c.rms / max(c.before, 1e-12)) ** 2 > settings.least_gap_share for c in ceilings]
    # What all joints have in excess is the noise's estimate, up to a point.
    excess = (typical / np.maximum(evidence.floor, 1e-12)) ** 2
    shared = max(float(np.median(excess[moved])), 1.0) if moved.any() else 1.0
    much = excess > min(settings.much_left * shared, settings.far_left)
    varying = varying_at_most(evidence, moved, settings)
    beyond = typical**2 > whitening.level**2 + varying
    left = moved & (np.array(learnt) | (beyond & ((colour > settings.stands_out * usual) | much)))
    return left, np.minimum(evidence.floor, usual * whitening.innovation)


def varying_at_most(
    evidence: Evidence, moved: Bool[Array, " n"], settings: VerdictSettings = USUAL_VERDICT
) -> Float[Array, " n"]:
    """Upper end of the 95 % interval of what friction's variation leaves at each joint that moved [N² m²].

    A joint's variance is known from so many stretches only; the arm's other joints vary alike, and speak for as many
    stretches more (a scaled inverse χ² prior: Gelman et al. 2013, section 2.6). A stretch that was left out lies apart
    from the mean of the others.
    """
    stretches = max(len(np.unique(evidence.friction.stretch)), 2)
    spread = np.maximum(evidence.spread, 1e-9)
    usual = float(np.median(spread[moved])) if moved.any() else 1.0
    known = settings.alike_stretches + stretches - 1
    pooled = (settings.alike_stretches * (usual / spread) ** 2 + stretches - 1) / known
    lowest = 2.0 * float(gammaincinv(0.5 * known, settings.sure_side))  # quantile of χ²
    most = known / lowest * stretches / (stretches - 1)
    return np.asarray(most * pooled * evidence.friction_noise**2)


def decide(
    found: SearchResults,
    left: Bool[Array, " n"],
    floors: Float[Array, " n"],
    tolerance: Tolerance,
    settings: VerdictSettings = USUAL_VERDICT,
) -> str:
    """How much of the gap at the joints in question the names close, above the noise."""
    if not found.named:
        return "none_of_catalogue" if left.any() or tolerance.exceeded or found.hint else "no_gap"
    joints = left.copy()
    for item in found.named:
        joints[item.shown] = True
    start, end = found.ladder[0].rms[joints] ** 2, found.ladder[-1].rms[joints] ** 2
    unit = np.maximum(floors[joints], 1e-9) ** 2
    share = float(np.sum((start - end) / unit) / max(np.sum(np.maximum(start - unit, 0.0) / unit), 1e-12))
    if any(item.absorbed for item in found.named) and not left.any():
        share = 1.0  # held-out errors of the tuned model can't judge what tuning absorbs
    if share >= settings.named_from:
        return "partial" if tolerance.exceeded else "named"
    return "partial" if share >= settings.partial_from else "none_of_catalogue"


@dataclass(frozen=True)
class Nearest:
    """The candidate that came nearest to a name.

    Attributes:
        effect: Its id.
        joints: Where it shows most.
        p_value: Family-wise, of the sign-flip test.
        evidence: Log evidence [nats].
        rms_fall: Largest share by which a joint's held-out error would fall.
    """

    effect: str
    joints: tuple[str, ...]
    p_value: float
    evidence: float
    rms_fall: float

    def to_dict(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "p_value": self.p_value,
            "log_evidence": self.evidence,
            "rms_fall": self.rms_fall,
        }


def find_nearest(found: SearchResults, joints: Sequence[str]) -> Nearest | None:
    """The candidate that came nearest to a name, where chance alone doesn't explain it, and where it shows most."""
    if found.named or found.hint is None:
        return None
    item = found.hint
    own = item.group.effect.rows == "own"
    most = item.group.joint if own else int(np.argmax(1.0 - item.after.rms / np.maximum(item.before.rms, 1e-12)))
    gates = item.gates
    return Nearest(item.group.effect.id, (joints[most],), gates.p_value, gates.evidence, gates.rms_fall)


def above_noise(gap: Mapping[str, Any], settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether a joint's error, as the record of its gap tells it, lies clearly above its noise."""
    return bool(gap["rms_Nm"] > settings.loud * (gap["noise_floor_Nm"] or np.inf))
