"""Array types and the read-only copies that frozen dataclasses hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Array", "Bool", "Float", "Int", "freeze"]

Array = np.ndarray


def freeze(values: Any) -> Float[Array, "..."]:
    """Copies values into a read-only float array; an array that is one already, and no view, is taken as it is."""
    if isinstance(values, np.ndarray) and values.dtype == float and values.flags.owndata and not values.flags.writeable:
        return values
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
