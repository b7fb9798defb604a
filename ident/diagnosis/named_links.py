"""Acceptance of link inertia errors: links that differ from the URDF by more than its tolerance.

Tuning absorbs a wrong link, so that the stepwise selection does not see it. The evidence for a wrong link is the log
Bayes factor of its own error scale, or of a link's that could take its place (`TunedLink.evidence`), beside all
accepted effects; the latter are reported as other places. A payload, a gain error of its joint and the link itself act
on the same base parameters: the likeliest of them is accepted, and the others form its class as far as the recordings
cannot distinguish them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.diagnosis.alternate import Selection
from ident.diagnosis.reservations import find_implausible
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.selection.name_probability import (
    SEPARATE_SHARE,
    Estimate,
    compare_rivals,
    estimate_effects,
    odds_of,
)
from ident.diagnosis.selection.refine import refine
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.settings import SelectionSettings
from ident.diagnosis.settings import VerdictSettings
from ident.diagnosis.tuned_links import ABOUT, Places, measure_tuned_links
from ident.effects.base import SessionContext
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.least_squares import Prior, project
from ident.regression.run_spread import measure_inflation


def name_wrong_links(
    selected: Selection, session: SessionContext, baseline: Baseline, verdict: VerdictSettings
) -> Selection:
    """The accepted effects and, after them, the link inertia errors that are accepted.

    Args:
        selected, session, baseline: The accepted effects, the runs, the tuned model.
        verdict: Threshold of a link's log evidence, and the probability of such an effect.
    """
    search, groups = selected.search, [item.group for item in selected.found.accepted]
    evidence, held = search.evidence, search.settings
    model = project(evidence.gram(), evidence, search.prior, groups)
    links = measure_tuned_links(baseline, evidence, model, search.prior, measure_inflation(evidence, model))
    # The moment about a joint's axis may come from any link behind it, so it alone does not identify the link.
    each = tuple(links.values())
    wrong = {k for k, one in enumerate(each) if one.beyond - {ABOUT} and one.evidence >= verdict.wrong_link_nats}
    while wrong:
        against = {k: each[k].against for k in wrong}
        alone = _believing_usual(search, wrong.union(*(one for ties in against.values() for one, _ in ties)), baseline)
        bodies = _bodies(alone, against, groups)
        if not bodies:
            break
        usual = replace(selected, search=alone)
        found = _with_bodies(usual, bodies, against, session, baseline, verdict.wrong_link_trust)
        added = range(len(groups), len(found.estimates))
        refused = set(find_implausible({k: (found.found.accepted[k], found.estimates[k]) for k in added}, session))
        refused |= {k for k in added if not _leads(found.estimates[k], held, verdict.even_odds)}
        refused |= {k for k in added if _is_of_a_body(alone, found.estimates[k].group, groups)}
        if not refused:
            return found
        wrong -= {bodies[found.estimates[k].group] for k in refused}
    return selected


def _leads(one: Estimate, held: SelectionSettings, least: float) -> bool:
    """Whether a link error's class is likely enough, and no other effect of the class is much likelier than it."""
    outranked = one.probability * held.class_odds < max(one.shares.values())
    return one.class_probability >= least and not outranked


def _is_of_a_body(search: Search, link: Group, groups: Sequence[Group]) -> bool:
    """Whether a link error is mostly what an accepted body does: beside that, it loses most of its log evidence."""
    gram, bodies = search.evidence.gram(), [one for one in groups if one.effect.as_change.body]
    without = ([one for one in groups if one is not body] for body in bodies)
    most = max((search.log_evidence_beside(gram, link, others) for others in without), default=0.0)
    return most > 0.0 and search.log_evidence_beside(gram, link, groups) < SEPARATE_SHARE * most


def _believing_usual(search: Search, links: Iterable[int], baseline: Baseline) -> Search:
    """The search with the usual prior for some links, so that a link error and not tuning explains their deviation."""
    error = replace(search.prior.error, usual=search.prior.error.usual.union(links))
    prior = Prior.believing(search.evidence, baseline, error)
    allowed = {key for key in search.excluded - search.implausible if key[0] == LinkInertialError.id}
    held_out = HeldOut(search.evidence, prior)
    return replace(search, prior=prior, held_out=held_out, excluded=search.excluded - allowed)


