"""Effects whose law is one function of a joint's speed, load and angle; those that are a row of the table alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.effect_info import read_row
from ident.effects.intervals import grid_interval
from ident.effects.typical_sizes import friction_states, hardly_moves
from ident.laws.carried import JointStates, LawKind, evaluate


class StatesEffect(Effect):
    """An effect with a law of `ident.laws`; one whose row has a `grid` of what bends the law needs no class.

    Args:
        effect: Its id; those of a class have their own.
    """

    states: ClassVar[LawKind]
    grid: ClassVar[Mapping[str, Sequence[float]]] = {}

    def __init__(self, effect: str = "") -> None:
        vars(self).update({"id": effect, **read_row(effect)} if effect else {})

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return hardly_moves(session, joint)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        points = product(*self.grid.values())
        return tuple(Variant(dict(zip(self.grid, point, strict=True))) for point in points)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        shape = {**variant.shape, **variant.inner}
        return [evaluate(self.states.columns, friction_states(run, joint), shape) for run in session.runs]

    def at_state(self, shape: Mapping[str, float], q: float = 0.0, dq: float = 0.0, load: float = 0.0) -> Array:
        """Its columns at one state, sliding in the direction of the speed: what sentences evaluate, shape (k,)."""
        at = JointStates(*(np.array([value]) for value in (q, dq, load, float(np.sign(dq)))))
        return evaluate(self.states.columns, at, shape)[0]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        """The coefficients by the names of `figures`, and the point of the grid with what the grid resolves."""
        bent = {name: grid_interval(value, self.grid.get(name, (value,))) for name, value in variant.inner.items()}
        return {**super().parameters(session, joint, variant, coefficients, covariance), **bent}

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """The point of the grid, and the coefficients that were found there, or those that the parameters tell."""
        told = coefficients or [reported[name] for name in self.figures or self.defining]
        return {**self.states.usual, **shape, **{f"coefficient_{k}": float(value) for k, value in enumerate(told)}}
