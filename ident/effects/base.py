"""What an effect is: columns of extra joint torque that a model lacks, linear in coefficients,
inside a small grid.

An effect says what torque it would add, given the motion; it never sees the measured torque. The
diagnosis filters the columns like the measured torque, takes out what a refit of the baseline could
explain, and asks the data. It is a record (`EffectRecord`) and the eight methods below; what only
some effects have stands in `optional.py`. `check_effect` says whether a class keeps to all that.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.effect_info import Expression, Range
from ident.effects.interval import Interval
from ident.effects.intervals import coefficient_interval, delta_interval, linear_interval
from ident.effects.record import EffectRecord, Size
from ident.effects.session_context import (
    RunContext,
    SessionContext,
    Variant,
    arm_mass,
    arm_reach,
    friction_level,
    lacking,
    rated_torque,
)
from ident.units import split_key

__all__ = ["Effect", "Expression", "Interval", "Range", "RunContext", "SessionContext", "Variant"]
__all__ += ["delta_interval", "impossible", "linear_interval"]

# Bounds are of the arm's own rating and friction, which nobody knows better than by this factor.
KNOWN_WITHIN = 1.5


class Effect(EffectRecord, ABC):
    """An effect, of the catalogue or of a user's."""

    screens: int = 1  # how many places were looked at to find those of its grid; see `Screened`
    # Its torque in a patch's module, of effects outside the catalogue: a static function (m, j, p)
    # of the motion (m.q, m.dq, m.ddq, m.direction, of shape (T, n)), the joint's index and the
    # parameters by name, that uses NumPy alone and returns shape (T, n); `m.at(j, torque)` puts a
    # torque of shape (T,) at one joint.
    law: ClassVar[Callable[[Any, int, dict[str, float]], Array] | None] = None

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        """Why these recordings can't show the effect at a joint at all, or None. Must be cheap."""
        return lacking(self.needs, session, joint)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """The points of the inner grid at a joint, at which the effect is tried.

        By default a single one without parameters.

        Args:
            session: The runs.
            joint: Index of the joint; 0 for an effect of the whole arm.
        """
        return (Variant(),)

    @abstractmethod
    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        """Torque of every run for coefficients of one [N m per unit of coefficient].

        Whole sessions are asked for at once because some effects remember from run to run.

        Args:
            session: The runs.
            joint: Index of the joint; 0 for an effect of the whole arm.
            variant: The point of the inner grid.

        Returns:
            For each run k columns: shape (T, k) of the joint's own torque where `rows` is `own`,
            (T, n, k) of all joints' where it is `all`.
        """

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Float[Array, " k"],
        covariance: Float[Array, "k k"],
    ) -> dict[str, Interval]:
        """Physical parameters from coefficients; 95 % intervals for a known variant.

        By default the coefficients themselves, by the names of `figures`.
        """
        names = self.figures or [f"coefficient_{k}" for k in range(len(coefficients))]
        return {
            name: coefficient_interval(k, coefficients, covariance) for k, name in enumerate(names)
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"] | None:
        """Largest plausible size of each coefficient, two standard deviations of the prior.

        By default as `prior` has it.

        Returns:
            In the coefficients' units; None where nothing is known (a flat prior).
        """
        if not self.prior:
            return None
        return np.array([size_at_joint(size, session, joint) for size in self.prior])

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """What reported parameters can be on this arm, by name.

        Parameters that may be anything are left out. A name whose interval lies wholly outside
        keeps the share of its probability by which such names of the corpus were right. By default
        as `bounds` has it.
        """
        ranges = {}
        for name, (low, high, reason) in self.bounds.items():
            least = size_at_joint(low, session, joint)
            most = size_at_joint(high, session, joint)
            ranges[name] = Range(least, most, reason)
        return ranges

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        """What a person at the cell can do about it: one sentence without a full stop.

        By default as `sentence` has it.

        Args:
            where: The joint's name, or those of the joints where an effect of the whole arm shows.
            estimates: The reported parameters.
        """
        if self.sentence:
            return self.sentence.format(where=where, **estimates)
        effect = self.id.replace("_", " ")
        values = []
        for key, interval in estimates.items():
            name, unit = split_key(key)
            values.append(f"{name.replace('_', ' ')} {interval.words(unit)}")
        stated = ", ".join(values)
        return f"add {effect} of {where} to the model ({stated}): `ident patch` writes it"

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs beside the reported ones.

        Args:
            reported: The reported parameters.
            coefficients: Those of its columns, where a diagnosis tells them (`open_law`); else
                empty.
            shape: Shape and inner parameters of the point of the grid that they belong to; else
                empty.
        """
        return {name: value for name, value in shape.items() if name not in reported}


def size_at_joint(size: Size, session: SessionContext, joint: int) -> float:
    """A number, or a share of what a joint or the arm has.

    Of a joint "0.5 rated" [N m], "3 coulomb" [N m] or "1 viscous" [N m s/rad]; of the arm "1 mass"
    [kg] or "0.5 reach" [m].

    Args:
        size: A number, which is returned, or such a text.
        session: The runs.
        joint: Index of the joint.
    """
    if not isinstance(size, str):
        return float(size)
    share, quantity = size.split()
    return float(share) * _whole(quantity, session, joint)


def _whole(quantity: str, session: SessionContext, joint: int) -> float:
    """What a joint has of a quantity, or the arm."""
    if quantity == "rated":
        return rated_torque(session, joint)
    if quantity == "coulomb":
        return friction_level(session, joint)[0]
    if quantity == "viscous":
        return friction_level(session, joint)[1]
    of_the_arm = {"mass": arm_mass, "reach": arm_reach}
    return of_the_arm[quantity](session.runs[0].arm)


def impossible(
    effect: Effect, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
) -> str | None:
    """Why no arm has an effect of such parameters, in words; None where one can.

    A parameter is impossible if its 95 % interval lies beyond a bound as a whole, or its value is
    not finite.
    """
    for name, allowed in effect.physical(session, joint, estimates).items():
        estimate = estimates[name]
        # Both ends of a range about zero are sizes; a lower end of its own is a law (friction does
        # not drive).
        slack = KNOWN_WITHIN if allowed.low in (0.0, -allowed.high) else 1.0
        above = estimate.high >= slack * allowed.low
        below = estimate.low <= slack * allowed.high
        possible = above and below
        if not (np.isfinite(estimate.value) and possible):
            bounds = f"lies outside {allowed.low:.3g} to {allowed.high:.3g}"
            where = bounds if allowed.low <= allowed.high else "is not determined"
            return f"{name} {estimate.value:.3g} {where}: {allowed.reason}"
    return None
