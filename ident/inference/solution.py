"""Sums of a set of effects, from which parameters and their intervals are read."""

from __future__ import annotations

from dataclasses import dataclass

from ident.inference.infer import Inferred
from ident.inference.search import SetSearch
from ident.regression.design import Group

# Divisor of the URDF's tolerance at which its inertias are as good as fixed.
FIXED = 1e3


@dataclass(frozen=True, eq=False)
class Solution:
    """Sums of a set of effects after the baseline."""

    search: SetSearch
    fixed: SetSearch  # with inertias as the URDF has them
    chosen: tuple[Group, ...]

    @classmethod
    def of(cls, fine: Inferred) -> Solution:
        """The sums of a set on fine grids."""
        error = fine.model.components.urdf.divided(FIXED)
        return cls(fine.search, SetSearch.of(fine.model.with_urdf(error)), fine.chosen)
