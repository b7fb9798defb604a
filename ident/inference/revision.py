"""Variance components that are likeliest beside a set of effects, one kind after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ident.arrays import Array, Float
from ident.inference.components import ModelSums
from ident.inference.evidence import optimise
from ident.inference.settings import URDF
from ident.inference.variances import Components
from ident.regression.baseline import UrdfError
from ident.regression.design import Group
from ident.regression.friction_walk import estimate_walk
from ident.regression.gram import Evidence

# Whitened rows of a joint below which nothing is learnt of its discrepancy.
FEWEST_ROWS = 20
# Variances of whitened coefficients that a block starts from where nothing is known of it.
FIRST_VARIANCES = (1e-4, 1e-1)


def discrepancy_at(
    model: ModelSums, joint: int, chosen: Sequence[Group], warm: bool = True
) -> tuple[Float[Array, " b"], float]:
    """Variances of a joint's discrepancy beside a set of effects, and their log evidence [nats].

    Args:
        model: Sums, with variances at other joints as they are.
        joint: Index of the joint.
        chosen: The effects.
        warm: Whether to begin with the joint's present variances alone; else from several starts.

    Returns:
        The variances by block, all 0 where the joint has too few rows or none explains anything;
        and the log evidence against no discrepancy.
    """
    before = model.components.discrepancy[joint]
    if model.sums.evidence.samples[joint] < FEWEST_ROWS:
        return np.zeros_like(before), 0.0
    groups = model.sums.evidence.layout.flexible[joint]
    sizes = [len(group.columns) for group in groups]
    starts = [np.full(len(groups), value) for value in FIRST_VARIANCES]
    if warm and before.any():
        starts = [np.maximum(before, FIRST_VARIANCES[0])]
    sums = model.beside(joint, chosen)
    matrix = sums[:-1, :-1]
    target = sums[:-1, -1]
    fits = [optimise(matrix, target, sizes, start) for start in starts]
    best = max(fits, key=lambda fit: fit.nats)
    return best.variances, best.nats


def evidence_of(model: ModelSums) -> Evidence:
    """A model's sums of the session, with the model's friction spread and dispersion."""
    components = model.components
    spread = model.sums.evidence.with_run_spread(components.friction)
    return spread.with_dispersion(components.dispersion)


def friction_beside(model: ModelSums, joints: Sequence[int], chosen: Sequence[Group]) -> ModelSums:
    """Sums with the friction spread of some joints that is likeliest beside a set of effects.

    Args:
        model: Sums, with the other components as they are.
        joints: Indices of the joints.
        chosen: The effects.
    """
    evidence = evidence_of(model)
    weights = model.residual(chosen).weights
    return model.with_friction({j: estimate_walk(evidence, j, weights) for j in joints})


def revise(model: ModelSums, chosen: Sequence[Group], warm: bool = True) -> Components:
    """Variance components that are likeliest beside a set of effects, one after the other.

    Args:
        model: Sums with the present components.
        chosen: The effects.
        warm: Whether discrepancies begin at their present variances.
    """
    evidence = evidence_of(model)
    variances = {}
    for joint in range(evidence.layout.n):
        of_blocks, _ = discrepancy_at(model, joint, chosen, warm)
        variances[joint] = of_blocks
    model = model.with_discrepancy(variances)
    error = max(urdf_errors(), key=lambda tried: model.log_evidence(chosen, tried))
    model = model.with_urdf(error)
    residual = model.residual(chosen)
    friction = np.zeros(evidence.layout.n)
    walk = np.zeros(evidence.layout.n)
    for joint in range(evidence.layout.n):
        friction[joint], walk[joint] = estimate_walk(evidence, joint, residual.weights)
    by_residual = model.components.dispersion * residual.mean_square
    dispersion = np.maximum(1.0, by_residual)
    return replace(
        model.components,
        friction=friction,
        walk=walk,
        dispersion=dispersion,
    )


def urdf_errors() -> list[UrdfError]:
    """All scales of the URDF's error that are tried."""
    scales = product(URDF.scales, URDF.com_m)
    return [UrdfError(scale, com) for scale, com in scales]
