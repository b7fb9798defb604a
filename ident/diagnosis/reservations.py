"""Reasons to doubt: names that were not reported because no arm has such parameters, and replays that end far off."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.gap.replay import Replay
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.selection.agreement import measure_agreement
from ident.diagnosis.selection.gates import Named, first_of_each_joint
from ident.diagnosis.selection.name_probability import Estimate
from ident.diagnosis.selection.search import Search
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.tuned_links import TunedLink
from ident.effects.base import Interval, SessionContext, impossible
from ident.regression.design import Group


@dataclass(frozen=True, eq=False)
class Reservation:
    """A reason to doubt."""

    effect: str  # the effect that got no name for it; "" where it is about the replay or the URDF
    joints: tuple[str, ...]  # where
    reason: str  # in words
    parameters: dict[str, Interval]  # the parameters that the effect would have had
    # What it explains, where its parameters or their unevenness speak against the name and not against there being
    # something; None where it may as well be nothing.
    shows: Named | None = None

    @classmethod
    def of(cls, item: Named, estimate: Estimate, joints: Sequence[str], reason: str) -> Reservation:
        """About a name that was not believed."""
        shows = None if estimate.undefined else item
        return cls(item.group.effect.id, joints_of(item, joints), reason, estimate.parameters, shows)

    def to_dict(self) -> dict[str, Any]:
        return {
            "effect": self.effect or None,
            "joints": list(self.joints),
            "reason": self.reason,
            "parameters": {name: value.to_dict() for name, value in self.parameters.items()},
        }


def joints_of(item: Named, joints: Sequence[str]) -> tuple[str, ...]:
    """Names of the joint of an effect, or of those where one of the whole arm shows."""
    own = [item.group.joint] if item.group.effect.scope == "joint" else item.shown
    return tuple(joints[j] for j in own)


def find_implausible(candidates: Mapping[int, tuple[Named, Estimate]], session: SessionContext) -> dict[int, str]:
    """Which of some names can't be believed, and why.

    All whose parameters no arm has; else, of those that may be zero, at each joint the one of least evidence: two that
    say nearly the same leave each other open, and one alone may be sure.

    Args:
        candidates: Names with their parameters, by number.
        session: The runs.
    """
    outside, open_ones = {}, {}
    for k, (_, estimate) in candidates.items():
        effect = estimate.refined.effect
        if reason := impossible(effect, session, estimate.refined.joint, estimate.parameters):
            outside[k] = reason
        elif reason := estimate.undefined:
            open_ones[k] = reason
    if outside or not open_ones:
        return outside
    weakest = sorted(open_ones, key=lambda k: candidates[k][0].gates.evidence)
    kept = first_of_each_joint([(k, candidates[k][0].shown) for k in weakest])
    return {k: open_ones[k] for k in kept}


def find_uneven(
    search: Search, groups: Sequence[Group], asked: Sequence[int], hidden: Collection[int] = ()
) -> dict[int, str]:
    """At each joint the name whose size differs most from run to run, if one's does by much, and beyond chance.

    Args:
        search: The search that gave the names.
        groups: All names.
        asked: Which of them are tested; events, what grows in a run and what acts beyond a bound have no one size.
        hidden: Which of them tuned inertias hide, all or most of it.
    """
    held = search.settings
    effects = [group.effect for group in groups]
    constant = [k for k in asked if not (effects[k].event or effects[k].by_run or effects[k].beyond_bound)]
    found = {k: measure_agreement(search, groups, k, k in hidden) for k in constant}
    uneven = {k: one for k, one in found.items() if one.spread > held.most_uneven and one.p_value < held.uneven_chance}
    worst = sorted(uneven, key=lambda k: -uneven[k].spread)
    kept = first_of_each_joint([(k, groups[k].acts_on(search.evidence.layout.n)) for k in worst])
    return {
        k: f"its size differs between parts of the recordings by {100 * one.spread:.0f} %, from {one.least:.2g} to "
        f"{one.most:.2g} of what it is over all: a constant of the arm is the same in each"
        for k, one in ((k, uneven[k]) for k in kept)
    }


def doubt_links(links: Mapping[str, TunedLink]) -> tuple[Reservation, ...]:
    """One reservation about each link that tuning moved farther than URDFs are off."""
    wrong = [(link, one) for link, one in links.items() if one.beyond_tolerance]
    return tuple(Reservation("", (one.joint,), one.words(link), one.changes()) for link, one in wrong)


def doubt_replay(
    forward: Replay,
    series: Sequence[RunResidual],
    joints: Sequence[str],
    rms: Float[Array, " n"],
    floors: Float[Array, " n"],
    settings: DiagnosisSettings = USUAL,
) -> tuple[Reservation, ...]:
    """One reservation about the joints whose replay ends far off and whose torque is not explained down to its noise.

    Args:
        forward: The replay.
        series: Residuals of all runs, for the joints' speeds.
        joints: Names of the joints.
        rms: What the named effects leave on runs that the fit never saw [N m].
        floors: What nothing can go below [N m].
        settings: How far is far, and how loud is loud.
    """
    squares = sum(np.sum(np.where(item.counts, item.speed, 0.0) ** 2, axis=0) for item in series)
    counts = sum(item.counts.sum(axis=0) for item in series)
    way = forward.window * np.sqrt(squares / np.maximum(counts, 1))
    far = (
        (forward.windows > 0)
        & (forward.after > settings.gap.replay.far_share * way)
        & (rms > settings.verdict.loud * floors)
    )
    ends_far = [j for j, one in enumerate(far) if one]
    if not ends_far:
        return ()
    ends = ", ".join(f"{joints[j]} by {forward.after[j]:.2g} rad over a way of {way[j]:.2g} rad" for j in ends_far)
    reason = (
        f"replayed under the recorded torques for {1e3 * forward.window:.0f} ms, the motion ends off ({ends}): "
        "whatever is named, the model does not foretell this arm; check inertias, units and signs"
    )
    return (Reservation("", tuple(joints[j] for j in ends_far), reason, {}),)
