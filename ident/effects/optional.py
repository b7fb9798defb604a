"""What only some effects have, each by a method of its own.

A class has one of these simply by a method of that name and signature, whoever wrote it. The
functions ask any effect, and say what holds of one without the method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect
from ident.effects.effect_info import Expression
from ident.effects.intervals import SizePrior
from ident.effects.session_context import SessionContext, Variant

PartOfPoint = tuple[Variant, Sequence[int]]
"""A further point of the grid, and which of a point's columns are its own."""


@runtime_checkable
class Screened(Protocol):
    """It learns from a first look at what the tuned model leaves: events, when they may have been.

    `Effect.screens` is then the number of places that were looked at for each that it keeps.
    """

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> Effect: ...


@runtime_checkable
class GridRefined(Protocol):
    """It has a finer grid around the point of the inner grid that fits best."""

    def refined(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Sequence[Variant]: ...


@runtime_checkable
class Composed(Protocol):
    """Some columns of a point are those of further points."""

    def parts(self, variant: Variant) -> Sequence[PartOfPoint]: ...


@runtime_checkable
class WithFreeForms(Protocol):
    """Some points have its law with further terms, which follow other causes, too."""

    def is_plain(self, variant: Variant) -> bool: ...


@runtime_checkable
class Signed(Protocol):
    """Which coefficients can't be negative hangs on the point of the grid."""

    def signed(self, variant: Variant) -> tuple[int, ...]: ...


@runtime_checkable
class Linearised(Protocol):
    """Its law is made linear at a point of the grid, and holds near it alone."""

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool: ...


@runtime_checkable
class KnownSize(Protocol):
    """Its size is known well enough to tell a small one from the errors that a URDF has anyway."""

    def size_prior(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> SizePrior | None: ...


@runtime_checkable
class LikeDryFriction(Protocol):
    """Some of it can't be distinguished from dry friction, which the tuned joint has then."""

    def without_dry_friction(
        self, coefficients: Float[Array, " k"], variant: Variant
    ) -> tuple[Float[Array, " k"], float]: ...


@runtime_checkable
class OpenAtSomePoints(Protocol):
    """Whether the reported parameters leave its law open hangs on the point of the grid."""

    def tells_law(self, variant: Variant) -> bool: ...


def screened(
    effect: Effect, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
) -> Effect:
    """The effect after a first look.

    Args:
        effect: The effect.
        session: All runs.
        leftover: For each run what the model leaves of the torque but not in the same states at
            other times, filtered and decimated, at rest and near stops and turns what goes beyond
            friction; NaN at a run's ends [N m].
    """
    return effect.screened(session, leftover) if isinstance(effect, Screened) else effect


def refined(
    effect: Effect, session: SessionContext, joint: int, variant: Variant
) -> Sequence[Variant]:
    """Points of a finer grid around a point of the inner grid; the point alone of an effect
    without one.
    """
    if isinstance(effect, GridRefined):
        return effect.refined(session, joint, variant)
    return (variant,)


def parts(effect: Effect, variant: Variant) -> Sequence[PartOfPoint]:
    """Further points of the grid that have some of this point's columns, and the columns' indices.

    Empty of an effect without such points.
    """
    return effect.parts(variant) if isinstance(effect, Composed) else ()


def is_plain(effect: Effect, variant: Variant) -> bool:
    """Whether a point has its effect's law without further terms that only bend it; True by
    default.
    """
    return effect.is_plain(variant) if isinstance(effect, WithFreeForms) else True


def signed(effect: Effect, variant: Variant) -> tuple[int, ...]:
    """Indices of the columns of a point whose coefficients can't be negative."""
    return effect.signed(variant) if isinstance(effect, Signed) else effect.nonnegative


def stands_for(effect: Effect, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
    """Whether a point of the inner grid holds for such coefficients; True by default."""
    return effect.stands_for(variant, coefficients) if isinstance(effect, Linearised) else True


def size_prior(
    effect: Effect, session: SessionContext, joint: int, variant: Variant
) -> SizePrior | None:
    """What is known of an effect's coefficients beforehand.

    None where each costs what any free parameter does.
    """
    if isinstance(effect, KnownSize):
        return effect.size_prior(session, joint, variant)
    return None


def without_dry_friction(
    effect: Effect, coefficients: Float[Array, " k"], variant: Variant
) -> tuple[Float[Array, " k"], float]:
    """An effect's coefficients without what is a joint's usual dry friction, and that friction [N
    m].

    Where columns can't be distinguished from dry friction, the tuned joint has it, not the effect:
    it is there when the effect is gone. By default the coefficients as they are, and 0.
    """
    if isinstance(effect, LikeDryFriction):
        return effect.without_dry_friction(coefficients, variant)
    return coefficients, 0.0


def tells_law(effect: Effect, variant: Variant) -> bool:
    """Whether a diagnosis reports coefficients and shape of this point beside the reported
    parameters.
    """
    if isinstance(effect, OpenAtSomePoints):
        return effect.tells_law(variant)
    return effect.open_law or effect.open_shape


def typical_coefficients(
    effect: Effect, session: SessionContext, joint: int, variant: Variant, width: int
) -> Float[Array, " k"]:
    """Coefficients of an effect as large as is typical.

    Args:
        effect: The effect.
        session: The runs.
        joint: Index of the joint.
        variant: The point of the inner grid.
        width: Number of its columns.

    Returns:
        A share of its prior scale each (of 1 without a prior); 0 for those that are usually absent.
    """
    scale = effect.prior_scale(session, joint, variant)
    largest = np.ones(width) if scale is None else np.asarray(scale, dtype=float)[:width]
    coefficients = effect.typical.share * largest
    absent = [k for k in effect.typical.absent if k < width]
    coefficients[absent] = 0.0
    return coefficients


def size_of(
    effect: Effect, session: SessionContext, joint: int, variant: Variant, coefficients: Array
) -> float:
    """The reported parameter that scales an effect, for some coefficients, without its sign.

    In the parameter's unit.
    """
    nothing = np.zeros((len(coefficients), len(coefficients)))
    estimates = effect.parameters(session, joint, variant, coefficients, nothing)
    return abs(float(estimates[effect.typical.figure].value))


def expressed(effect: Effect, form: str, parameters: Mapping[str, float]) -> Expression | None:
    """How a format expresses an effect with these parameters.

    Args:
        effect: The effect.
        form: The format: `urdf`, `mjcf`, ….
        parameters: Reported values by name.

    Returns:
        None where it is friction to the format.
    """
    expression = effect.formats.get(form)
    return None if expression is None else expression.given(parameters)


def simulated_answer(
    effect: Effect, true: Mapping[str, float | str], starts: Sequence[float]
) -> dict[str, float]:
    """Parameters of a simulated arm's answer in this effect's terms, as far as they have a
    counterpart.

    Args:
        effect: The effect.
        true: The answer's parameters; names of joints among them have none.
        starts: Session time at which each run starts [s].
    """
    if effect.clock.run:
        return _on_the_clock(effect, true, starts)
    numbers = {name: float(value) for name, value in true.items() if not isinstance(value, str)}
    answer = {}
    for name, value in numbers.items():
        if name in effect.incomparable:
            continue
        factor = numbers.get(effect.multiplied_by.get(name, ""), 1.0)
        answer[name] = -value if name in effect.opposite else factor * value
    return answer


def _on_the_clock(
    effect: Effect, true: Mapping[str, float | str], starts: Sequence[float]
) -> dict[str, float]:
    """Times of an answer, counted from its run's start, as the session's; {} where nobody knows
    when the run started.
    """
    if not starts:
        return {}
    start = starts[int(true[effect.clock.run]) - 1]
    if not np.isfinite(start):
        return {}
    return {name: float(true[name]) + start for name in effect.clock.times}
