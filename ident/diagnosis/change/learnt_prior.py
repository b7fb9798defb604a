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
    columns = np.concatenate([np.arange(tuned), *(own for own, _ in later)]).astype(int)
    information = np.concatenate([np.zeros(first), prior.further, *(known for _, known in later)])
    widths = np.array([*shared, *(len(own) for own, _ in later)], dtype=int)
    term = np.concatenate([np.full(first, -1), np.repeat(np.arange(len(widths)), widths)])
    variance = np.ones(len(widths))
    urdf = 1.0
    kept = np.arange(len(columns))
    for _ in range(PRIOR.rounds):
        own = term[kept[first:]]
        at = columns[kept]
        whole = gram[np.ix_(at, at)].copy()
        whole[:rank, :rank] += prior.base / urdf
        diagonal = np.diag_indices(len(at))
        ridge = (
            RIDGE * np.diag(whole) + evidence.settings.noise_ridge * evidence.noise_power[at] + 1e-9
        )
        whole[diagonal] += ridge
        loose = information[kept[first:]]
        whole[np.arange(first, len(at)), np.arange(first, len(at))] += loose / variance[own]
        factor = factorise(whole)
        spread = factor.solve(np.eye(len(at)))
        mean = factor.solve(gram[at, -1])
        square = np.bincount(own, mean[first:] ** 2 * loose, len(widths))
        open_part = np.bincount(own, np.diag(spread)[first:] * loose, len(widths))
        freedom = np.maximum(widths - open_part / variance, 1e-6 * widths)
        free = np.clip(np.maximum(square / freedom, PRIOR.shrink * variance), PRIOR.absent, 1.0)
        new = np.where(variance > PRIOR.absent, free, PRIOR.absent)
        links = max(rank - float(np.sum(spread[:rank, :rank] * prior.base)) / urdf, 1e-3 * rank)
        error = float(
            np.clip(mean[:rank] @ prior.base @ mean[:rank] / links, PRIOR.least_urdf, 1.0)
        )
        converged = (
            np.abs(np.log(new / variance)).max() < PRIOR.close
            and abs(np.log(error / urdf)) < PRIOR.close
        )
        variance = new
        urdf = error
        if converged:
            break
        kept = np.concatenate(
            [np.arange(first), first + np.flatnonzero(variance[term[first:]] > PRIOR.absent)]
        )
    weights = np.zeros(layout.size + 1)
    weights[at] = -mean
    weights[-1] = 1.0
    further = prior.further / np.maximum(variance[term[first:tuned]], PRIOR.least)
    return replace(prior, base=prior.base / urdf, further=further), weights


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
