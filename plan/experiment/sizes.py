"""How large an effect is taken to be: as the diagnosis found it, else of typical size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, SessionContext, Variant

# What is told is believed within these factors of a typical size.
_LARGEST_CHANGE = 20.0
Told = Mapping[str, float]
"""Figures of an effect by name."""


@dataclass(frozen=True, eq=False)
class Sized:
    """An effect of a certain size.

    Attributes:
        coefficients: Of its columns at the expected point of its inner grid.
        source: `diagnosis` or `typical`.
    """

    coefficients: Float[Array, " k"]
    source: str


def size_effect(
    effect: Effect, session: SessionContext, joint: int, variant: Variant, width: int, told: Told | None = None
) -> Sized:
    """The effect at a joint as large as it is expected to be.

    Args:
        effect: The effect.
        session: Of the motions in question.
        joint: Its joint.
        variant: Point of its inner grid.
        width: Number of its columns there.
        told: Figures of the diagnosis by name, if it found this effect.
    """
    typical = effect.typical
    scale = effect.prior_scale(session, joint, variant)
    beta = typical.share * (np.ones(width) if scale is None else np.asarray(scale, dtype=float))
    beta[[k for k in typical.absent if k < width]] = 0.0
    if not told or typical.figure not in told:
        return Sized(beta, "typical")
    usual = effect.parameters(session, joint, variant, beta, np.zeros((width, width)))[typical.figure].value
    ratio = abs(told[typical.figure]) / max(abs(usual), 1e-12)
    if typical.inverse:
        ratio = 1.0 / max(ratio, 1e-12)
    return Sized(beta * float(np.clip(ratio, 1.0 / _LARGEST_CHANGE, _LARGEST_CHANGE)), "diagnosis")


def choose_variant(effect: Effect, variants: Sequence[Variant], told: Told | None = None) -> int:
    """Number of the point of the inner grid nearest to what is told, or to what is typical; else the first."""
    wanted = {**effect.typical.inner, **(told or {})}

    def apart(k: int) -> float:
        inner = variants[k].inner
        return sum(abs(float(np.log(max(wanted[name], 1e-9) / inner[name]))) for name in inner if name in wanted)

    return min(range(len(variants)), key=apart)
