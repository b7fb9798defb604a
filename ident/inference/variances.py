"""What every model's variance components are, and what a model leaves of the rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.inference.settings import URDF
from ident.inference.sums import SessionSums
from ident.regression.baseline import UrdfError
from ident.regression.discrepancy import BLOCKS


@dataclass(frozen=True, eq=False)
class Components:
    """Variances beside a set of effects."""

    friction: Float[Array, " n"]  # relative spread of each joint's friction level
    walk: Float[Array, " n"]  # share of its variance that gathers as a random walk
    urdf: UrdfError  # by how much the URDF is off
    discrepancy: Float[Array, "n b"]  # variance of the whitened coefficients of each joint's blocks
    dispersion: Float[Array, " n"]  # what each joint's sums are divided by

    @classmethod
    def usual(cls, sums: SessionSums) -> Components:
        """Those before anything is known: a usual URDF, friction that varies much, and no
        discrepancy.

        Args:
            sums: The session's; they give the number of joints and the settings.
        """
        layout = sums.evidence.layout
        blocks = len(layout.flexible[0])
        return cls(
            friction=np.full(layout.n, sums.evidence.settings.wide_spread),
            walk=np.zeros(layout.n),
            urdf=UrdfError(),
            discrepancy=np.zeros((layout.n, blocks)),
            dispersion=np.ones(layout.n),
        )


@dataclass(frozen=True, eq=False)
class WeighedResidual:
    """What a model leaves of a session's rows."""

    weights: Float[Array, " P"]  # a row's product with these is what the model leaves of it
    mean_square: Float[Array, " n"]  # of each joint's whitened rows, after its discrepancy
    by_block: Float[Array, "n b"]  # whitened squares that each block of it explains

    def kind_of(self, joint: int) -> str | None:
        """Name of the block of a joint's discrepancy that explains most; None where none explains
        anything.
        """
        power = self.by_block[joint]
        return BLOCKS[int(np.argmax(power))] if power.any() else None


def log_prior_of(error: UrdfError) -> float:
    """Log prior of the URDF's error scales, up to a constant [nats]."""
    scale = np.log(error.scale) / np.log(URDF.usual_factor)
    com = error.com_m / URDF.usual_com_m
    return -0.5 * float(scale**2 + com**2)
