"""Effects as changes: what may have come, gone, grown or shrunk between two sets of recordings.

Each effect of the catalogue becomes a `ChangeOf` that acts in the later set alone, so that its
parameters are after minus before. To these are added a change of plain friction, and a change that
follows no law of the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.laws import FrictionChange, UnlistedChange
from ident.diagnosis.change.settings import CHANGE
from ident.effects import optional
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import Range
from ident.effects.ripple import TorqueRipple
from ident.regression.design import Grid, Group

# Threshold of a ripple's spectral lines, so large that the strongest lines are always candidates.
MANY_LINES = 1e9
# Any effect of the catalogue may have changed.
CHANGEABLE = sorted(
    (
        replace(effect, chance=MANY_LINES) if isinstance(effect, TorqueRipple) else effect
        for effect in CATALOGUE
    ),
    key=lambda effect: effect.as_change.order,
)
CHANGES: tuple[Effect, ...] = (*CHANGEABLE, FrictionChange(), UnlistedChange())
MASS = "mass_kg"
# Attributes that a change copies from its effect.
COPIED = (
    *("id", "scope", "rows", "summary", "shown_by", "defining", "screens"),
    *("as_change", "doubt", "event", "partner", "remembers"),
)


# Effects whose columns, shared by all runs, are in the span of the tuned baseline.
IN_THE_BASELINE = frozenset(
    effect.id
    for effect in CHANGES
    if effect.as_change.body
    or effect.event
    or effect.remembers
    or isinstance(effect, FrictionChange)
)
# Laws of friction, which varies between runs: one run a side does not show a change.
OF_FRICTION = frozenset(effect.id for effect in CHANGES if effect.as_change.friction)
# The change of what the arm carries.
(CARRIED,) = (effect.id for effect in CHANGES if effect.as_change.taken_off)


def points(effect: Effect, session: SessionContext, joint: int) -> Sequence[Variant]:
    """An even choice of the points of an effect's grid at a joint.

    Of effects with a second joint, those of adjacent joints; all points of a short grid, of bodies,
    and of effects that act in the later set alone.
    """
    grid = effect.variants(session, joint)
    if effect.partner:
        with_other = [(point, point.other) for point in grid if point.other is not None]
        return [point for point, other in with_other if abs(other - joint) == 1]
    kind = effect.as_change
    if len(grid) <= CHANGE.grid_points or kind.later_alone or kind.body:
        return grid
    inner = np.linspace(0, len(grid) - 1, CHANGE.grid_points + 2)[1:-1]
    nearest = {round(place) for place in inner.tolist()}
    return [grid[k] for k in sorted(nearest)]


def finer_grids(
    changes: Sequence[Group], session: SessionContext, later: SessionContext
) -> list[Grid]:
    """Finer grids about the points of some changes.

    Bodies have none, for they are laid out anew about their place.

    Args:
        changes: Changes at their points of the usual grid.
        session, later: The runs of both sets, and those of the later one.

    Returns:
        Effect, joint and points of each change that has a finer grid.
    """
    grids: list[Grid] = []
    for group in changes:
        effect = group.effect.effect if isinstance(group.effect, ChangeOf) else group.effect
        runs = later if effect.as_change.later_alone else session
        finer = optional.refined(effect, runs, group.joint, group.variant)
        if len(finer) > 1 and not effect.as_change.body:
            grids.append((effect, group.joint, tuple(finer)))
    return grids


@dataclass(eq=False)
class ChangeOf(Effect):
    """An effect that acts in the later set alone.

    Its parameters are after minus before, and may have either sign.
    """

    effect: Effect  # the effect

    def __post_init__(self) -> None:
        for name in COPIED:
            setattr(self, name, getattr(self.effect, name))

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return self.effect.columns(session, joint, variant)

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        gone = self.as_change.taken_off and coefficients[0] < 0.0
        size = -coefficients if gone else coefficients
        estimates = self.effect.parameters(session, joint, variant, size, covariance)
        return self._negated(estimates) if gone else estimates

    def _negated(self, estimates: Mapping[str, Interval]) -> dict[str, Interval]:
        """The parameters of an amount that was taken off, with its sign reversed."""
        name = self.as_change.taken_off
        amount = estimates[name]
        return {**estimates, name: Interval(-amount.value, -amount.high, -amount.low)}

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        if self.as_change.friction and self.id != FrictionChange.id:
            # The effect's bounds follow from the friction before, which a change may exceed.
            return {}
        if self.as_change.taken_off and estimates[self.as_change.taken_off].value < 0.0:
            estimates = self._negated(estimates)
        ranges: dict[str, Range] = {}
        for name, bounds in self.effect.physical(session, joint, estimates).items():
            if np.isfinite(bounds.high):
                # An effect may vanish, so the negative of its largest size is plausible.
                bounds = replace(bounds, low=min(bounds.low, -bounds.high))
            # A parameter is outside its bounds only if its whole interval is.
            estimate = estimates[name]
            outside = estimate.high < bounds.low or estimate.low > bounds.high
            if outside or not np.isfinite(estimate.value):
                ranges[name] = bounds
        return ranges

    def parts(self, variant: Variant) -> Sequence[tuple[Variant, Sequence[int]]]:
        return optional.parts(self.effect, variant)

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        """Whether a point holds for what has come, or for what has gone."""
        came = optional.stands_for(self.effect, variant, coefficients)
        return came or optional.stands_for(self.effect, variant, -coefficients)

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"] | None:
        return self.effect.prior_scale(session, joint, variant)

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        return describe_change(self.effect, where, estimates)


def describe_change(effect: Effect, where: str, estimates: Mapping[str, Interval]) -> str:
    """What a person at the cell can do about a change: one sentence without a full stop."""
    if effect.as_change.sentence:
        return effect.as_change.sentence.format(where=where, **estimates)
    return f"{effect.action(where, estimates)} (after minus before)"
