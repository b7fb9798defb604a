"""Size of a body when each joint's torque is read with an uncertain gain.

A body's torque at joint j is read as (1 + γ_j) times its value, γ ~ N(0, single² I + common² 11ᵀ).
With e_j the body's torque at joint j, the columns e_j with that prior stand beside the body's own:
joints need not agree on a mass to the last per cent. The torque that both sets have in common does
not matter, for it is read with the same gains.

Source: Gautier and Briot 2011 (drive gains from a known load) for the size of gain errors; data
sheets of brushless motors state torque constants within ± 10 %; the remanence of neodymium magnets
falls by 0.11 % a kelvin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import Array, Float
from ident.effects.catalogue import CATALOGUE
from ident.regression.design import Group
from ident.regression.factors import positive
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.run_spread import block_sums_left, floor_at_model_variance

# Effects whose size is proportional to the gains of the readings: bodies.
BODIES = frozenset(effect.id for effect in CATALOGUE if effect.as_change.body)


@dataclass(frozen=True)
class GainUncertainty:
    """Prior standard deviations of the gains of the torque readings."""

    single: float  # standard deviation of each joint's own error [1]
    common: float = 0.0  # standard deviation of the error that all joints share [1]


# Torque by the drive or a sensor: larger errors (2 to 10 %) are an effect of the catalogue.
STATED = GainUncertainty(single=0.02)
# Current times a gain: each motor's constant is within ± 10 % (two standard deviations) of its data
# sheet, and magnets that are 30 K warmer weaken all of them alike.
BY_CURRENT = GainUncertainty(single=0.05, common=0.033)


def gain_information(uncertainty: GainUncertainty, n: int) -> Float[Array, "n n"]:
    """Inverse of the covariance of the gain errors of n joints, shares of one."""
    single = uncertainty.single**2 * np.eye(n)
    common = uncertainty.common**2 * np.ones((n, n))
    covariance = single + common
    return np.asarray(np.linalg.inv(covariance))


def solve_body(
    evidence: Evidence,
    model: Projection,
    group: Group,
    beta: Float[Array, " k"],
    uncertainty: GainUncertainty = STATED,
) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Scaled coefficients of a body and their covariance, with uncertain gains.

    Args:
        evidence, model: Block sums, and the baseline with all changes.
        group, beta: The body, and its scaled coefficients by the model.
        uncertainty: Prior of the gains.
    """
    layout = evidence.layout
    inside = model.inside
    size = len(inside)
    n = layout.n
    blocks = len(evidence.fold_of_block)
    body = np.zeros(layout.size + 1)
    sums = np.zeros((layout.size + 1, n))
    body[group.columns] = beta
    torques = np.zeros((blocks, n))
    for j, (local, total) in enumerate(zip(layout.local, evidence.total, strict=True)):
        sums[local, j] = total.times(body[local])[0]
        scores = evidence.times(j, model.weights[local])
        torques[:, j] = scores @ body[local]
    cross = sums[inside]
    power = body @ sums
    scores = np.concatenate([block_sums_left(evidence, model)[:, inside], torques], axis=1)
    information = np.linalg.inv(model.spread)
    gains = gain_information(uncertainty, n)
    whole = np.block([[information, cross], [cross.T, np.diag(power) + gains]])
    bread = np.linalg.inv(positive(0.5 * (whole + whole.T)))
    # The model's scores are zero at its estimate, so only those of the gains' columns shift it.
    of_gains = scores[:, size:].sum(axis=0)
    shift = bread @ np.concatenate([np.zeros(size), of_gains])
    meat = scores.T @ scores * blocks / max(blocks - 1, 1)
    meat += block_diag(np.zeros((size, size)), gains)
    covariance = floor_at_model_variance(bread @ meat @ bread, bread)
    places = model.places(group.columns)
    return beta + shift[places], covariance[np.ix_(places, places)]
