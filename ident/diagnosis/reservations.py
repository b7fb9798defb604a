"""Reservations: rejected effects, links that tuning moved too far, replays that end far off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.gap.replay import Replay
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.tuned_links import TunedLink
from ident.effects.base import Interval
from ident.inference.conclusion import Named
from ident.inference.estimate import Reason
from ident.records import JsonRecord

# Reasons that a sentence holds at most; the record has all of them.
REASONS_TOLD = 2


@dataclass(frozen=True, eq=False)
class Reservation:
    """A reason to doubt the diagnosis."""

    effect: str  # id of the rejected effect; "" where it is about the replay or the URDF
    joints: tuple[str, ...]  # names of the joints concerned
    reason: str  # the reason as a sentence
    parameters: dict[str, Interval]  # parameters of the rejected effect
    probability: float | None = None  # of an effect that was weighed
    reasons: tuple[Reason, ...] = ()  # why it has this probability, the largest first

    @classmethod
    def unlikely(cls, name: Named, joints: Sequence[str]) -> Reservation:
        """The reservation about an unlikely effect, with what speaks against it.

        Args:
            name: The effect.
            joints: Names of the arm's joints.
        """
        estimate = name.estimate
        against = [reason.what for reason in estimate.reasons if reason.weight < 0.0][:REASONS_TOLD]
        words = " and ".join(against) or "nothing speaks for it"
        where = joints_of(name, joints)
        probability = estimate.class_probability
        return cls(
            name.group.effect.id, where, words, estimate.parameters, probability, estimate.reasons
        )

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            `effect` (None where it is about none), `joints`, `reason`, `parameters` (intervals by
            name); for an unlikely effect also `probability` and `reasons`.
        """
        weighed = {}
        if self.probability is not None:
            reasons = [reason.to_dict() for reason in self.reasons]
            weighed = {"probability": self.probability, "reasons": reasons}
        return {
            "effect": self.effect or None,
            "joints": list(self.joints),
            "reason": self.reason,
            "parameters": {name: value.to_dict() for name, value in self.parameters.items()},
            **weighed,
        }


def joints_of(item: Named, joints: Sequence[str]) -> tuple[str, ...]:
    """Names of an effect's own joint, or of the joints that an effect of the whole arm affects."""
    return tuple(joints[j] for j in item.named_joints)


def unlikely_reservations(
    unlikely: Sequence[Named], joints: Sequence[str]
) -> tuple[Reservation, ...]:
    """One reservation for each effect that was found less likely than not, the likeliest first."""
    ordered = sorted(unlikely, key=lambda name: -name.estimate.class_probability)
    return tuple(Reservation.unlikely(name, joints) for name in ordered)


def link_reservations(links: Mapping[str, TunedLink]) -> tuple[Reservation, ...]:
    """One reservation for each link that tuning moved beyond the URDF's tolerance."""
    reservations = []
    for name, link in links.items():
        if link.beyond_tolerance:
            doubt = Reservation("", (link.joint,), link.words(name), link.changes())
            reservations.append(doubt)
    return tuple(reservations)


def replay_reservation(
    forward: Replay,
    series: Sequence[RunResidual],
    joints: Sequence[str],
    rms: Float[Array, " n"],
    floors: Float[Array, " n"],
    settings: DiagnosisSettings = USUAL,
) -> tuple[Reservation, ...]:
    """One reservation about the joints whose replayed motion ends far off, or none.

    Args:
        forward: The replay.
        series: Residuals of all runs, for the joints' speeds.
        joints: Joint names.
        rms: Held-out error with the accepted effects [N m]; only an error above the noise counts.
        floors, settings: Floor of each joint's error [N m], and thresholds.
    """
    squares = sum(np.sum(np.where(item.valid, item.speed, 0.0) ** 2, axis=0) for item in series)
    counts = sum(item.valid.sum(axis=0) for item in series)
    mean_speed = np.sqrt(squares / np.maximum(counts, 1))
    way = forward.window * mean_speed
    ends_far = forward.after > settings.gap.replay.far_share * way
    has_error = rms > settings.verdict.loud * floors
    deviating = np.flatnonzero((forward.windows > 0) & ends_far & has_error).tolist()
    if not deviating:
        return ()
    ends = []
    for j in deviating:
        off = f"{joints[j]} by {forward.after[j]:.2g} rad"
        ends.append(f"{off} over a way of {way[j]:.2g} rad")
    milliseconds = f"{1e3 * forward.window:.0f} ms"
    reason = (
        f"replayed under the recorded torques for {milliseconds}, "
        f"the motion ends off ({', '.join(ends)}): "
        "whatever is named, the model does not foretell this arm; check inertias, units and signs"
    )
    return (Reservation("", tuple(joints[j] for j in deviating), reason, {}),)
