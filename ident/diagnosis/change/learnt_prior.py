"""Empirical Bayes prior of the shared laws and of the URDF's error; inflation of joints' blocks.

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
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.settings import PRIOR
from ident.regression.factors import factorise
from ident.regression.gram import Evidence
from ident.regression.least_squares import RIDGE, Prior


@dataclass(frozen=True, eq=False)
class _Terms:
    """The columns that stand beside losses and inertias, and the term that each belongs to.

    Terms are the shared laws and, behind them, the changes.
    """

    columns: Int[Array, " f"]  # which of all each column is
    information: Float[Array, " f"]  # prior information on it at the largest plausible size
    term: Int[Array, " f"]  # number of its term
    widths: Int[Array, " g"]  # columns of each term


@dataclass(frozen=True, eq=False)
class _Variances:
    """What the fixed point estimates, as shares of the largest plausible variances."""

    terms: Float[Array, " g"]  # of each term
    urdf: float  # of the URDF's error

    def largest_step(self, earlier: _Variances) -> float:
        """By how much the logarithm of any of them changed."""
        of_terms = np.abs(np.log(self.terms / earlier.terms))
        return float(max([*of_terms, abs(np.log(self.urdf / earlier.urdf))]))


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
    terms = _terms(evidence, prior, shared, later)
    variances = _Variances(np.ones(len(terms.widths)), 1.0)
    present = np.arange(len(terms.columns))
    for _ in range(PRIOR.rounds):
        inside = np.concatenate([np.arange(first), terms.columns[present]])
        base = prior.base / variances.urdf
        largest = variances.terms[terms.term[present]]
        further = terms.information[present] / largest
        mean, covariance = _posterior(evidence, gram, inside, base, further)
        earlier = variances
        variances = _Variances(
            _term_variances(terms, present, mean[first:], np.diag(covariance)[first:], earlier),
            _urdf_variance(prior, mean, covariance, earlier.urdf),
        )
        if variances.largest_step(earlier) < PRIOR.close:
            break
        present = np.flatnonzero(variances.terms[terms.term] > PRIOR.absent)
    weights = np.zeros(layout.size + 1)
    weights[inside] = -mean
    weights[-1] = 1.0
    of_shared = variances.terms[terms.term[: layout.further]]
    assert prior.further is not None
    learnt = prior.further / np.maximum(of_shared, PRIOR.least)
    return replace(prior, base=prior.base / variances.urdf, further=learnt), weights


def _terms(
    evidence: Evidence,
    prior: Prior,
    shared: Sequence[int],
    later: Sequence[tuple[Int[Array, " k"], Float[Array, " k"]]],
) -> _Terms:
    """The terms of shared laws and changes; arguments as in `learn_prior`."""
    layout = evidence.layout
    assert prior.further is not None
    further = np.arange(layout.tuned - layout.further, layout.tuned)
    columns = np.concatenate([further, *(of_change for of_change, _ in later)]).astype(int)
    information = np.concatenate([prior.further, *(known for _, known in later)])
    widths = np.array([*shared, *(len(of_change) for of_change, _ in later)], dtype=int)
    return _Terms(columns, information, np.repeat(np.arange(len(widths)), widths), widths)


def _term_variances(
    terms: _Terms,
    present: Int[Array, " z"],
    mean: Float[Array, " z"],
    variance: Float[Array, " z"],
    earlier: _Variances,
) -> Float[Array, " g"]:
    """The next variance of each term: λ ← |μ / s|² / γ, within bounds; absent ones stay absent.

    Args:
        terms, present: The terms, and the columns that take part.
        mean, variance: Posterior of these columns' coefficients.
        earlier: The variances before.
    """
    term = terms.term[present]
    information = terms.information[present]
    count = len(terms.widths)
    square = np.bincount(term, mean**2 * information, count)
    left_open = np.bincount(term, variance * information, count)
    freedom = np.maximum(terms.widths - left_open / earlier.terms, 1e-6 * terms.widths)
    proposed = np.maximum(square / freedom, PRIOR.shrink * earlier.terms)
    proposed = np.clip(proposed, PRIOR.absent, 1.0)
    return np.where(earlier.terms > PRIOR.absent, proposed, PRIOR.absent)


def _urdf_variance(
    prior: Prior, mean: Float[Array, " z"], covariance: Float[Array, "z z"], earlier: float
) -> float:
    """The next variance of the URDF's error, from the posterior of the base parameters."""
    rank = len(prior.base)
    open_share = covariance[:rank, :rank] * prior.base
    left_open = float(np.sum(open_share)) / earlier
    freedom = max(rank - left_open, 1e-3 * rank)
    square = mean[:rank] @ prior.base @ mean[:rank]
    return float(np.clip(square / freedom, PRIOR.least_urdf, 1.0))


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
    ridge = RIDGE * np.diag(whole) + noise + 1e-9
    whole[np.diag_indices(len(inside))] += ridge
    last = np.arange(len(inside) - len(information), len(inside))
    whole[last, last] += information
    factor = factorise(whole)
    estimate = factor.solve(gram[inside, -1])
    return estimate, factor.solve(np.eye(len(inside)))


def measure_block_dispersion(evidence: Evidence, weights: Float[Array, " P"]) -> Float[Array, " n"]:
    """Variance inflation of each joint's block scores over whitened noise.

    The median over its columns, at least one.

    Args:
        evidence: Block sums.
        weights: Residual weights of a model: its residual of a row is their product.

    Returns:
        By joint, at least 1.
    """
    layout = evidence.layout
    inflation = np.ones(layout.n)
    for j, local in enumerate(layout.local):
        tuned = np.flatnonzero((local < layout.tuned) & (local >= layout.rank))
        score = evidence.times(j, weights[local])[:, tuned]
        power = evidence.total[j].diagonal()[tuned]
        seen = power > 1e-9 * power.max(initial=0.0)
        if not seen.any():
            continue
        squares = np.sum(score[:, seen] ** 2, axis=0)
        inflation[j] = max(1.0, float(np.median(squares / power[seen])))
    return inflation