def _bodies(search: Search, against: Mapping[int, Places], groups: Sequence[Group]) -> dict[Group, int]:
    """For some links the best candidate of a link inertia error beside the accepted effects; the links by candidate.

    A last link that is too heavy carries a load: no recording tells one from the other, and a tool that nobody noted is
    likelier than a flange that was mismeasured, by as much as the last link is one of n. So a load stands for a link
    whose place the last one could take.

    Args:
        search, groups: The search, and the accepted effects.
        against: By index of a wrong link those that could take its place (`TunedLink.against`).
    """
    evidence, last, settings = search.evidence, search.evidence.layout.n - 1, search.settings
    model = project(evidence.gram(), evidence, search.prior, groups)
    best = search.best_by_key(model, groups).values()
    loads = [(score, group) for score, group in best if group.effect.id == UnknownPayload.id and score > 0.0]
    favour, near = np.log([evidence.layout.n, settings.class_odds]) / settings.temper
    bodies = dict[Group, int]()
    for score, link in best:
        if link.effect.id == LinkInertialError.id and link.joint in against:
            ties = {k for others, nats in against[link.joint] if nats <= near for k in others}
            carried = link.joint == last or (last in ties and loads and loads[0][0] + favour >= score)
            bodies[loads[0][1] if loads and carried else link] = link.joint
    return bodies


def _with_bodies(
    selected: Selection,
    bodies: Mapping[Group, int],
    against: Mapping[int, Places],
    session: SessionContext,
    baseline: Baseline,
    trust: float,
) -> Selection:
    """The selection with link inertia errors added after its effects.

    Args:
        selected, bodies: The accepted effects, and the link errors or loads, each with the index of the wrong link.
        against: By index of a wrong link those that could take its place (`TunedLink.against`).
        session, baseline, trust: The runs, the tuned model, and the probability that one of a class is the cause.
    """
    search, first = selected.search, len(selected.found.accepted)
    groups = [*(item.group for item in selected.found.accepted), *bodies]
    accepted, ladder = list(selected.found.accepted), list(selected.found.ladder)
    for k in range(first, len(groups)):
        # Tuned inertias absorb it, so it is evaluated with the URDF's inertias fixed.
        item = replace(search.evaluate_beside(search.evidence.gram(), groups, k), absorbed=True)
        accepted.append(replace(item, before=search.fixed.score(groups[:k]), after=search.fixed.score(groups[: k + 1])))
        ladder.append(search.held_out.score(groups[: k + 1]))
    fine = refine(search, session, baseline, groups)
    # Its size is estimated with tuned inertias, for other links may be wrong as well.
    as_tuned = [replace(item, absorbed=item.absorbed and k < first) for k, item in enumerate(accepted)]
    estimates = estimate_effects(search, fine, session, as_tuned)
    for k in range(first, len(groups)):
        # A load's class has link errors wherever they may be.
        ties = () if groups[k].effect.id == UnknownPayload.id else against[bodies[groups[k]]]
        estimates[k] = _among_bodies(search, estimates[k], groups, ties, trust)
    found = SearchResults(tuple(accepted), tuple(ladder), selected.found.best_rejected)
    return replace(selected, found=found, estimates=estimates, fine=fine)


def _among_bodies(search: Search, one: Estimate, groups: Sequence[Group], against: Places, trust: float) -> Estimate:
    """The estimate of a link error with its class: rivals are the effects that act on the same base parameters.

    Args:
        search, one, groups: The search, the estimate of the link error, and all accepted effects.
        against: Links that could take its place (`TunedLink.against`).
        trust: Probability that one of the class is the cause.
    """
    evidence = search.evidence
    others = [group for group in groups if group is not one.group]
    laws = {group.key for group in evidence.layout.groups if not group.effect.inertia_like}
    excess = measure_inflation(evidence, project(evidence.gram(), evidence, search.prior, groups))
    # If tuned neighbours explain all of it, they are fixed at the URDF.
    prior = search.prior if search.log_evidence_beside(evidence.gram(), one.group, others) > 0.0 else search.fixed.prior
    among = replace(search, excluded=search.excluded | laws, prior=prior)
    among = replace(among, implausible=frozenset(), redundant=frozenset())
    model = project(evidence.gram(), evidence, prior, others)
    _, rivals, odds = compare_rivals(among, model, one.group, others, excess)
    places = [(others, odds_of(search.settings.temper * nats)) for others, nats in against]
    probability = trust / (1.0 + sum(1.0 / each for each in (*odds.values(), *(each for _, each in places))))
    apart = {k: each * len(others) for others, each in places for k in others}
    return replace(one, probability=probability, rivals=rivals, odds=odds, places=apart)
