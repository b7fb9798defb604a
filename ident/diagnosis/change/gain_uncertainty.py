"""How large a body is where each joint's torque is read by a gain of its own, known within some per cent.

A body's torque at a joint is read as (1 + γ_j) times what it is, γ ~ N(0, own² I + common² 11ᵀ). Joints then need not
agree to the last per cent on a mass, and none of them counts for more than its gain is known: with e_j the body's
torque at joint j, the columns e_j stand beside the body's own, with that prior. What both sets have in common does not
enter: it was read by the same gains.

Source: Gautier and Briot 2011 (drive gains from a known load) for how far gains are off; data sheets of brushless
motors state torque constants within ± 10 %; the remanence of neodymium magnets falls by 0.11 % a kelvin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import Array, Float
from ident.effects.catalogue import CATALOGUE
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.positive import positive
from ident.regression.run_spread import block_sums_left, lifted

# Effects whose size is known by how large a torque is read: bodies.
BODIES = frozenset(one.id for one in CATALOGUE if one.as_change.body)


@dataclass(frozen=True)
class GainUncertainty:
    """How well the gains are known by which torques are read."""

    own: float  # standard deviation of each joint's own error [1]
    common: float = 0.0  # standard deviation of the error that all joints share [1]

    def information(self, n: int) -> Float[Array, "n n"]:
        """Inverse of the covariance of the errors of n joints."""
        return np.asarray(np.linalg.inv(self.own**2 * np.eye(n) + self.common**2 * np.ones((n, n))))


# A torque that the drive or a sensor states: below that nobody calls a gain wrong, beyond that it is an error of the
# catalogue's (2 to 10 %), which a diagnosis names.
STATED = GainUncertainty(own=0.02)
# A current times a gain: each motor's constant is within ± 10 % (two deviations) of its data sheet, and magnets that
# are 30 K warmer than there make all of them weaker alike.
BY_CURRENT = GainUncertainty(own=0.05, common=0.033)


def solve_body(
    evidence: Evidence, model: Projection, group: Group, beta: Float[Array, " k"], doubt: GainUncertainty = STATED
) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Scaled coefficients of a body and their covariance, gains that may be off counted.

    Args:
        evidence: The sums.
        model: The baseline with all named changes.
        group: The body.
        beta: Its scaled coefficients as the model has them.
        doubt: How well the gains are known.
    """
    layout, inside = evidence.layout, model.inside
    size, n = len(inside), layout.n
    blocks = len(evidence.fold_of_block)
    body, sums = np.zeros(layout.size + 1), np.zeros((layout.size + 1, n))
    body[group.columns] = beta
    torques = np.zeros((blocks, n))
    for j, (local, total) in enumerate(zip(layout.local, evidence.total, strict=True)):
        sums[local, j] = total.times(body[local])[0]
        torques[:, j] = evidence.times(j, model.weights[local]) @ body[local]
    cross, power = sums[inside], body @ sums
    scores = np.concatenate([block_sums_left(evidence, model)[:, inside], torques], axis=1)
    information = np.linalg.inv(model.spread)
    gains = doubt.information(n)
    whole = np.block([[information, cross], [cross.T, np.diag(power) + gains]])
    bread = np.linalg.inv(positive(0.5 * (whole + whole.T)))
    # The model's own estimate zeroes its own scores: what moves it is what the gains' columns say.
    shift = bread @ np.concatenate([np.zeros(size), scores[:, size:].sum(axis=0)])
    meat = scores.T @ scores * blocks / max(blocks - 1, 1)
    meat += block_diag(np.zeros((size, size)), gains)
    covariance = lifted(bread @ meat @ bread, bread)
    own = model.places(group.columns)
    return beta + shift[own], covariance[np.ix_(own, own)]
