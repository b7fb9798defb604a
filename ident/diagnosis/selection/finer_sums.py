"""Sums of names' finer grids, kept while the same names come again.

Names, friction's variation and the URDF's error are estimated beside each other, again and again until all hold: mostly
the same names come back, and a pass over the recordings for their finer grids would give the same sums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence


class FinerSums:
    """The sums that were made last, and for whom: they hold those of fewer names, too."""

    def __init__(self) -> None:
        self._groups: tuple[Group, ...] = ()
        self._evidence: Evidence | None = None

    def of(self, groups: Sequence[Group], gathered: Callable[[], Evidence]) -> Evidence:
        """The sums of names at their points of the coarse grid, friction the same in all runs.

        Args:
            groups: The names.
            gathered: Makes the sums, where they are not those of last time.
        """
        if self._evidence is None or not set(groups) <= set(self._groups):
            self._groups, self._evidence = tuple(groups), None  # the old ones go before new ones come
            self._evidence = gathered()
        return self._evidence
