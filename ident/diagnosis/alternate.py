"""Names, friction's variation between runs and the URDF's error: each is estimated beside the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.diagnosis.reservations import Reservation, find_implausible, find_uneven
from ident.diagnosis.selection.gates import SearchResults
from ident.diagnosis.selection.name_probability import Estimate, estimate_effects
from ident.diagnosis.selection.refine import Refined, find_needless, refine
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.tolerance import measure_tolerance
from ident.diagnosis.selection.urdf_scale import added_evidence, best_belief, first_belief, one_link_is_wrong
from ident.effects.base import SessionContext
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import estimate_run_spread, measure_inflation
from ident.regression.wandering import log_odds_of_law

# Why a law of warmth does not stand that is hardly likelier than a random walk.
WANDERS = "friction that wanders from run to run explains it about as well: it may be warmth, or any slow change"


@dataclass(frozen=True, eq=False)
class Settled:
    """Names that stand, and what was found on the way."""

    search: Search  # the search that gave them, with what it is to do without
    found: SearchResults  # what it found
    estimates: list[Estimate]  # of each name
    fine: Refined | None  # their finer grids, if there are names
    doubted: tuple[Reservation, ...]  # why further names were not believed


def settle(search: Search, session: SessionContext, baseline: Baseline) -> Settled:
    """Names and how much friction varies from run to run: each is estimated beside the other.

    Friction may vary by much until the names say otherwise: an effect must show beside that. What the names explain is
    no variation of friction any more; where that makes it clearly smaller, smaller effects are looked for.
    """
    prior, settings = search.prior, search.settings
    doubted: tuple[Reservation, ...] = ()
    free = search.evidence.with_run_spread(np.full(search.evidence.layout.n, search.evidence.settings.wide_spread))
    spread = estimate_run_spread(free, _with_slow_effects(free, prior))
    evidence = free.with_run_spread(spread)
    prior = Prior.believing(free, baseline, first_belief(replace(search, evidence=evidence), baseline).error)
    search = replace(search, evidence=evidence, prior=prior, held_out=HeldOut(evidence, prior))
    left, start = settings.most_settling, search.best_start()
    while True:
        left -= 1
        sure = _sure(search, session, baseline, doubted, start)
        error, unlikely = _how_wrong(sure.search, sure.found, session, baseline)
        while unlikely and (error == prior.error or not left):
            barring = replace(sure.search, barred=sure.search.barred | unlikely)
            start = [item.group for item in sure.found.named]
            sure = _sure(barring, session, baseline, sure.doubted, start)
            error, unlikely = _how_wrong(sure.search, sure.found, session, baseline)
        search, doubted, groups = sure.search, sure.doubted, [item.group for item in sure.found.named]
        # Beside slow effects that got no name friction varied too little, beside none of the others too much.
        now = estimate_run_spread(free, project(free.gram(), free, prior, groups))
        steady = np.all(np.maximum(now / spread, spread / now) < 1.0 / settings.settled_share)
        if not left or (error == prior.error and steady):
            return replace(sure, found=_or_doubted(sure.found, sure.doubted))
        spread, prior, start = now, Prior.believing(free, baseline, error), groups
        evidence = free.with_run_spread(spread)
        search = replace(search, evidence=evidence, prior=prior, held_out=HeldOut(evidence, prior))
        del sure  # what was made of the last sums goes before it is made of new ones


def keep_names(sure: Settled, kept: Sequence[int], session: SessionContext, baseline: Baseline, reason: str) -> Settled:
    """Some of the names, estimated anew without the others, of which it is said why they do not stand."""
    search, joints = sure.search, baseline.nominal.joint_names
    dropped = [k for k in range(len(sure.estimates)) if k not in kept]
    doubted = tuple(Reservation.of(sure.found.named[k], sure.estimates[k], joints, reason) for k in dropped)
    found = search.only(sure.found, kept)
    if not kept:
        return Settled(search, found, [], None, sure.doubted + doubted)
    fine = refine(search, session, baseline, [item.group for item in found.named])
    estimates = estimate_effects(search, fine, session, found.named)
    return Settled(search, found, estimates, fine, sure.doubted + doubted)


def _or_doubted(found: SearchResults, doubted: Sequence[Reservation]) -> SearchResults:
    """Results without names in which the best of what was doubted counts as refused: something is there."""
    shown = [one.shows for one in doubted if one.shows is not None]
    if found.named or found.hint is not None or not shown:
        return found
    return replace(found, refused=max(shown, key=lambda item: item.gates.evidence))


def _with_slow_effects(evidence: Evidence, prior: Prior) -> Projection:
    """The baseline with the best candidate of each slow effect at each joint.

    What changes slowly (warm friction) changes from run to run, too: it has the first word, or it would never be seen.
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


