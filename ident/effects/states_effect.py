"""Effects by a law of one joint's states; one whose row has a `grid` of what bends the law needs no
class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect
from ident.effects.interval import Interval
from ident.effects.intervals import grid_interval
from ident.effects.record import read_row
from ident.effects.session_context import SessionContext, Variant, least_rest_speed
from ident.laws.carried import JointStates, LawKind, evaluate, states_of

# The number of a grid that must be a speed of motion.
SLOWEST = "stribeck_velocity_rad_s"


class StatesEffect(Effect):
    """An effect with a law of `ident.laws`.

    Args:
        effect: Its id; those of a class have their own.
    """

    states: ClassVar[LawKind]
    needs: ClassVar[Mapping[str, float]] = {"moves": 1.0}

    def __init__(self, effect: str = "") -> None:
        if effect:
            vars(self).update({"id": effect, **read_row(effect)})

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """Every combination of the grid's numbers; speeds that are no motion in these recordings
        are left out.
        """
        return self._points(session, joint, self.grid)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """Every combination of the finer grid's numbers near a point; the point without any."""
        if not self.finer:
            return (variant,)
        inner = variant.inner
        grid = {name: finer.about(inner[name]) for name, finer in self.finer.items()}
        return self._points(session, joint, grid)

    def _points(
        self, session: SessionContext, joint: int, grid: Mapping[str, Sequence[float]]
    ) -> Sequence[Variant]:
        rest = least_rest_speed(session, joint) if SLOWEST in grid else 0.0
        points = [dict(zip(grid, numbers, strict=True)) for numbers in product(*grid.values())]
        return tuple(Variant(point) for point in points if point.get(SLOWEST, np.inf) > rest)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        shape = {**variant.shape, **variant.inner}
        columns = []
        for run in session.runs:
            states = states_of(joint, run.motion.q, run.motion.dq, run.link, run.direction)
            columns.append(evaluate(self.states.columns, states, shape))
        return columns

    def at_state(self, shape: Mapping[str, float], dq: float, load: float = 0.0) -> Array:
        """The law's columns at a single state: angle zero, sliding as the sign of the speed says [N
        m].

        Args:
            shape: Numbers of the law that are no coefficients, by name.
            dq: Speed [rad/s].
            load: Torque on the gear [N m].

        Returns:
            One torque for each coefficient of one, shape (k,).
        """
        direction = float(np.sign(dq))
        states = JointStates(
            np.array([0.0]), np.array([dq]), np.array([load]), np.array([direction])
        )
        return evaluate(self.states.columns, states, shape)[0]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        """The coefficients by the names of `figures`, and the point of the grid with what the grid
        resolves.
        """
        estimates = super().parameters(session, joint, variant, coefficients, covariance)
        for name, value in variant.inner.items():
            estimates[name] = grid_interval(value, self.grid.get(name, (value,)))
        return estimates

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """The point of the grid, and the coefficients that were found there, or those that the
        parameters tell.
        """
        stated = coefficients or [reported[name] for name in self.figures or self.defining]
        figures = {**self.states.usual, **shape}
        for k, value in enumerate(stated):
            figures[f"coefficient_{k}"] = float(value)
        return figures
