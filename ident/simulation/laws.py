"""The plant's laws as tables: a record a joint, a column a parameter, so that compiled code takes one table.

A law is declared once, as its columns with the value that a joint has of each without an effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Law = np.recarray[Any, Any]
"""n records; `law.viscous` is a column of shape (n,)."""


def make_law(columns: Mapping[str, float | int | bool], n: int, **values: Any) -> Law:
    """A law of n joints.

    Args:
        columns: Every column with its usual value, whose type is the column's.
        n: Number of joints.
        **values: Columns of shape (n,), or a value for all joints, in place of the usual.
    """
    kinds = np.dtype([(name, type(value)) for name, value in columns.items()], align=True)
    law = np.zeros(n, dtype=kinds).view(np.recarray)
    for name, value in {**columns, **values}.items():
        law[name] = value
    return law


def change_law(law: Law, joint: int | None = None, **values: Any) -> Law:
    """A copy with some columns changed: at one joint, or as a whole where joint is None."""
    changed = law.copy()
    for name, value in values.items():
        changed[name][slice(None) if joint is None else joint] = value
    return changed
