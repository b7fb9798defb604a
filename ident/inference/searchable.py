"""What a search over sets of effects needs of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from ident.arrays import Array, Float, Int
from ident.inference.names import Names
from ident.regression.design import Group
from ident.regression.least_squares import Prior


class Searchable(Protocol):
    """What a search needs of a model."""

    @property
    def sums(self) -> Any:
        """The session's sums; its `evidence` has the layout of all columns."""

    @property
    def names(self) -> Names:
        """The candidates with their priors."""

    @property
    def gram(self) -> Float[Array, "P P"]:
        """Products of all columns, summed over samples and joints; the torque comes last."""

    @property
    def last(self) -> int:
        """Index of the torque's column in `gram`."""

    def prior(self) -> Prior:
        """Prior of the baseline's parameters."""

    def information(
        self, chosen: Sequence[Group], prior: Prior
    ) -> tuple[Int[Array, " z"], Float[Array, "z z"]]:
        """Indices of the columns of the baseline and some effects, and their precision, prior
        included.

        Args:
            chosen: The effects.
            prior: Of the baseline's parameters.
        """
