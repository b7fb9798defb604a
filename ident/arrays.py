"""Array types and the read-only copies that frozen dataclasses hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Array", "Bool", "Float", "Int", "freeze", "rms"]

Array = np.ndarray


def freeze(values: Any) -> Float[Array, "..."]:
    """Copies values into a read-only float array."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def rms(values: Float[Array, "..."], axis: int | None = 0) -> Any:
    """Root mean square along an axis."""
    return np.sqrt(np.mean(np.square(values), axis=axis))