def _how_wrong(
    search: Search, found: SearchResults, session: SessionContext, baseline: Baseline
) -> tuple[UrdfError, set[Key]]:
    """How far off the URDF must be believed to be before names of the inertias' kind can be judged: mostly as it was.

    Either such a name was given, and a URDF that is wrong everywhere would explain nearly as much; or none was given,
    and the tuned inertias lie beyond the tolerance.

    Returns:
        The error, and the first name that is not likely enough beside it. Where the error is what was believed anyway,
        another search would give the same name again.
    """
    evidence, prior, settings = search.evidence, search.prior, search.settings
    groups = [item.group for item in found.named]
    absorbed = [item.group for item in found.named if item.absorbed]
    model = project(evidence.gram(), evidence, prior, groups)
    inflation = measure_inflation(evidence, model)
    if not absorbed:
        exceeded = measure_tolerance(evidence, prior, model, inflation, settings).exceeded
        # Where something sits at one link that has no name, it must be reported.
        if not exceeded or one_link_is_wrong(search, baseline, groups, inflation):
            return prior.error, set()
        return best_belief(search, baseline, groups, inflation).error, set()
    for group in absorbed:
        others = [other for other in groups if other is not group]
        if added_evidence(search, session, baseline, group, others, inflation) < search.inertial_nats:
            return best_belief(search, baseline, others, inflation).error, {group.key}
    return prior.error, set()


def _find_wandering(search: Search, groups: Sequence[Group], asked: Sequence[int]) -> list[int]:
    """Which of some names are slow laws that are hardly likelier than friction that wanders from run to run."""
    slow = [k for k in asked if groups[k].effect.by_run]
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


def _sure(
    search: Search,
    session: SessionContext,
    baseline: Baseline,
    doubted: tuple[Reservation, ...] = (),
    start: Sequence[Group] = (),
) -> Settled:
    """The effects that the search named, without those that are needless, that a rival beats, or that no arm has.

    What no arm has is no candidate: the search begins again without it, for what it explained may have another name.
    So may what a name explained that a rival beats; where the rival does not stand either, the name has none.

    Args:
        search: The session's candidates.
        session: The runs.
        baseline: The tuned model.
        doubted: Why names were not believed so far.
        start: Effects to begin with: those that stood beside another belief about friction and the URDF.
    """
    beaten, checked = 0, False
    held, joints = search.settings, baseline.nominal.joint_names
    found = search.run(start)
    most = held.most_doubted * len(joints)
    while found.named:  # without names there is nothing to refine: no second pass
        groups = [item.group for item in found.named]
        fine = refine(search, session, baseline, groups)
        needless = find_needless(fine)
        if needless is not None and len(search.barred) < most:
            lost = {groups[needless].key}
            search = replace(search, barred=search.barred | lost, redundant=search.redundant | lost)
            found = search.run(groups, found.named)
            continue
        estimates = estimate_effects(search, fine, session, found.named)
        kept = [k for k, estimate in enumerate(estimates) if estimate.class_probability >= held.least_probability]
        refused = find_implausible({k: (found.named[k], estimates[k]) for k in kept}, session)
        hidden = [k for k in kept if found.named[k].absorbed or groups[k].prior is not None]
        refused = refused or find_uneven(search, groups, kept, hidden)
        doubted += tuple(Reservation.of(found.named[k], estimates[k], joints, why) for k, why in refused.items())
        for k in () if refused else _find_wandering(search, groups, kept):
            refused[k] = WANDERS
            # Friction that varies is no gap.
            doubted += (replace(Reservation.of(found.named[k], estimates[k], joints, WANDERS), shows=None),)
        if refused and len(doubted) <= most:
            keys = {groups[k].key for k in refused}
            search = replace(search, barred=search.barred | keys, absurd=search.absurd | keys)
            found = search.run(groups, found.named)
            continue
        kept = [k for k in kept if k not in refused]
        if len(kept) == len(groups):
            standing = found.named if checked else search.standing(groups)
            if len(standing) == len(groups):
                return Settled(search, found, estimates, fine, doubted)
            # What was named later explained what another had.
            found, checked = search.run([item.group for item in standing], standing), True
            continue
        if not refused and beaten < most:
            lost = {group.key for k, group in enumerate(groups) if k not in kept}
            beaten += len(lost)
            other = replace(search, barred=search.barred | lost).run(groups, found.named)
            if len(other.named) > len(kept):
                search, found = replace(search, barred=search.barred | lost), other
                continue
        found = search.only(found, kept)
    return Settled(search, found, [], None, doubted)
