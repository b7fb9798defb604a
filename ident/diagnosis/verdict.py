"""What the evidence amounts to: no gap, a name, part of one, none of the catalogue; and what else must be reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.gap.ceiling import Ceiling
from ident.diagnosis.selection.gates import SearchResults
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
    """What no model of the state can go below, joint by joint [N m]: the noise, or the ceiling where it is higher."""
    ratio = np.array([c.rms / c.before if c.before > 0 and c.sure else 0.0 for c in ceilings])
    return np.minimum(np.maximum(settings.noise_margin * evidence.floor, ratio * last.rms), last.rms)


def stands_out(evidence: Evidence, last: HeldOutScore, joint: int, settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether more is left at a joint than its noise: else there is nothing to explain."""
    return bool(last.rms[joint] ** 2 > (1.0 + settings.least_gap_share) * evidence.floor[joint] ** 2)


@dataclass(frozen=True, eq=False)
class Unexplained:
    """What is left at each joint, beside what noise and friction that varies would leave."""

    leftover: Float[Array, " n"]  # how far it stands out; above 1 something is there that has no name
    noise: Float[Array, " n"]  # the noise that the joint's innovation speaks for [N m]

    @property
    def left(self) -> Bool[Array, " n"]:
        """Where more than noise is left."""
        return self.leftover > 1.0


def find_unexplained(
    found: SearchResults,
    ceilings: Sequence[Ceiling],
    evidence: Evidence,
    settings: VerdictSettings = USUAL_VERDICT,
    law_share: float = USUAL_SELECTION.least_own_share,
) -> Unexplained:
    """At which joints more than noise is left, and how far it stands out.

    Unexplained is what a discrepancy sees; and, whether it does or not, an error over innovation (what can't be
    foretold from one sample to the next) far above that of the middle joint, or far above the noise. What goes with a
    run's own level of friction doesn't count: that varies. Neither does `law_share` of the mean square that the names
    closed: no arm obeys a law to the letter, and for what is smaller no second name is given either.
    """
    whitening, moved = evidence.whitening, evidence.weights.sum(axis=0) > 0
    last, steady = found.ladder[-1], np.array([ceiling.before for ceiling in ceilings])
    misfit = law_share * np.maximum(found.ladder[0].rms ** 2 - last.rms**2, 0.0)
    typical = np.sqrt(np.maximum(np.minimum.reduce([last.rms, last.typical_rms, steady]) ** 2 - misfit, 0.0))
    colour = typical / np.maximum(whitening.innovation, 1e-12)
    usual = float(np.median(colour[moved])) if moved.any() else 1.0  # a joint that stands still says nothing of noise
    seen = np.array([c.sure * (c.before**2 - c.rms**2) for c in ceilings])
    learnt = np.maximum(seen - misfit, 0.0) / np.maximum(steady**2, 1e-24)
    # What all joints have in excess is the noise's estimate, up to a point.
    excess = (typical / np.maximum(evidence.floor, 1e-12)) ** 2
    shared = max(float(np.median(excess[moved])), 1.0) if moved.any() else 1.0
    much = excess / min(settings.much_left * shared, settings.far_left)
    standing = np.maximum(colour / max(settings.stands_out * usual, 1e-12), much)
    beyond = typical**2 / np.maximum((1.0 + settings.least_gap_share) * whitening.level**2, 1e-24)
    leftover = np.maximum(learnt / settings.least_gap_share, np.minimum(beyond, standing))
    return Unexplained(np.where(moved, leftover, 0.0), np.minimum(evidence.floor, usual * whitening.innovation))


def decide(
    found: SearchResults,
    names: Sequence[Estimate],
    left: Bool[Array, " n"],
    floors: Float[Array, " n"],
    tolerance: Tolerance,
    given: tuple[Float[Array, " n"], Float[Array, " n"]],
    settings: VerdictSettings = USUAL_VERDICT,
) -> str:
    """How much of the gap at the joints in question the names close, above the noise.

    It is counted from the tuned model and from the model as given, and the larger share counts: a cause that tuning
    hides in part is named for what it explains of the user's model.

    Args:
        found, names: What the search found, and the names as far as they are believed.
        left: Where more than noise is left beside them.
        floors: What nothing can go below, joint by joint [N m].
        tolerance: Whether the inertias were tuned beyond what URDFs are wrong by.
        given: Held-out errors of the model with the URDF's inertias, without and with the names [N m].
        settings: Which share is which verdict.
    """
    if not found.named:
        return "none_of_catalogue" if left.any() or tolerance.exceeded or found.hint else "no_gap"
    joints = left.copy()
    for item in found.named:
        joints[item.shown] = True
    tuned = found.ladder[0].rms, found.ladder[-1].rms
    unit = np.maximum(floors[joints], 1e-9) ** 2
    # Each joint's mean square in units of its noise.
    pairs = [(start[joints] ** 2 / unit, end[joints] ** 2 / unit) for start, end in (tuned, given)]
    share = max(float((old - new).sum() / max(np.maximum(old - 1.0, 0.0).sum(), 1e-12)) for old, new in pairs)
    if any(item.absorbed for item in found.named) and not left.any():
        share = 1.0  # held-out errors of the tuned model can't judge what tuning absorbs
    if share >= settings.named_from and not tolerance.exceeded:
        return "named"
    return "partial" if max(one.class_probability for one in names) >= settings.even_odds else "none_of_catalogue"


def believed(
    estimates: Sequence[Estimate], laws: Sequence[Beside], settings: VerdictSettings = USUAL_VERDICT
) -> list[Estimate]:
    """Names as far as they are believed: by what each adds to a flexible function, and what that still finds beside it.

    What is open elsewhere says nothing of a name. Where a flexible function still finds much beside a law, its
    parameters make up for some of that: their intervals widen.

    Args:
        estimates, settings: The names' estimates, and by what they are believed.
        laws: What each is worth beside a discrepancy.
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
    """How much speaks for a cause that the catalogue lacks, from 0 to 1: to rank sessions by, no probability.

    Args:
        verdict, estimates: The verdict, and the names as far as they are believed, each with its class.
        closed: Share of the gap that they close.
        leftover: How far what is left stands out at each joint.
    """
    most = float(leftover.max(initial=0.0))
    if estimates:
        explained = 1.0 if verdict == "named" else float(np.clip(closed, 0.0, 1.0))
        return 1.0 - explained * max(one.class_probability for one in estimates) / max(most, 1.0)
    open_share = most / (1.0 + most)
    return max(open_share, 0.5) if verdict == "none_of_catalogue" else min(open_share, 0.5)


def find_nearest(found: SearchResults, joints: Sequence[str]) -> dict[str, Any] | None:
    """The candidate that came nearest to a name, where chance alone doesn't explain it, and where it shows most."""
    if found.named or found.hint is None:
        return None
    item = found.hint
    own = item.group.effect.rows == "own"
    most = item.group.joint if own else int(np.argmax(item.after.fall_from(item.before)))
    gates = item.gates
    return {
        "effect": item.group.effect.id,
        "joints": [joints[most]],
        "log_evidence": gates.evidence,
        "rms_fall": gates.rms_fall,
    }


def above_noise(gap: Mapping[str, Any], settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether a joint's error, as the record of its gap has it, lies clearly above its noise."""
    return bool(gap["rms_Nm"] > settings.loud * (gap["noise_floor_Nm"] or np.inf))
