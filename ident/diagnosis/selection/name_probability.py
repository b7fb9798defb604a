"""Probability of each accepted effect against its rivals, and its parameters with intervals robust to correlated noise.

In: the accepted effects on coarse and fine grids. Out: an `Estimate` each. Coefficients have the block sandwich
covariance, S = A⁻¹ (Σ_b g_b g_bᵀ) A⁻¹ with the score g_b of block b. The probability is a softmax of tempered log
evidence E over the effects that explain the same torque, and none: p_i = p_max exp(t E_i) / Σ_k exp(t E_k).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from ident.arrays import Array, Bool, Float
from ident.diagnosis.selection.criteria import Evaluated
from ident.diagnosis.selection.profile import profile
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.search import Search
from ident.effects.base import Interval, SessionContext, undefined
from ident.effects.intervals import NORMAL_95
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import measure_inflation, robust_covariance

MOST_LOG_ODDS = 700.0  # of which the exponential is finite
# An effect that keeps this share of its log evidence beside another is a separate cause; a nested law that has it alone
# is a rival (law: more than all else).
SEPARATE_SHARE = 0.5


def odds_of(nats: float) -> float:
    """Odds, finite and above zero, from log odds."""
    return float(np.exp(np.clip(nats, -MOST_LOG_ODDS, MOST_LOG_ODDS)))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters, probability and rivals of one accepted effect."""

    group: Group  # the effect at its best point of the coarse grid
    parameters: dict[str, Interval]  # physical parameters with 95 % intervals
    probability: float  # that this effect is the cause, and none of its rivals
    rivals: tuple[str, ...]  # its class: ids of the effects that the recordings can't distinguish from it, itself first
    refined: Group  # the effect at the point of the fine grid to which the parameters belong
    coefficients: Float[Array, " k"]  # estimates there
    covariance: Float[Array, "k k"]  # covariance of the coefficients
    odds: Mapping[str, float]  # odds of the effect against each rival, by the rival's id
    places: Mapping[int, float] = field(default_factory=dict)  # odds against the same effect at other joints, by index
    significant: bool = False  # whether its essential coefficients differ from zero at 95 %

    @property
    def shares(self) -> dict[str, float]:
        """Probability of each effect of the class, its own first."""
        own = {self.rivals[0]: self.probability}
        return own | {name: self.probability / self.odds[name] for name in self.rivals[1:] if name in self.odds}

    @property
    def class_probability(self) -> float:
        """Probability that one of the effects of its class, or the same at another joint, is the cause."""
        elsewhere = (self.probability / odds for odds in self.places.values())
        return min(sum((*self.shares.values(), *elsewhere)), 1.0)

    @property
    def undefined(self) -> str | None:
        """Why the effect is not established, or None.

        A parameter may be undetermined though the effect is significant: the stiffness of a spring at a rest out of
        reach.
        """
        return None if self.significant else undefined(self.refined.effect, self.parameters)


def estimate_effects(
    search: Search, fine: Refined, session: SessionContext, effects: Sequence[Evaluated], widening: Sequence[float] = ()
) -> list[Estimate]:
    """Parameters, probability and rivals of every accepted effect.

    Args:
        search, fine: Search on the coarse grids, which holds all rivals, and the accepted effects on fine grids.
        session, effects: The runs, and the accepted effects on the coarse grids.
        widening: For each effect a factor on the standard deviations of its coefficients; ones if empty.
    """
    groups = [item.group for item in effects]
    found = _parameters(fine, session, [item.absorbed for item in effects], widening or [1.0] * len(effects))
    gram = search.evidence.gram()
    inflation = measure_inflation(search.evidence, project(gram, search.evidence, search.prior, groups))
    estimates = []
    for slot, (group, refined) in enumerate(zip(groups, fine.groups, strict=True)):
        others = [other for i, other in enumerate(groups) if i != slot]
        projection = project(gram, search.evidence, search.prior, others)
        probability, rivals, odds = compare_rivals(search, projection, group, others, inflation)
        parameters, beta, cells, significant = found[slot]
        estimates.append(
            Estimate(group, parameters, probability, rivals, refined, beta, cells, odds, significant=significant)
        )
    return estimates


def _parameters(
    fine: Refined, session: SessionContext, absorbed: Sequence[bool], widening: Sequence[float]
) -> list[tuple[dict[str, Interval], Float[Array, " k"], Float[Array, "k k"], bool]]:
    """For each effect: parameters with intervals, coefficients, their covariance, and whether it is significant.

    Absorbed effects are estimated with the URDF's inertias fixed, as they were evaluated. The URDF's own error is then
    part of the uncertainty: with δ ~ N(0, P⁻¹) the true change of the base parameters and f² P the prior that fixes
    them, the estimate is off by M⁻¹ f² P δ, a covariance of f⁴ M⁻¹ P M⁻¹.
    """
    evidence, gram = fine.search.evidence, fine.search.evidence.gram()
    solved, inflation = solve_effects(fine, absorbed)
    found = []
    for slot, (group, (beta, cells)) in enumerate(zip(fine.groups, solved, strict=True)):
        cells = widening[slot] ** 2 * cells
        others = [other for i, other in enumerate(fine.groups) if i != slot]
        prior = fine.search.fixed.prior if absorbed[slot] else fine.search.prior
        grid = profile(fine.search, project(gram, evidence, prior, others), group, inflation)
        context, doubt = session, group.effect.doubt
        best = group.effect.parameters(context, group.joint, group.variant, beta, cells)
        parameters = grid.widen(best, context, np.sqrt(np.diag(cells))) | grid.inner_parameters()
        parameters = {
            name: widen_interval(one, doubt.of(name, one.value), name in doubt.places)
            for name, one in parameters.items()
        }
        found.append((parameters, beta, cells, is_significant(beta, cells, group.effect.essential(group.variant))))
    return found


