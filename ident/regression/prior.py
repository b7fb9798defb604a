"""What is known beforehand of a model's coefficients, and what keeps its solve well-posed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.design import Layout
from ident.regression.gram import Evidence

# Ridge of every unknown without a prior, as a share of its column's power: only keeps solves
# well-posed.
RIDGE = 1e-9
# Ridge, in multiples of its encoder noise, of an unknown whose column is nothing else: it stays at
# zero.
FIXED = 1e3
# A URDF as it is mostly believed.
USUAL_URDF = UrdfError()


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known beforehand: of the scaled base parameters by the URDF, of further columns by
    their usual size.
    """

    base: Float[Array, "r r"]  # information on the base parameters
    error: UrdfError = USUAL_URDF  # how far off the URDF is believed to be
    # Information on the scaled coefficient of each further column of the baseline; None for none.
    further: Float[Array, " f"] | None = None

    @classmethod
    def of(
        cls, evidence: Evidence, base: Float[Array, "r r"], error: UrdfError = USUAL_URDF
    ) -> Prior:
        """The prior in the evidence's column scale.

        Args:
            evidence: Sums, for scale and layout of the columns.
            base: Information on the change of the base parameters.
            error: How far the URDF was believed to be off for it.
        """
        layout = evidence.layout
        scale = evidence.scale[: evidence.layout.rank]
        sizes = evidence.scale[layout.tuned - layout.further : layout.tuned] * np.array(
            layout.further_std or np.nan
        )
        return cls(
            base / np.outer(scale, scale), error, sizes**-2.0 if layout.further_std else None
        )

    @classmethod
    def believing(cls, evidence: Evidence, baseline: Baseline, error: UrdfError) -> Prior:
        """The prior of a URDF that is off by so much, in the evidence's column scale.

        Args:
            evidence: Sums, for scale and layout of the columns.
            baseline: The tuned model.
            error: How far the URDF is believed to be off.
        """
        return cls.of(evidence, baseline.prior_of(error), error)

    def tightened(self, factor: float) -> Prior:
        """A copy with the URDF's standard deviations divided by a factor: 100 is as good as the
        URDF fixed.
        """
        return Prior(self.base * factor**2, self.error.divided(factor), self.further)

    def add_to(self, information: Float[Array, "z z"], layout: Layout) -> None:
        """Adds it, in place, to the information on a model whose first columns are those of the
        baseline.
        """
        information[: layout.rank, : layout.rank] += self.base
        if self.further is not None:
            further = np.arange(layout.tuned - layout.further, layout.tuned)
            information[further, further] += self.further


def ridge_of(
    gram: Float[Array, "P P"], evidence: Evidence, columns: Int[Array, " z"]
) -> Float[Array, " z"]:
    """What keeps a solve well-posed: information on the scaled coefficients of some columns that
    they be zero.

    Encoder noise was taken off the sums. A column of which nothing is left was nothing else: its
    coefficient, which may come out as anything, is fixed at zero.

    Args:
        gram: Whitened sums.
        evidence: Where they come from.
        columns: Indices of the columns.
    """
    power = np.diag(gram)[columns]
    noise = evidence.noise_power[columns]
    settings = evidence.settings
    share = np.where(power <= 0.0, FIXED, settings.noise_ridge)
    return np.asarray(RIDGE * np.abs(power) + share * noise + 1e-9)
