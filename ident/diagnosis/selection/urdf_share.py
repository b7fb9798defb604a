"""How wrong the URDF's inertias are: a variance component, estimated where something hangs on it.

Inertias are believed to be within some per cent of the URDF. What acts like other inertias (a payload, another link's
mass, a scaled torque) is judged by how much it explains beyond that belief. URDFs differ: some hold a maker's own
numbers, others are off by a fifth at every link. So the belief is a scale, s, of its own, with

    log p(y | s) = −½ (misfit(s) + log|I + P/s²| − log|P/s²|) + log p(s),

P the information of a belief of scale one, I that of the recordings about the base parameters. A name of that kind
stands only if the best scale with it beats the best scale without it; where it doesn't, the URDF is taken to be as
wrong as the best scale without it says, and the search is done again.

Source: MacKay 1992 (evidence for a scale); Gelman 2006 (priors of scales).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.regression.baseline import Baseline
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Prior, Projection, project
from ident.diagnosis.regression.positive import positive
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings


def scale_evidence(
    gram: Float[Array, "P P"],
    evidence: Evidence,
    prior: Prior,
    groups: Sequence[Group],
    spare: float,
    settings: SelectionSettings = USUAL_SELECTION,
) -> Float[Array, " s"]:
    """Log evidence of each scale of the URDF's error, for the baseline and some effects [nats].

    Args:
        gram: Sums of the whole session.
        evidence: Where they come from.
        prior: The belief that one starts from.
        groups: The effects.
        spare: How many times the modelled variance the misfit has.
        settings: Which scales, and how far the usual URDF is off.
    """
    beliefs = [prior.tightened(1.0 / scale) for scale in settings.urdf_scales]
    unusual = 0.5 * (np.log(settings.urdf_scales) / np.log(settings.usual_urdf_factor)) ** 2
    return np.array([_evidence(gram, evidence, belief, groups, spare) for belief in beliefs]) - unusual


def one_link_is_wrong(search: Search, baseline: Baseline, groups: Sequence[Group], spare: float) -> bool:
    """Whether one link that is far off explains the recordings better than a URDF that is off everywhere.

    Args:
        search: The session's sums, and the belief that one starts from.
        baseline: What the belief is made of.
        groups: The effects beside which it is asked.
        spare: How many times the modelled variance the misfit has.
    """
    evidence, gram, settings = search.evidence, search.evidence.gram(), search.settings
    everywhere = scale_evidence(gram, evidence, search.prior, groups, spare, settings).max()
    priors = [baseline.prior_of_a_wrong_link(k, settings.wrong_link_factor) for k in range(evidence.layout.n)]
    widened = [Prior.of(evidence, one) for one in priors]
    beliefs = [belief.tightened(search.prior.factor) for belief in widened]
    alone = max(_evidence(gram, evidence, belief, groups, spare) for belief in beliefs)
    return bool(alone - np.log(len(beliefs)) > everywhere + settings.unlikely_nats)


def _evidence(
    gram: Float[Array, "P P"], evidence: Evidence, belief: Prior, groups: Sequence[Group], spare: float
) -> float:
    """Log evidence of a belief about the URDF [nats]."""
    model = project(gram, evidence, belief, groups)
    told = np.linalg.slogdet(belief.base + _told_of_inertias(gram, model, len(belief.base)) / spare)[1]
    occam = float(told - np.linalg.slogdet(belief.base)[1])
    return -0.5 * (model.misfit / spare + occam)


def _told_of_inertias(gram: Float[Array, "P P"], model: Projection, rank: int) -> Float[Array, "r r"]:
    """Information of the recordings about the base parameters, beside the model's other columns."""
    base, others = model.inside[:rank], model.inside[rank:]
    inner = gram[np.ix_(others, others)].copy()
    inner[np.diag_indices(len(inner))] += 1e-9 * np.diag(inner) + 1e-9
    across = gram[np.ix_(others, base)]
    told: Array = gram[np.ix_(base, base)] - across.T @ np.linalg.solve(positive(inner), across)
    # Sums without encoder noise are estimates; a direction that they don't show tells nothing.
    values, vectors = np.linalg.eigh(0.5 * (told + told.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
