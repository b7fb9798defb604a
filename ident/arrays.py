"""Array types and the read-only copies that frozen dataclasses hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Array", "Bool", "Float", "Int", "freeze"]

Array = np.ndarray


def freeze(values: Any) -> Float[Array, "..."]:
    """Copies values into a read-only float array."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
