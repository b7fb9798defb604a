"""Variance components of the URDF's error, and Bayes factors of inertia-like effects with these components free.

The prior says that inertias are within some per cent of the URDF. Inertia-like effects (a payload, one link's mass, a
scaled torque) are tested by how much they explain beyond that prior, so its width matters. URDFs differ: some hold a
maker's own values, others are off by a fifth at every link, or by two centimetres in every centre of mass. The error
has two scales, e = (s, c), found on a grid by the marginal likelihood

    log p(y | e) = −½ (misfit(e) + log|I + P(e)| − log|P(e)|) + log p(e),

with P(e) the prior's information and I that of the recordings about the base parameters. An inertia-like effect is kept
if its Bayes factor at the best e with it against the best e without it is large enough; else the search is repeated
with the best e without it.

Source: MacKay 1992 (evidence for a scale); Gelman 2006 (priors of scales).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.settings import SelectionSettings
from ident.effects.base import SessionContext
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.design import Group
from ident.regression.least_squares import Prior, factorise, project
from ident.regression.run_spread import measure_inflation


@dataclass(frozen=True)
class UrdfErrorFit:
    """Scales of the URDF's error with their log evidence."""

    error: UrdfError  # the scales
    log_evidence: float  # marginal likelihood of the recordings, prior of the scales included [nats]


def fit_urdf_error(
    search: Search, baseline: Baseline, groups: Sequence[Group], inflation: float, error: UrdfError | None = None
) -> UrdfErrorFit:
    """Scales of the URDF's error that have the greatest log evidence, beside the baseline and some effects.

    Args:
        search: The session's sums.
        baseline: The tuned model, from which priors are built.
        groups, inflation: The effects, and variance inflation.
        error: Lower bound of the scales; those of the search's prior if None.
    """
    least = search.prior.error if error is None else error
    tried = []
    for other in _error_grid(search.settings):
        wider = UrdfError(max(other.scale, least.scale), max(other.com_m, least.com_m), least.usual)
        prior = Prior.believing(search.evidence, baseline, wider)
        log_evidence = _log_evidence(search, prior, groups, inflation) - _minus_log_prior(wider, search.settings)
        tried.append(UrdfErrorFit(wider, log_evidence))
    return max(tried, key=lambda fit: fit.log_evidence)


def initial_urdf_error(search: Search, baseline: Baseline) -> UrdfErrorFit:
    """Scales of the URDF's error before any effect is accepted: alone, or beside the best inertia-like candidate.

    A payload that is not accepted yet would otherwise pass for a URDF that is wrong everywhere.

    Args:
        search, baseline: The search, and the tuned model, from which priors are built.
    """
    tuned = project(search.evidence.gram(), search.evidence, search.prior)
    inflation = measure_inflation(search.evidence, tuned)
    alone = fit_urdf_error(search, baseline, (), inflation)
    if alone.error == search.prior.error:
        return alone
    tried = [alone]
    for _, group in search.best_by_key(tuned).values():
        if group.effect.inertia_like:
            beside = fit_urdf_error(search, baseline, [group], inflation)
            tried.append(replace(beside, log_evidence=beside.log_evidence - search.complexity_cost(group)))
    return max(tried, key=lambda fit: fit.log_evidence)


def log_bayes_factor(
    search: Search, session: SessionContext, baseline: Baseline, group: Group, others: Sequence[Group], inflation: float
) -> float:
    """Log Bayes factor of an inertia-like effect, the URDF's error scales maximised with it and without it [nats].

    Its coefficients have the prior of its size (`Effect.size_prior`, or `Effect.prior_scale`) or, without one, the cost
    of free parameters.

    Args:
        search, session, baseline: The session's sums, its runs, and the tuned model.
        group, others: The effect, and the effects beside it.
        inflation: Variance inflation.
    """
    evidence, gram = search.evidence, search.evidence.gram()
    columns = np.append(group.columns, len(gram) - 1)
    usual = group.effect.prior_scale(session, group.joint, group.variant)
    without, beside = [], []
    for error in _error_grid(search.settings):
        prior = Prior.believing(evidence, baseline, replace(error, usual=search.prior.error.usual))
        alone = _log_evidence(search, prior, others, inflation) - _minus_log_prior(error, search.settings)
        view = project(gram, evidence, prior, others, columns)
        (gain, scaled), known = view.gain(group), view.rest(group.columns) / inflation
        if group.prior is not None:
            cost = search.prior_cost(group, group.prior, scaled, known)
        elif usual is None:
            cost = search.complexity_cost(group)
        else:
            size = usual[: len(group.columns)] * evidence.scale[group.columns]
            cost = 0.5 * float(np.linalg.slogdet(np.eye(len(size)) + size[:, None] * known * size)[1])
        without.append(alone)
        beside.append(alone + 0.5 * gain / inflation - cost)
    return max(beside) - max(without)


def _error_grid(settings: SelectionSettings) -> list[UrdfError]:
    """All scales of the URDF's error that are tried."""
    return [UrdfError(scale, com) for scale, com in product(settings.urdf_scales, settings.urdf_com_m)]


def _minus_log_prior(error: UrdfError, settings: SelectionSettings) -> float:
    """Minus the log prior of the URDF's error scales, up to a constant [nats]."""
    ratio = np.log(error.scale) / np.log(settings.usual_urdf_factor)
    return 0.5 * float(ratio**2 + (error.com_m / settings.usual_urdf_com_m) ** 2)


def one_link_is_wrong(search: Search, baseline: Baseline, groups: Sequence[Group], inflation: float) -> bool:
    """Whether a single link that is far off explains the recordings better than a URDF that is off everywhere.

    Args:
        search: The session's sums and prior.
        baseline: The tuned model, from which priors are built.
        groups, inflation: The effects beside which it is tested, and variance inflation.
    """
    evidence, settings, error = search.evidence, search.settings, search.prior.error
    everywhere = fit_urdf_error(search, baseline, groups, inflation).log_evidence
    priors = [baseline.prior_of(error, k, settings.wrong_link_factor) for k in range(evidence.layout.n)]
    alone = max(_log_evidence(search, Prior.of(evidence, one), groups, inflation) for one in priors)
    return bool(alone - np.log(len(priors)) > everywhere + settings.unlikely_nats)


def _log_evidence(search: Search, prior: Prior, groups: Sequence[Group], inflation: float) -> float:
    """Log evidence of the model with a given prior of the inertias [nats]."""
    gram = search.evidence.gram()
    model = project(gram, search.evidence, prior, groups, np.array([len(gram) - 1]))
    known = _information_on_inertias(gram, model.inside, len(prior.base)) / inflation
    occam = float(np.linalg.slogdet(prior.base + known)[1] - np.linalg.slogdet(prior.base)[1])
    return -0.5 * (model.misfit / inflation + occam)


def _information_on_inertias(gram: Float[Array, "P P"], inside: Int[Array, " z"], rank: int) -> Float[Array, "r r"]:
    """Information of the recordings about the base parameters, the model's other columns profiled out."""
    base, others = inside[:rank], inside[rank:]
    inner = gram[np.ix_(others, others)].copy()
    inner[np.diag_indices(len(inner))] += 1e-9 * np.diag(inner) + 1e-9
    across = gram[np.ix_(others, base)]
    known: Array = gram[np.ix_(base, base)] - across.T @ factorise(inner).solve(across)
    # Encoder noise was subtracted from the sums, so eigenvalues may come out negative: they hold no information.
    values, vectors = np.linalg.eigh(0.5 * (known + known.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
