"""How large a body is where each joint's torque is read by a gain of its own, known within some per cent.

A body's torque at a joint is read as (1 + γ_j) times what it is, γ_j ~ N(0, GAIN_SPREAD²) for each joint. Joints then
need not agree to the last per cent on a mass, and none of them counts for more than its gain is known: with e_j the
body's torque at joint j, the columns e_j stand beside the body's own, each with that prior. What both sets have in
common does not enter: it was read by the same gains.

Source: Gautier and Briot 2011 (drive gains from a known load) for how far gains are off.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import Array, Float
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection
from ident.diagnosis.regression.positive import positive
from ident.diagnosis.regression.run_spread import residual_weights

# Standard deviation of what a drive's gain is off [1]: below that nobody calls it an error, beyond that it is one of
# the catalogue's (2 to 10 %), which a diagnosis names.
GAIN_SPREAD = 0.02
# Effects whose size is told by how large a torque is read: bodies.
BODIES = frozenset({"payload", "link_inertial_error"})


def solve_body(
    evidence: Evidence, model: Projection, group: Group, beta: Float[Array, " k"]
) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Scaled coefficients of a body and their covariance, gains that may be off counted.

    Args:
        evidence: The sums.
        model: The baseline with all named changes.
        group: The body.
        beta: Its scaled coefficients as the model has them.
    """
    layout, inside = evidence.layout, model.inside
    weights = residual_weights(evidence, model)
    size, n = len(inside), layout.n
    blocks = len(evidence.fold_of_block)
    cross, power = np.zeros((size, n)), np.zeros(n)
    scores = np.zeros((blocks, size + n))
    place = {int(column): k for k, column in enumerate(inside)}
    for j, (local, sums) in enumerate(zip(layout.local, evidence.white, strict=True)):
        at = [layout.places[j][int(column)] for column in group.columns]
        used = [k for k, column in enumerate(local) if int(column) in place]
        into = [place[int(local[k])] for k in used]
        whole = sums.sum(axis=0)
        cross[into, j] = whole[np.ix_(used, at)] @ beta
        power[j] = beta @ whole[np.ix_(at, at)] @ beta
        left = sums @ weights[local]
        scores[:, into] += left[:, used]
        scores[:, size + j] = left[:, at] @ beta
    information = np.linalg.inv(model.spread)
    gains = np.eye(n) / GAIN_SPREAD**2
    whole = np.block([[information, cross], [cross.T, np.diag(power) + gains]])
    bread = np.linalg.inv(positive(0.5 * (whole + whole.T)))
    # The model's own estimate zeroes its own scores: what moves it is what the gains' columns say.
    shift = bread @ np.concatenate([np.zeros(size), scores[:, size:].sum(axis=0)])
    meat = scores.T @ scores * blocks / max(blocks - 1, 1)
    meat += block_diag(np.zeros((size, size)), gains)
    robust = bread @ meat @ bread
    lift = np.sqrt(np.maximum(1.0, np.diag(bread) / np.maximum(np.diag(robust), 1e-300)))
    covariance = robust * np.outer(lift, lift)
    own = [place[int(column)] for column in group.columns]
    return beta + shift[own], covariance[np.ix_(own, own)]
