"""Empirical Bayes prior of the shared laws and of the URDF's error, and variance inflation of each
joint's blocks.

The baseline has hundreds of columns. At their largest plausible size they would explain whatever
short recordings hold, and leave nothing of a change; but most arms have few of these laws. So each
law g at each joint has a variance λ_g of its own, and the URDF's error has one:

    β_g ~ N(0, λ_g s_g²),    λ_g ← min(1, |μ_g / s_g|² / γ_g),    γ_g = k_g − tr Σ_gg / (λ_g s_g²),

with s the largest plausible size of its k coefficients, μ and Σ their posterior. Every change, at
one point of its grid, stands beside them with a variance of its own, so that a change does not
enlarge a shared law. The variation of a joint's block scores beyond its whitened noise is an error
of the noise model.

Source: MacKay 1992 (evidence framework, fixed point of the variances); Tipping 2001 (one variance a
term).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.settings import PRIOR
from ident.regression.gram import Evidence
from ident.regression.least_squares import RIDGE, Prior, factorise


def learn_prior(
    evidence: Evidence,
    prior: Prior,
    shared: Sequence[int],
    later: Sequence[tuple[Int[Array, " k"], Float[Array, " k"]]],
) -> tuple[Prior, Float[Array, " P"]]:
    """The prior with estimated variances, and the residual weights of the model solved with it.

    Args:
        evidence, prior: Block sums, and prior with the largest variances.
        shared: Number of columns of each shared law, in the order of the baseline's further
            columns.
        later: For each change its columns, and the prior information on them at its largest
            plausible size.
    """
    layout = evidence.layout
    gram = evidence.gram()
    first = layout.tuned - layout.further
    tuned = layout.tuned
    rank = layout.rank
    assert prior.further is not None
    # Of each further column: which of all it is, what is known of it, and the term it belongs to.
    columns = np.concatenate([np.arange(first, tuned), *(own for own, _ in later)]).astype(int)
    information = np.concatenate([prior.further, *(known for _, known in later)])
    widths = np.array([*shared, *(len(own) for own, _ in later)], dtype=int)
    term = np.repeat(np.arange(len(widths)), widths)
    # A variance of each term, and of the URDF's error.
    variance = np.ones(len(widths))
    urdf = 1.0
    present = np.arange(len(columns))
    for _ in range(PRIOR.rounds):
        term_of = term[present]
        loose = information[present]
        inside = np.concatenate([np.arange(first), columns[present]])
        base = prior.base / urdf
        mean, spread = _posterior(evidence, gram, inside, base, loose / variance[term_of])
        square = np.bincount(term_of, mean[first:] ** 2 * loose, len(widths))
        left_open = np.bincount(term_of, np.diag(spread)[first:] * loose, len(widths))
        freedom = np.maximum(widths - left_open / variance, 1e-6 * widths)
        free = np.maximum(square / freedom, PRIOR.shrink * variance)
        free = np.clip(free, PRIOR.absent, 1.0)
        new = np.where(variance > PRIOR.absent, free, PRIOR.absent)
        open_links = float(np.sum(spread[:rank, :rank] * prior.base)) / urdf
        links = max(rank - open_links, 1e-3 * rank)
        error_square = mean[:rank] @ prior.base @ mean[:rank]
        error = float(np.clip(error_square / links, PRIOR.least_urdf, 1.0))
        steps = [*np.abs(np.log(new / variance)), abs(np.log(error / urdf))]
        variance = new
        urdf = error
        if max(steps) < PRIOR.close:
            break
        present = np.flatnonzero(variance[term] > PRIOR.absent)
    weights = np.zeros(layout.size + 1)
    weights[inside] = -mean
    weights[-1] = 1.0
    of_shared = variance[term[: layout.further]]
    further = prior.further / np.maximum(of_shared, PRIOR.least)
    return replace(prior, base=prior.base / urdf, further=further), weights


def _posterior(
    evidence: Evidence,
    gram: Float[Array, "P P"],
    inside: Int[Array, " z"],
    base: Float[Array, "r r"],
    information: Float[Array, " f"],
) -> tuple[Float[Array, " z"], Float[Array, "z z"]]:
    """Mean and covariance of some columns' coefficients.

    Args:
        evidence: Block sums.
        gram: Their inner products, the measured torque's last.
        inside: The columns, the base's first.
        base: Prior information on the base's.
        information: Prior information on the further ones, which are last.
    """
    whole = gram[np.ix_(inside, inside)].copy()
    rank = len(base)
    whole[:rank, :rank] += base
    noise = evidence.settings.noise_ridge * evidence.noise_power[inside]
    whole[np.diag_indices(len(inside))] += RIDGE * np.diag(whole) + noise + 1e-9
    last = np.arange(len(inside) - len(information), len(inside))
    whole[last, last] += information
    factor = factorise(whole)
    return factor.solve(gram[inside, -1]), factor.solve(np.eye(len(inside)))


def measure_block_dispersion(evidence: Evidence, weights: Float[Array, " P"]) -> Float[Array, " n"]:
    """Variance inflation of each joint's block scores over whitened noise.

    The median over its columns, at least one.

    Args:
        evidence: Block sums.
        weights: Residual weights of a model: its residual of a row is their product.
    """
    layout = evidence.layout
    found = np.ones(evidence.layout.n)
    for j, local in enumerate(layout.local):
        own = np.flatnonzero((local < layout.tuned) & (local >= layout.rank))
        score = evidence.times(j, weights[local])[:, own]
        power = evidence.total[j].diagonal()[own]
        seen = power > 1e-9 * power.max(initial=0.0)
        if seen.any():
            found[j] = max(1.0, float(np.median(np.sum(score[:, seen] ** 2, axis=0) / power[seen])))
    return found
