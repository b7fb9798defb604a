"""Array types and the read-only copies that frozen dataclasses hold.

Type checkers see jaxtyping's annotations. At run time nothing reads them, and loading jaxtyping costs a tenth of a
second of processor time in every command: names that stand for an array of any kind take their place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

__all__ = ["Array", "Bool", "Float", "Int", "freeze"]

Array = np.ndarray

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int
else:

    class _AnyArray:
        """`Float[Array, "T n"]` and the like: an array, whatever its shape."""

        def __class_getitem__(cls, _: Any) -> type[np.ndarray]:
            return np.ndarray

    Bool = Float = Int = _AnyArray


def freeze(values: Any) -> Float[Array, "..."]:
    """Copies values into a read-only float array; an array that is one already, and no view, is taken as it is."""
    if isinstance(values, np.ndarray) and values.dtype == float and values.flags.owndata and not values.flags.writeable:
        return values
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