def is_significant(beta: Float[Array, " k"], cells: Float[Array, "k k"], essential: Sequence[int]) -> bool:
    """Wald's test at 95 %: whether some coefficients together differ from zero; False where there are none."""
    if not essential:
        return False
    at = np.array(essential)
    distance = float(beta[at] @ np.linalg.pinv(cells[np.ix_(at, at)], hermitian=True) @ beta[at])
    return distance > float(chdtri(len(at), 0.05))


def solve_effects(
    fine: Refined, absorbed: Sequence[bool]
) -> tuple[list[tuple[Float[Array, " k"], Float[Array, "k k"]]], float]:
    """Coefficients of every effect with their covariance, and the variance inflation of the model.

    A coefficient that its sign constraint holds at zero is as uncertain as if it were free.

    Args:
        fine: The effects on fine grids.
        absorbed: Whether each is estimated with the URDF's inertias fixed.
    """
    evidence, gram = fine.search.evidence, fine.search.evidence.gram()
    priors = (fine.search.prior, fine.search.fixed.prior) if any(absorbed) else 2 * (fine.search.prior,)
    views = [_off_bounds(evidence, prior, fine.groups) for prior in priors]
    free = [fast if hidden else tuned for tuned, fast, hidden in zip(*views, absorbed, strict=True)]
    used = [replace(one, columns=one.columns[kept]) for one, kept in zip(fine.groups, free, strict=True)]
    models = [project(gram, evidence, prior, used, signed=False) for prior in dict.fromkeys(priors)]
    covariances = [robust_covariance(evidence, model) for model in models]
    inflation = measure_inflation(evidence, models[0], covariances[0])
    if any(absorbed):
        reach = models[1].spread[:, : evidence.layout.rank]
        off = fine.search.settings.fixed_factor**4 * reach @ fine.search.prior.base @ reach.T
        covariances[1] = covariances[1] + off  # error of the fixed inertias
    bound = covariances[0]
    if not all(kept.all() for kept in free):
        bound = robust_covariance(evidence, project(gram, evidence, fine.search.prior, fine.groups, signed=False))
    at = first = evidence.layout.tuned
    solved = []
    for group, kept, hidden in zip(fine.groups, free, absorbed, strict=True):
        part, every = slice(at, at + int(kept.sum())), slice(first, first + len(kept))
        at, first = part.stop, every.stop
        scale = evidence.scale[group.columns]
        beta = np.zeros(len(scale))
        beta[kept] = models[hidden].estimate[part] / scale[kept]
        cells = (covariances[hidden][part, part] if kept.all() else bound[every, every]) / np.outer(scale, scale)
        signed = np.isin(np.arange(len(beta)), group.signed)
        solved.append((np.where(signed, np.maximum(beta, 0.0), beta), cells))
    return solved, inflation


def _off_bounds(evidence: Evidence, prior: Prior, groups: Sequence[Group]) -> list[Bool[Array, " k"]]:
    """For each effect which of its coefficients are free, that is not held at zero by their sign constraint."""
    columns = np.concatenate([group.columns for group in groups])
    signed = np.concatenate([np.isin(np.arange(len(g.columns)), g.signed) for g in groups])
    if not signed.any():
        return [np.ones(len(group.columns), dtype=bool) for group in groups]
    beta = project(evidence.gram(), evidence, prior).solve(columns, signed)
    free = np.split(~signed | (beta > 0.0), np.cumsum([len(group.columns) for group in groups])[:-1])
    return [kept if kept.any() else np.ones_like(kept) for kept in free]


def widen_interval(interval: Interval, doubt: float, place: bool = False) -> Interval:
    """An interval widened by the half-width `doubt`, by which an arm's own law may differ from the catalogue's.

    It is not widened beyond zero if it did not hold zero before: the law's error is a share of the effect's size. That
    is not so for positions (`place`).
    """
    if doubt == 0.0 or not np.isfinite(interval.value):
        return interval
    low, high = (float(np.hypot(end - interval.value, doubt)) for end in (interval.low, interval.high))
    low, high = interval.value - low, interval.value + high
    if not place and interval.low >= 0.0:
        low = max(low, 0.0)
    if not place and interval.high <= 0.0:
        high = min(high, 0.0)
    return replace(interval, low=low, high=high)


