"""Links that are off by more than URDFs are get a name: tuning absorbs them, so no residual does.

A search among laws sees of a link what tuning leaves, and of a URDF that is doubted everywhere it leaves nothing. What
speaks for a link is how much better it alone being off explains the recordings than its neighbours, however far off
these are (`TunedLink.evidence`), beside all laws that have a name. A load, a gain of its joint and the link itself move
the same numbers: the likeliest of them is the name, and the others stand in its class as far as the recordings can't
distinguish them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ident.diagnosis.alternate import Settled
from ident.diagnosis.reservations import find_implausible
from ident.diagnosis.selection.gates import SearchResults
from ident.diagnosis.selection.name_probability import Estimate, estimate_effects, weigh_rivals
from ident.diagnosis.selection.refine import refine
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.settings import SelectionSettings
from ident.diagnosis.settings import VerdictSettings
from ident.diagnosis.tuned_links import ABOUT, MASS, measure_tuned_links
from ident.effects.base import SessionContext
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.least_squares import Prior, project
from ident.regression.run_spread import measure_inflation


def name_wrong_links(sure: Settled, session: SessionContext, baseline: Baseline, verdict: VerdictSettings) -> Settled:
    """The names and, after them, those of links that are off by more than URDFs are.

    Args:
        sure, session, baseline: The laws that have a name, the runs, the tuned model.
        verdict: From when on a link has a name, and how sure that is.
    """
    search, groups = sure.search, [item.group for item in sure.found.named]
    evidence, held = search.evidence, search.settings
    model = project(evidence.gram(), evidence, search.prior, groups)
    links = measure_tuned_links(baseline, evidence, model, search.prior, measure_inflation(evidence, model))
    # A moment about the axis may be that of any link behind it.
    wrong = {
        k for k, one in enumerate(links.values()) if one.beyond - {ABOUT} and one.evidence >= verdict.wrong_link_nats
    }
    while wrong:
        alone = _believing_usual(search, wrong, baseline)
        bodies = _links(alone, wrong, groups)
        if not bodies:
            break
        found = _with_bodies(replace(sure, search=alone), bodies, session, baseline, verdict.wrong_link_trust)
        added = range(len(groups), len(found.estimates))
        refused = set(find_implausible({k: (found.found.named[k], found.estimates[k]) for k in added}, session))
        refused |= {k for k in added if not _leads(found.estimates[k], held, verdict.even_odds)}
        if not refused:
            return found
        wrong -= {found.estimates[k].group.joint for k in refused}
    return sure


def _leads(one: Estimate, held: SelectionSettings, least: float) -> bool:
    """Whether a body is likely enough for a name, and none of its class much likelier than itself."""
    outranked = one.probability * held.class_odds < max(one.shares.values())
    return one.class_probability >= least and not outranked


def _believing_usual(search: Search, links: Iterable[int], baseline: Baseline) -> Search:
    """The search with some links believed as any URDF's: what is off there is to be the name's."""
    error = replace(search.prior.error, usual=search.prior.error.usual.union(links))
    prior = Prior.believing(search.evidence, baseline, error)
    barred = {key for key in search.barred - search.absurd if key[0] == LinkInertialError.id}
    return replace(
        search, prior=prior, held_out=HeldOut(search.evidence, prior), barred=search.barred.difference(barred)
    )


def _links(search: Search, wrong: Iterable[int], groups: Sequence[Group]) -> list[Group]:
    """Candidates for some links, at the points of their grids that explain most beside some effects."""
    model = project(search.evidence.gram(), search.evidence, search.prior, groups)
    best = (group for _, group in search.best_by_key(model, groups).values())
    return [group for group in best if group.effect.id == LinkInertialError.id and group.joint in set(wrong)]


def _with_bodies(
    sure: Settled, bodies: Sequence[Group], session: SessionContext, baseline: Baseline, trust: float
) -> Settled:
    """The names with those of bodies after them."""
    search, first = sure.search, len(sure.found.named)
    groups = [*(item.group for item in sure.found.named), *bodies]
    named, ladder = list(sure.found.named), list(sure.found.ladder)
    for k in range(first, len(groups)):
        # What tuning absorbs shows against the URDF as it is.
        item = replace(search.judged_beside(search.evidence.gram(), groups, k), absorbed=True)
        named.append(replace(item, before=search.fixed.score(groups[:k]), after=search.fixed.score(groups[: k + 1])))
        ladder.append(search.held_out.score(groups[: k + 1]))
    fine = refine(search, session, baseline, groups)
    # Their sizes are those of the tuned arm, whose other links may be off as well.
    as_tuned = [replace(item, absorbed=item.absorbed and k < first) for k, item in enumerate(named)]
    estimates = estimate_effects(search, fine, session, as_tuned)
    estimates[first:] = [_among_bodies(search, one, groups, trust) for one in estimates[first:]]
    found = SearchResults(tuple(named), tuple(ladder), sure.found.refused)
    return replace(sure, found=found, estimates=estimates, fine=fine)


def _among_bodies(search: Search, one: Estimate, groups: Sequence[Group], trust: float) -> Estimate:
    """An estimate weighed against what moves the same numbers: that one of them is there, the link's evidence says."""
    evidence = search.evidence
    others = [group for group in groups if group is not one.group]
    laws = {group.key for group in evidence.layout.groups if not group.effect.inertia_like}
    excess = measure_inflation(evidence, project(evidence.gram(), evidence, search.prior, groups))
    # Neighbours that may be so far off that they explain all of it are held as the URDF has them.
    prior = search.prior if search.score_beside(evidence.gram(), one.group, others) > 0.0 else search.fixed.prior
    among = replace(search, barred=search.barred | laws, absurd=frozenset(), redundant=frozenset(), prior=prior)
    model = project(evidence.gram(), evidence, prior, others)
    _, rivals, odds = weigh_rivals(among, model, one.group, others, excess)
    listed = any(group.effect.id == UnknownPayload.id for group in evidence.layout.groups)
    if listed and one.group.joint == evidence.layout.n - 1 and one.parameters[MASS].high > 0.0:
        # What hangs on the last link is a part of it.
        odds = odds | {UnknownPayload.id: min(odds.get(UnknownPayload.id, 1.0), 1.0)}
        rivals = (*rivals, *({UnknownPayload.id} - set(rivals)))
    probability = trust / (1.0 + sum(1.0 / each for each in odds.values()))
    return replace(one, probability=probability, rivals=rivals, odds=odds)
