"""Array types and the read-only copies that frozen dataclasses hold.

Type checkers see jaxtyping's annotations. At run time nothing reads them, and loading jaxtyping
costs a tenth of a second of processor time in every command: arrays of any kind take their place.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

__all__ = ["Array", "Bool", "Float", "Int", "freeze", "in_a_line", "least_squares", "read_only"]

Array = np.ndarray
# Longest text or tuple that a line shows as it is [characters].
LINE = 100

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int
else:
    Bool = Float = Int = np.ndarray


def freeze(values: Any) -> Float[Array, "..."]:
    """Copies values into a read-only float array; an array that is one already, and no view, is
    taken as it is.
    """
    if (
        isinstance(values, np.ndarray)
        and values.dtype == float
        and values.flags.owndata
        and not values.flags.writeable
    ):
        return values
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def read_only(values: Any) -> Float[Array, "..."]:
    """Values as a float array row by row that can't be written through, copied where they are none.

    A compiled loop is made once for what it reads in this way; else it is made again for arrays
    that others may write, and for those that none may.
    """
    array = np.ascontiguousarray(values, dtype=float).view()
    array.setflags(write=False)
    return array


def least_squares(
    table: Float[Array, "T k"], target: Float[Array, "..."], least: float | None = None
) -> Array:
    """Least-squares solution of least norm.

    LAPACK's fastest way, by divided singular values, may not come to an end where a column is zero;
    pivoted ones do.

    Args:
        table: The columns.
        target: What they are to make.
        least: Smallest singular value that counts, as a share of the largest; by rounding if None.
    """
    try:
        return np.asarray(np.linalg.lstsq(table, target, rcond=least)[0])
    except np.linalg.LinAlgError:
        from scipy.linalg import lstsq  # slow to load, and hardly ever needed

        return np.asarray(lstsq(table, target, cond=least, lapack_driver="gelsy")[0])


def in_a_line(record: Any) -> str:
    """A dataclass in one line, for its `repr`: shapes of its arrays, lengths of what it holds many
    of.
    """
    told = []
    for stated in fields(record):
        value = getattr(record, stated.name)
        if hasattr(value, "shape"):
            told.append(f"{stated.name}: {' x '.join(map(str, value.shape))}")
        elif isinstance(value, str | int | float | PurePath | tuple) and len(str(value)) < LINE:
            told.append(
                f"{stated.name}={str(value)!r}"
                if isinstance(value, PurePath)
                else f"{stated.name}={value!r}"
            )
        elif value is not None and hasattr(value, "__len__"):
            told.append(f"{stated.name}: {len(value)}")
    return f"{type(record).__name__}({', '.join(told)})"
