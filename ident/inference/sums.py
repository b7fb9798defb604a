"""Sums of a session as the inference needs them: joint by joint, friction's own levels integrated
out.

Sums that encoder noise was taken off may have directions below zero, in which any evidence would
run away: such directions are zero here. What varies from run to run, each joint's friction, takes
its share off before that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, eigh

from ident.arrays import Array, Float
from ident.regression.gram import Evidence
from ident.regression.run_spread import spread_prior

# Shift of a correlation matrix's eigenvalues within which rounding may make them negative.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class SessionSums:
    """Whitened sums of every joint's columns, those of its discrepancy included, and the torque."""

    evidence: Evidence

    @cached_property
    def free(self) -> tuple[Float[Array, "p p"], ...]:
        """For each joint its sums over all time, friction's level being the same in all runs.

        Square, the joint's own columns first and the torque last.
        """
        whole = []
        for j, blocks in enumerate(self.evidence.free):
            sums = blocks.over()
            smooth = self.evidence.layout.flexible_places[j]
            sums[smooth] = self.evidence.flexible[j]
            sums[:, smooth] = self.evidence.flexible[j].T
            whole.append(sums)
        return tuple(whole)

    def of_joint(
        self, joint: int, spread: float, walk: float = 0.0
    ) -> tuple[Float[Array, "p p"], float]:
        """A joint's sums where each stretch has a friction level of its own.

        Args:
            joint: The joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
            walk: Share of that variance that gathers as a random walk.

        Returns:
            The sums; and the log determinant of the levels with the prior of their spread [nats].
        """
        settings = self.evidence.settings
        prior = spread_prior(spread, settings)
        if walk > 0.0:
            levels = self.evidence.friction.walking(joint, spread, walk)
            taken = levels.absorbed
            nats = levels.nats
        else:
            taken = self.evidence.friction.absorbed(joint, spread)
            nats = self._nats_of_levels(joint, spread)
        return without_negative_directions(self.free[joint] - taken), nats + prior

    def _nats_of_levels(self, joint: int, spread: float) -> float:
        """Log determinant of a joint's friction levels that don't hang on each other [nats]."""
        friction = self.evidence.friction
        sizes = spread * friction.level[joint]
        seen = friction.by_stretch[joint][:, :, friction.columns]
        widened = np.eye(2) + sizes[:, None] * seen * sizes
        _, log_determinant = np.linalg.slogdet(widened)
        return -0.5 * float(log_determinant.sum())


def without_negative_directions(sums: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Symmetric sums with the negative eigenvalues of their correlations set to zero.

    Returned as they are where no eigenvalue is negative.
    """
    power = np.diag(sums)
    root = np.where(power > 0.0, np.sqrt(np.maximum(power, 1e-300)), 1.0)
    correlation = sums / np.outer(root, root)
    try:
        cholesky(correlation + ROUNDING * np.eye(len(sums)), lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        correlation = 0.5 * (correlation + correlation.T)
        values, vectors = eigh(correlation, subset_by_value=(-np.inf, -ROUNDING))
        positive = correlation - (vectors * values) @ vectors.T
        return np.asarray(positive * np.outer(root, root))
    return sums
