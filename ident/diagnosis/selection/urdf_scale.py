"""How wrong the URDF's inertias are: variance components, estimated where something hangs on them.

Inertias are believed to be within some per cent of the URDF. What acts like other inertias (a payload, another link's
mass, a scaled torque) is judged by how much it explains beyond that belief. URDFs differ: some hold a maker's own
numbers, others are off by a fifth at every link, or by two centimetres in every centre of mass, which is little at an
upper arm and all at a wrist. So how far off it is has two scales of its own, e = (s, c), with

    log p(y | e) = −½ (misfit(e) + log|I + P(e)| − log|P(e)|) + log p(e),

P(e) the information of the belief, I that of the recordings about the base parameters. A name of that kind stands only
if the best belief with it beats the best one without it; where it doesn't, the URDF is taken to be as wrong as the best
belief without it says, and the search is done again.

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
from ident.regression.least_squares import Prior, project
from ident.regression.positive import factorise
from ident.regression.run_spread import measure_inflation


@dataclass(frozen=True)
class Belief:
    """A belief about a URDF, and its log evidence [nats]."""

    error: UrdfError
    evidence: float


def best_belief(
    search: Search, baseline: Baseline, groups: Sequence[Group], inflation: float, error: UrdfError | None = None
) -> Belief:
    """How far off the URDF is, most probably, beside the baseline and some effects.

    Args:
        search: The session's sums.
        baseline: What the belief is made of.
        groups: The effects.
        inflation: How many times the modelled variance the misfit has.
        error: How far off it is at least; as the search believes if None.
    """
    least = search.prior.error if error is None else error
    tried = []
    for other in _errors(search.settings):
        wider = UrdfError(max(other.scale, least.scale), max(other.com_m, least.com_m), least.usual)
        prior = Prior.believing(search.evidence, baseline, wider)
        tried.append(Belief(wider, _evidence(search, prior, groups, inflation) - _cost(wider, search.settings)))
    return max(tried, key=lambda belief: belief.evidence)


def first_belief(search: Search, baseline: Baseline) -> Belief:
    """How far off the URDF is before anything is named: alone, or beside the one body that explains most.

    A load that is not yet named must not pass for a URDF that is wrong everywhere.

    Args:
        search: The session's sums.
        baseline: What the belief is made of.
    """
    tuned = project(search.evidence.gram(), search.evidence, search.prior)
    inflation = measure_inflation(search.evidence, tuned)
    alone = best_belief(search, baseline, (), inflation)
    if alone.error == search.prior.error:
        return alone
    tried = [alone]
    for _, group in search.best_by_key(tuned).values():
        if group.effect.inertia_like:
            beside = best_belief(search, baseline, [group], inflation)
            tried.append(replace(beside, evidence=beside.evidence - search.cost_of(group)))
    return max(tried, key=lambda belief: belief.evidence)


def added_evidence(
    search: Search,
    session: SessionContext,
    baseline: Baseline,
    group: Group,
    others: Sequence[Group],
    inflation: float,
) -> float:
    """Log evidence for a name of the inertias' kind, the URDF as wrong as it likes with it and without it [nats].

    Its coefficients are as large beforehand as its catalogue says (`Effect.size_prior`, or `Effect.prior_scale`), or
    cost what any free parameter does.
    """
    evidence, gram = search.evidence, search.evidence.gram()
    columns = np.append(group.columns, len(gram) - 1)
    lone = replace(group, columns=np.arange(len(group.columns)))
    usual = group.effect.prior_scale(group.effect.asked(session), group.joint, group.variant)
    without, beside = [], []
    for error in _errors(search.settings):
        prior = Prior.believing(evidence, baseline, replace(error, usual=search.prior.error.usual))
        alone = _evidence(search, prior, others, inflation) - _cost(error, search.settings)
        view = project(gram, evidence, prior, others, columns)
        (gain, scaled), known = view.gain(lone), view.rest(lone.columns) / inflation
        if group.prior is not None:
            cost = search.cost_of_size(group, group.prior, scaled, known)
        elif usual is None:
            cost = search.cost_of(group)
        else:
            size = usual[: len(group.columns)] * evidence.scale[group.columns]
            cost = 0.5 * float(np.linalg.slogdet(np.eye(len(size)) + size[:, None] * known * size)[1])
        without.append(alone)
        beside.append(alone + 0.5 * gain / inflation - cost)
    return max(beside) - max(without)


def _errors(settings: SelectionSettings) -> list[UrdfError]:
    """How far off a URDF may be."""
    return [UrdfError(scale, com) for scale, com in product(settings.urdf_scales, settings.urdf_com_m)]


def _cost(error: UrdfError, settings: SelectionSettings) -> float:
    """What is unusual of a URDF's error costs beforehand [nats]."""
    ratio = np.log(error.scale) / np.log(settings.usual_urdf_factor)
    return 0.5 * float(ratio**2 + (error.com_m / settings.usual_urdf_com_m) ** 2)


def one_link_is_wrong(search: Search, baseline: Baseline, groups: Sequence[Group], inflation: float) -> bool:
    """Whether one link that is far off explains the recordings better than a URDF that is off everywhere.

    Args:
        search: The session's sums, and the belief that one starts from.
        baseline: What the belief is made of.
        groups: The effects beside which it is tested.
        inflation: How many times the modelled variance the misfit has.
    """
    evidence, settings, error = search.evidence, search.settings, search.prior.error
    everywhere = best_belief(search, baseline, groups, inflation).evidence
    priors = [baseline.prior_of(error, k, settings.wrong_link_factor) for k in range(evidence.layout.n)]
    alone = max(_evidence(search, Prior.of(evidence, one), groups, inflation) for one in priors)
    return bool(alone - np.log(len(priors)) > everywhere + settings.unlikely_nats)


def _evidence(search: Search, belief: Prior, groups: Sequence[Group], inflation: float) -> float:
    """Log evidence of a belief about the URDF [nats]."""
    gram = search.evidence.gram()
    model = project(gram, search.evidence, belief, groups, np.array([len(gram) - 1]))
    known = _information_on_inertias(gram, model.inside, len(belief.base)) / inflation
    occam = float(np.linalg.slogdet(belief.base + known)[1] - np.linalg.slogdet(belief.base)[1])
    return -0.5 * (model.misfit / inflation + occam)


def _information_on_inertias(gram: Float[Array, "P P"], inside: Int[Array, " z"], rank: int) -> Float[Array, "r r"]:
    """Information of the recordings about the base parameters, beside the model's other columns."""
    base, others = inside[:rank], inside[rank:]
    inner = gram[np.ix_(others, others)].copy()
    inner[np.diag_indices(len(inner))] += 1e-9 * np.diag(inner) + 1e-9
    across = gram[np.ix_(others, base)]
    known: Array = gram[np.ix_(base, base)] - across.T @ factorise(inner).solve(across)
    # Sums without encoder noise are estimates; a direction that they don't show says nothing.
    values, vectors = np.linalg.eigh(0.5 * (known + known.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
