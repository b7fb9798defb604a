"""Effects as changes: what may have come, gone, grown or shrunk between two sets of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.laws import FrictionChange, UnlistedChange
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.effects.effect_info import Doubt, Range

# What happens to arms between two recordings. Not asked: what is no change (warmth, an event in one run), and what
# hides in less than a filter passes (play, ripple, elasticity), whose laws need the finest of motions.
CHANGEABLE = (
    "payload",
    "link_inertial_error",
    "gravity_misalignment",
    "torque_gain_error",
    "torque_offset",
    "encoder_offset",
    "stribeck_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "asymmetric_friction",
    "spring_torque",
    "torque_delay",
)
# Those whose own columns, in all runs alike, say nothing that the tuned baseline does not say already.
IN_THE_BASELINE = frozenset({"payload", "link_inertial_error", "friction_change"})
# Laws of friction: of one run before and one after, nobody knows what differs from run to run anyhow.
OF_FRICTION = frozenset(
    {
        "friction_change",
        "stribeck_friction",
        "load_dependent_friction",
        "position_dependent_friction",
        "asymmetric_friction",
        "unlisted_change",
    }
)
# Points of an inner grid that are tried: a change is found at the nearest.
MOST_POINTS = 2
# Laws that an arm obeys to the letter: bodies fall, readings are scaled and shifted.
TO_THE_LETTER = frozenset({"payload", "link_inertial_error", "torque_gain_error", "torque_offset"})
MASS = "mass_kg"


def changes() -> tuple[Effect, ...]:
    """All that is asked for, laws of the catalogue first."""
    return (*(find_effect(name) for name in CHANGEABLE), FrictionChange(), UnlistedChange())


def points(effect: Effect, session: SessionContext, joint: int) -> Sequence[Variant]:
    """An even choice of an effect's inner grid."""
    grid = effect.variants(effect.asked(session), joint)
    if len(grid) <= MOST_POINTS:
        return grid
    inner = np.linspace(0, len(grid) - 1, MOST_POINTS + 2)[1:-1]
    return [grid[k] for k in sorted({round(float(at)) for at in inner})]


@dataclass(eq=False)
class ChangeOf(Effect):
    """An effect that acts in the later set alone: its figures are after minus before, whatever their signs.

    Attributes:
        effect: The effect.
    """

    effect: Effect

    def __post_init__(self) -> None:
        kind = self.effect
        self.id, self.scope, self.rows = kind.id, kind.scope, kind.rows  # type: ignore[misc]
        self.summary, self.shown_by, self.defining = kind.summary, kind.shown_by, kind.defining  # type: ignore[misc]
        self.screens = kind.screens
        self.doubt = Doubt(share=0.0) if kind.id in TO_THE_LETTER else kind.doubt  # type: ignore[misc]

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return self.effect.columns(session, joint, variant)

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        gone = self.id == "payload" and coefficients[0] < 0.0
        figures = self.effect.parameters(session, joint, variant, -coefficients if gone else coefficients, covariance)
        if gone:
            mass = figures[MASS]
            figures[MASS] = Interval(-mass.value, -mass.high, -mass.low)
        return figures

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        if self.id == "payload" and figures[MASS].value < 0.0:
            mass = figures[MASS]
            figures = {**figures, MASS: Interval(-mass.value, -mass.high, -mass.low)}
        found = {
            # What an effect may be is also what it may lose.
            name: replace(one, low=min(one.low, -one.high)) if np.isfinite(one.high) else one
            for name, one in self.effect.physical(session, joint, figures).items()
        }
        # What is hardly determined may be as it should: its whole interval must speak against it.
        outside = {name for name, one in found.items() if figures[name].high < one.low or figures[name].low > one.high}
        return {name: one for name, one in found.items() if name in outside or not np.isfinite(figures[name].value)}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"] | None:
        return self.effect.prior_scale(session, joint, variant)

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        return describe_change(self.effect, where, figures)


def describe_change(effect: Effect, where: str, figures: Mapping[str, Interval]) -> str:
    """What a person at the cell can do about a change: one sentence without a full stop."""
    if effect.id == "payload":
        way = "more" if figures[MASS].value > 0.0 else "less"
        mass = figures[MASS].words("kg", size=True)
        return f"weigh the tool: the flange carries {mass} {way} than before; give it as [payload] of session.toml"
    if effect.id == "link_inertial_error":
        change = figures["mass_change_kg"]
        way = "more" if change.value > 0.0 else "less"
        return f"look at what is mounted behind {where}: {change.words('kg', size=True)} {way} than before"
    if effect.id == "torque_gain_error":
        gain = figures["gain"]
        way = "more" if gain.value > 0.0 else "less"
        share = gain.words("%", 100.0, size=True)
        return f"compare the drive's parameters of {where} before and after: it reads {share} {way}"
    if effect.id == "torque_offset":
        return f"zero the torque reading of {where}: it has moved by {figures['offset_Nm'].words('N m')}"
    return f"{effect.action(where, figures)} (after minus before)"