def _separate_causes(
    search: Search, group: Group, others: Sequence[Group], rivals: Sequence[Group], own: float
) -> tuple[set[Key], dict[Key, float]]:
    """Separates candidates that explain another part of the torque than an effect does.

    Args:
        search, group, others: The search, the effect, and the other accepted effects.
        rivals, own: The candidates, and the effect's log evidence [nats].

    Returns:
        Candidates beside which the effect keeps most of its log evidence, so that both may be present; and for each
        other one the log evidence that the effect adds beside it.
    """
    gram, apart, added = search.evidence.gram(), set[Key](), dict[Key, float]()
    for rival in rivals:
        left = search.log_evidence_beside(gram, group, [*others, rival])
        if left > SEPARATE_SHARE * own:
            apart.add(rival.key)
        elif left > 0.0:
            added[rival.key] = left
    return apart, added


def _nested_laws(
    search: Search,
    best: Mapping[Key, tuple[float, Group]],
    group: Group,
    others: Sequence[Group],
    apart: Collection[Key],
    unit: float,
) -> dict[str, float]:
    """Log evidence, by id, of each effect that explains most of this one's torque and nothing beside it.

    A constant torque with a slight spring is a spring with a distant rest; an encoder offset of the first joint with a
    slight tilt is a tilt. Both together explain what this effect does alone, at the cost of one effect more.
    """
    gram, score, found = search.evidence.gram(), best[group.key][0], dict[str, float]()
    whole = project(gram, search.evidence, search.prior, [*others, group])
    for own, rival in best.values():
        most = own >= SEPARATE_SHARE * score and rival.key not in {group.key, *apart} and not rival.effect.event
        if most and search.log_evidence_of(whole, rival) <= 0.0:
            found[rival.effect.id] = score / unit - search.complexity_cost(rival)
    return found


def compare_rivals(
    search: Search, projection: Projection, group: Group, others: Sequence[Group], excess: float
) -> tuple[float, tuple[str, ...], dict[str, float]]:
    """Probability of an effect against all candidates that could replace it, its class, and its odds against each.

    No real law is exactly the catalogue's. Where it differs by a share d of the torque, the true law may explain ½ d²
    of the whole gain less than a rival: log evidence is divided by that and by the variance inflation.

    Args:
        search, projection: The search, and the model of the other accepted effects.
        group, others, excess: The effect, the other accepted effects, and the variance inflation.
    """
    settings, gram = search.settings, search.evidence.gram()
    wider = replace(search, excluded=search.excluded - (search.redundant - search.implausible))
    best = wider.best_by_key(projection, others, group)
    share = group.effect.doubt.share / NORMAL_95
    unit = excess + settings.temper * 0.5 * share**2 * search.gain_of(projection, best[group.key][1])[0]
    least = max(best[group.key][0] - settings.rival_nats * unit, settings.least_nats)
    rivals = [rival for score, rival in best.values() if score > least and rival.key != group.key]
    allowed = {rival.key for rival in rivals} | {group.key}
    apart, added = _separate_causes(search, group, others, rivals, best[group.key][0])
    ahead = {rival.key for rival in rivals if best[rival.key][0] > best[group.key][0]} - apart
    # A rival of greater log evidence counts only if it meets the acceptance criteria.
    stronger = search.evaluate(gram, projection, others, [best[key] for key in ahead])
    allowed -= apart | {item.group.key for item in stronger if not item.criteria.passed}
    scores: dict[Key, float] = {key: score / unit for key, (score, _) in best.items() if key in allowed}
    both = [scores[key] + added[key] / unit for key in (ahead & allowed & added.keys()) - search.redundant]
    own = max([scores[group.key], *both])
    by_effect = _nested_laws(search, best, group, others, apart, unit)
    for (effect, _, _), score in scores.items():
        by_effect[effect] = max(by_effect.get(effect, -np.inf), score)
    by_effect[group.effect.id] = own
    if group.effect.id == UnknownPayload.id:
        # No recording tells a load from a heavier last link; wrong links are as likely, and the last one is one of n.
        link = own - float(np.log(search.evidence.layout.n)) / settings.temper
        by_effect[LinkInertialError.id] = max(by_effect.get(LinkInertialError.id, -np.inf), link)
    ids = list(by_effect)
    # A law with implausible parameters that explains it far better points to a cause that the catalogue lacks.
    laws = search.best_implausible(projection).values()
    unknown = [score / unit for score, law in laws if search.log_evidence_beside(gram, group, [*others, law]) <= 0.0]
    logs = settings.temper * np.array([*by_effect.values(), *unknown, 0.0])
    weights = np.exp(logs - logs.max())
    probability = settings.most_sure * float(weights[ids.index(group.effect.id)] / weights.sum())
    ahead_of = {name: settings.temper * (own - score) for name, score in by_effect.items() if name != group.effect.id}
    odds = {name: odds_of(nats) for name, nats in ahead_of.items()}
    near = sorted((name for name, one in odds.items() if one <= settings.class_odds), key=odds.__getitem__)
    return probability, (group.effect.id, *near), odds
