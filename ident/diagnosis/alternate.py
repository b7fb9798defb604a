"""Stepwise selection of effects, alternated with two kinds of variance components until they agree.

In: a search over all candidates. Out: the accepted effects with their estimates, and why others were not accepted. In
each round

1. effects are selected, given how much friction varies from run to run and how wrong the URDF is;
2. the between-run variance of friction and the scales of the URDF's error are estimated anew, given these effects.

The rounds end when both change little. An accepted effect is dropped if it is redundant, outranked by a rival,
implausible, insignificant, heterogeneous between runs, or no likelier than a random walk of friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.diagnosis.reservations import Reservation, find_heterogeneous, find_implausible
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.selection.name_probability import Estimate, estimate_effects
from ident.diagnosis.selection.refine import Refined, find_redundant, refine
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.tolerance import measure_tolerance
from ident.diagnosis.selection.urdf_scale import fit_urdf_error, initial_urdf_error, log_bayes_factor, one_link_is_wrong
from ident.effects.base import SessionContext
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import estimate_run_spread, measure_inflation
from ident.regression.wandering import log_odds_of_law

# Reason that a law of warmth is rejected for.
RANDOM_WALK = "a random walk of friction over the runs explains it about as well: it may be warmth, or any slow change"


@dataclass(frozen=True, eq=False)
class Selection:
    """Accepted effects with their estimates."""

    search: Search  # the search that selected them, with its variances and excluded candidates
    found: SearchResults  # accepted effects on the coarse grids
    estimates: list[Estimate]  # one for each accepted effect
    fine: Refined | None  # the effects on fine grids; None where there are none
    reservations: tuple[Reservation, ...]  # effects that were rejected after acceptance, with the reason


def select_effects(search: Search, session: SessionContext, baseline: Baseline) -> Selection:
    """Selects effects, the between-run variance of friction and the URDF's error scales in turn.

    Friction is first taken to vary much, so that an effect must show beside that. The variance that accepted effects
    explain is no variance of friction; where its estimate falls clearly, the next round may accept smaller effects.

    Args:
        search, session, baseline: Search over all candidates, the runs, and the tuned model.
    """
    prior, settings = search.prior, search.settings
    reservations: tuple[Reservation, ...] = ()
    free = search.evidence.with_run_spread(np.full(search.evidence.layout.n, search.evidence.settings.wide_spread))
    spread = estimate_run_spread(free, _with_slow_effects(free, prior))
    evidence = free.with_run_spread(spread)
    prior = Prior.believing(free, baseline, initial_urdf_error(replace(search, evidence=evidence), baseline).error)
    search = replace(search, evidence=evidence, prior=prior, held_out=HeldOut(evidence, prior))
    rounds_left, start = settings.most_settling, search.best_start()
    while True:
        rounds_left -= 1
        selected = _select_stepwise(search, session, baseline, reservations, start)
        error, unsupported = _revise_urdf_error(selected.search, selected.found, session, baseline)
        while unsupported and (error == prior.error or not rounds_left):
            without = replace(selected.search, excluded=selected.search.excluded | unsupported)
            start = [item.group for item in selected.found.accepted]
            selected = _select_stepwise(without, session, baseline, selected.reservations, start)
            error, unsupported = _revise_urdf_error(selected.search, selected.found, session, baseline)
        search, reservations = selected.search, selected.reservations
        groups = [item.group for item in selected.found.accepted]
        # The first estimate had all slow effects beside it, and none of the others: it may be too small or too large.
        new_spread = estimate_run_spread(free, project(free.gram(), free, prior, groups))
        steady = np.all(np.maximum(new_spread / spread, spread / new_spread) < 1.0 / settings.settled_share)
        if not rounds_left or (error == prior.error and steady):
            return replace(selected, found=_with_rejected(selected.found, selected.reservations))
        spread, prior, start = new_spread, Prior.believing(free, baseline, error), groups
        evidence = free.with_run_spread(spread)
        search = replace(search, evidence=evidence, prior=prior, held_out=HeldOut(evidence, prior))
        del selected  # frees the last round's sums before new ones are made


def keep_effects(
    selected: Selection, kept: Sequence[int], session: SessionContext, baseline: Baseline, reason: str
) -> Selection:
    """Reduces a selection to some of its effects, by index, and estimates these anew.

    Args:
        selected, kept: The selection, and the indices of the effects that stay.
        session, baseline, reason: The runs, the tuned model, and why the other effects are dropped.
    """
    search, joints = selected.search, baseline.nominal.joint_names
    effects = list(zip(selected.found.accepted, selected.estimates, strict=True))
    dropped = tuple(Reservation.of(*one, joints, reason) for k, one in enumerate(effects) if k not in kept)
    found = search.only(selected.found, kept)
    if not kept:
        return Selection(search, found, [], None, selected.reservations + dropped)
    fine = refine(search, session, baseline, [item.group for item in found.accepted])
    estimates = estimate_effects(search, fine, session, found.accepted)
    return Selection(search, found, estimates, fine, selected.reservations + dropped)


def _with_rejected(found: SearchResults, reservations: Sequence[Reservation]) -> SearchResults:
    """Results without effects, given the best reservation's effect as rejected candidate: a gap is present."""
    candidates = [one.candidate for one in reservations if one.candidate is not None]
    if found.accepted or found.near_miss is not None or not candidates:
        return found
    return replace(found, best_rejected=max(candidates, key=lambda item: item.criteria.log_evidence))


