"""Where training runs went, and how well the torque identified from them is known there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.fitting.identification import Identified
from ident.model.intervals import quantile
from ident.model.training_range import TrainingRange
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where
# the arm was.
TAILS = 0.001
# States at which the torque's interval is looked at, and the share of them that it holds for.
STATES = 2000
COVERED = 0.95
# States whose regressors are held at once.
STATES_AT_ONCE = 1000
# Least speed over which friction turns round [rad/s].
LEAST_WIDTH = 1e-9


def find_training_range(
    motions: Sequence[Motion], nominal: ArmModel, identified: Identified
) -> TrainingRange:
    """The range of training runs, and how well the torque is known there.

    Args:
        motions: The runs.
        nominal: The arm whose base parameters were identified.
        identified: What was identified.
    """
    parts = []
    for motion in motions:
        coarse = motion.coarse
        of_run = np.stack([motion.q[coarse], motion.dq[coarse], motion.ddq[coarse]])
        parts.append(of_run)
    states = np.concatenate(parts, axis=1)
    low, high = np.quantile(states, [TAILS, 1.0 - TAILS], axis=1)
    even = np.unique(np.linspace(0, states.shape[1] - 1, STATES).astype(int))
    pieces = np.array_split(even, -(-len(even) // STATES_AT_ONCE))
    variances = [_torque_variance(states[:, rows], nominal, identified) for rows in pieces]
    deviation = np.sqrt(np.quantile(np.concatenate(variances), COVERED, axis=0))
    half = deviation * float(np.median(quantile(identified.estimate.dof)))
    return TrainingRange(nominal.joint_names, low, high, half)


def _torque_variance(
    states: Float[Array, "3 T n"], nominal: ArmModel, identified: Identified
) -> Float[Array, "T n"]:
    """Variance of each joint's torque: of its parameters, and of friction between runs [N² m²]."""
    q, dq, ddq = states
    estimate = identified.estimate
    params = identified.loss.params
    regressor = nominal.regressor(q, dq, ddq, identified.inertia.base.columns)
    sign = np.tanh(dq / np.maximum(params.transition_speed, LEAST_WIDTH))
    every = np.stack([ddq, dq, sign, np.ones_like(dq)], axis=-1)
    losses = every[..., : estimate.per_joint]
    base = np.arange(estimate.rank)
    known = estimate.about(estimate.values)
    variance = np.empty(dq.shape)
    for j in range(nominal.n):
        index = np.concatenate([base, estimate.index(j)])
        x = np.concatenate([regressor[:, j], losses[:, j]], axis=1)
        covariance = known[np.ix_(index, index)]
        levels = np.array([params.viscous[j], params.coulomb[j]])
        viscous, coulomb = estimate.spread[j] * levels
        variance[:, j] = np.sum((x @ covariance) * x, axis=1)
        of_viscous = (viscous * dq[:, j]) ** 2
        of_coulomb = (coulomb * sign[:, j]) ** 2
        variance[:, j] += of_viscous + of_coulomb
    return variance