def _with_slow_effects(evidence: Evidence, prior: Prior) -> Projection:
    """The baseline with the best candidate of each slow effect at each joint.

    Slow effects, such as warming friction, also differ from run to run: were between-run variance estimated without
    them, it would absorb them.
    """
    gram = evidence.gram()
    alone = project(gram, evidence, prior)
    best: dict[tuple[str, int], tuple[float, Group]] = {}
    for group in evidence.layout.groups:
        if group.effect.by_run:
            gain = alone.gain(group)[0]
            if gain > best.get((group.effect.id, group.joint), (0.0, group))[0]:
                best[group.effect.id, group.joint] = gain, group
    return project(gram, evidence, prior, [group for _, group in best.values()])


def _revise_urdf_error(
    search: Search, found: SearchResults, session: SessionContext, baseline: Baseline
) -> tuple[UrdfError, set[Key]]:
    """Checks the accepted inertia-like effects against a URDF whose error is free, and revises its scales.

    They are revised in two cases: the Bayes factor of an absorbed effect is too small; or no effect is absorbed, and
    the tuned inertias exceed the URDF's tolerance although no single link explains that.

    Returns:
        The scales of the URDF's error, and the key of the first effect whose Bayes factor is too small. If the scales
        are those of the prior, another search would select that effect again.
    """
    evidence, prior, settings = search.evidence, search.prior, search.settings
    groups = [item.group for item in found.accepted]
    absorbed = [item.group for item in found.accepted if item.absorbed]
    model = project(evidence.gram(), evidence, prior, groups)
    inflation = measure_inflation(evidence, model)
    if not absorbed:
        exceeded = measure_tolerance(evidence, prior, model, inflation, settings).exceeded
        # A single wrong link must be reported, not absorbed by a wider prior of all links.
        if not exceeded or one_link_is_wrong(search, baseline, groups, inflation):
            return prior.error, set()
        return fit_urdf_error(search, baseline, groups, inflation).error, set()
    for group in absorbed:
        others = [other for other in groups if other is not group]
        if log_bayes_factor(search, session, baseline, group, others, inflation) < search.inertial_threshold:
            return fit_urdf_error(search, baseline, others, inflation).error, {group.key}
    return prior.error, set()


def _find_random_walks(search: Search, groups: Sequence[Group], tested: Sequence[int]) -> list[int]:
    """Indices of the tested slow effects that are hardly likelier than friction that follows a random walk."""
    slow = [k for k in tested if groups[k].effect.by_run]
    if not slow:
        return []
    settings = search.evidence.settings
    free = search.evidence.with_run_spread(np.full(search.evidence.layout.n, settings.wide_spread))
    found = []
    for k in slow:
        model = project(free.gram(), free, search.prior, [other for other in groups if other is not groups[k]])
        variants = [other for other in free.layout.groups if other.key == groups[k].key]
        if log_odds_of_law(free, model, variants) < settings.wandering.least_nats:
            found.append(k)
    return found


def _select_stepwise(
    search: Search,
    session: SessionContext,
    baseline: Baseline,
    reservations: tuple[Reservation, ...] = (),
    start: Sequence[Group] = (),
) -> Selection:
    """Effects of one round, without those that are redundant, outranked by a rival, or rejected by a later test.

    An effect with implausible parameters is excluded and the search repeated: another effect may explain what it did.
    The same is tried for an effect that a rival outranks, if the rival is accepted then.

    Args:
        search, session, baseline: Search over the candidates, the runs, and the tuned model.
        reservations, start: The reservations and the effects of earlier rounds.
    """
    outranked, checked = 0, False
    settings, joints = search.settings, baseline.nominal.joint_names
    found = search.run(start)
    most = settings.most_doubted * len(joints)
    while found.accepted:  # no second pass over the recordings without effects
        effects, groups = found.accepted, [item.group for item in found.accepted]
        fine = refine(search, session, baseline, groups)
        redundant = find_redundant(fine)
        if redundant is not None and len(search.excluded) < most:
            lost = {groups[redundant].key}
            search = replace(search, excluded=search.excluded | lost, redundant=search.redundant | lost)
            found = search.run(groups, found.accepted)
            continue
        estimates = estimate_effects(search, fine, session, found.accepted)
        kept = [k for k, estimate in enumerate(estimates) if estimate.class_probability >= settings.least_probability]
        refused = find_implausible({k: (effects[k], estimates[k]) for k in kept}, session)
        hidden = [k for k in kept if effects[k].absorbed or groups[k].prior is not None]
        refused = refused or find_heterogeneous(search, groups, kept, hidden)
        reservations += tuple(Reservation.of(effects[k], estimates[k], joints, why) for k, why in refused.items())
        for k in () if refused else _find_random_walks(search, groups, kept):
            refused[k] = RANDOM_WALK
            doubt = Reservation.of(effects[k], estimates[k], joints, RANDOM_WALK)
            reservations += (replace(doubt, candidate=None),)  # friction that varies is no gap
        if refused and len(reservations) <= most:
            keys = {groups[k].key for k in refused}
            search = replace(search, excluded=search.excluded | keys, implausible=search.implausible | keys)
            found = search.run(groups, found.accepted)
            continue
        kept = [k for k in kept if k not in refused]
        if len(kept) == len(groups):
            remaining = found.accepted if checked else search.backward_elimination(groups)
            if len(remaining) == len(groups):
                return Selection(search, found, estimates, fine, reservations)
            # Effects accepted later explain what an earlier one did.
            found, checked = search.run([item.group for item in remaining], remaining), True
            continue
        if not refused and outranked < most:
            lost = {group.key for k, group in enumerate(groups) if k not in kept}
            outranked += len(lost)
            other = replace(search, excluded=search.excluded | lost).run(groups, found.accepted)
            if len(other.accepted) > len(kept):
                search, found = replace(search, excluded=search.excluded | lost), other
                continue
        found = search.only(found, kept)
    return Selection(search, found, [], None, reservations)
