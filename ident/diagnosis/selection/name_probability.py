"""Probabilities of named effects against their rivals, and their parameters with intervals for correlated noise."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from ident.arrays import Array, Bool, Float
from ident.diagnosis.selection.gates import Named
from ident.diagnosis.selection.profile import profile
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.search import Search
from ident.effects.base import Interval, SessionContext, undefined
from ident.effects.intervals import NORMAL_95
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import measure_inflation, robust_covariance

# Log odds are given up to this, either way: more is no number of a computer's.
MOST_NATS = 700.0
# Share of a name's evidence that a part of its law must have alone to be as good a name (law: more than all else).
MOST = 0.5


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of one named effect."""

    group: Group  # the effect at its best inner parameters
    parameters: dict[str, Interval]  # physical parameters with 95 % intervals
    probability: float  # that this effect, and none of its rivals, is the cause
    rivals: tuple[str, ...]  # ids of the effects that the recordings can't distinguish from it, itself first
    refined: Group  # the effect at the point of the finer grid that the parameters are those of
    coefficients: Float[Array, " k"]  # its coefficients there
    covariance: Float[Array, "k k"]  # theirs
    # Of the effect against each other one that was weighed, by its id; none is given against all others.
    odds: Mapping[str, float]
    certain: bool = False  # whether the columns that make the effect what it is are together not zero, at 95 %

    @property
    def shares(self) -> dict[str, float]:
        """Probability of each name of the class, its own first: what of the same evidence each would have."""
        own = {self.rivals[0]: self.probability}
        return own | {name: self.probability / self.odds[name] for name in self.rivals[1:] if name in self.odds}

    @property
    def class_probability(self) -> float:
        """That one of the names that can't be distinguished is the cause."""
        return min(sum(self.shares.values()), 1.0)

    @property
    def undefined(self) -> str | None:
        """Why nobody can say that there is such an effect, or None.

        A parameter may be unsure where the effect is not: the stiffness, at its rest, of a spring that rests out
        of reach.
        """
        return None if self.certain else undefined(self.refined.effect, self.parameters)


def estimate_effects(
    search: Search, fine: Refined, session: SessionContext, named: Sequence[Named], widening: Sequence[float] = ()
) -> list[Estimate]:
    """Parameters, probability and rivals of every named effect.

    Args:
        search: Of the first pass: all rivals.
        fine: Second pass: the named effects alone, on finer grids.
        session: The runs.
        named: The named effects in the first pass.
        widening: For each, factor on its coefficients' standard deviations; none where blocks say all of them.
    """
    groups = [item.group for item in named]
    found = _parameters(fine, session, [item.absorbed for item in named], widening or [1.0] * len(named))
    gram = search.evidence.gram()
    inflation = measure_inflation(search.evidence, project(gram, search.evidence, search.prior, groups))
    estimates = []
    for slot, (group, refined) in enumerate(zip(groups, fine.groups, strict=True)):
        others = [other for i, other in enumerate(groups) if i != slot]
        projection = project(gram, search.evidence, search.prior, others)
        probability, rivals, odds = weigh_rivals(search, projection, group, others, inflation)
        parameters, beta, cells, certain = found[slot]
        estimates.append(Estimate(group, parameters, probability, rivals, refined, beta, cells, odds, certain))
    return estimates


def _parameters(
    fine: Refined, session: SessionContext, absorbed: Sequence[bool], widening: Sequence[float]
) -> list[tuple[dict[str, Interval], Float[Array, " k"], Float[Array, "k k"], bool]]:
    """Physical parameters of every effect with their intervals, its coefficients, theirs, and whether it is certain.

    What tuning absorbs is estimated against the URDF fixed, as it was judged. What the URDF's own tolerance then does
    to the parameters counts as uncertainty: with δ ~ N(0, P⁻¹) the true change of the base parameters and f² P the
    prior that fixes them, the estimate is off by M⁻¹ f² P δ, a covariance of f⁴ M⁻¹ P M⁻¹.
    """
    evidence, gram = fine.search.evidence, fine.search.evidence.gram()
    solved, inflation = solve_effects(fine, absorbed)
    found = []
    for slot, (group, (beta, cells)) in enumerate(zip(fine.groups, solved, strict=True)):
        cells = widening[slot] ** 2 * cells
        others = [other for i, other in enumerate(fine.groups) if i != slot]
        prior = fine.search.fixed.prior if absorbed[slot] else fine.search.prior
        grid = profile(fine.search, project(gram, evidence, prior, others), group, inflation)
        asked, doubt = group.effect.asked(session), group.effect.doubt
        best = group.effect.parameters(asked, group.joint, group.variant, beta, cells)
        parameters = grid.widened(best, asked, np.sqrt(np.diag(cells))) | grid.inner_parameters()
        parameters = {
            name: widened(one, doubt.of(name, one.value), name in doubt.places) for name, one in parameters.items()
        }
        found.append((parameters, beta, cells, is_certain(beta, cells, group.effect.essential(group.variant))))
    return found


def is_certain(beta: Float[Array, " k"], cells: Float[Array, "k k"], essential: Sequence[int]) -> bool:
    """Wald's test: whether some coefficients together are not zero, at 95 %; False where there are none."""
    if not essential:
        return False
    at = np.array(essential)
    distance = float(beta[at] @ np.linalg.pinv(cells[np.ix_(at, at)], hermitian=True) @ beta[at])
    return distance > float(chdtri(len(at), 0.05))


def solve_effects(
    fine: Refined, absorbed: Sequence[bool]
) -> tuple[list[tuple[Float[Array, " k"], Float[Array, "k k"]]], float]:
    """Coefficients of every effect with their covariance, each in its own view; and by how much misfit exceeds noise.

    A coefficient that its sign holds at zero is as uncertain as if it were free.

    Args:
        fine: The effects on their finer grids.
        absorbed: Whether each is estimated against the URDF fixed.
    """
    evidence, gram = fine.search.evidence, fine.search.evidence.gram()
    priors = (fine.search.prior, fine.search.fixed.prior) if any(absorbed) else 2 * (fine.search.prior,)
    views = [_off_their_bounds(evidence, prior, fine.groups) for prior in priors]
    free = [fast if hidden else tuned for tuned, fast, hidden in zip(*views, absorbed, strict=True)]
    used = [replace(one, columns=one.columns[kept]) for one, kept in zip(fine.groups, free, strict=True)]
    models = [project(gram, evidence, prior, used, signed=False) for prior in dict.fromkeys(priors)]
    covariances = [robust_covariance(evidence, model) for model in models]
    inflation = measure_inflation(evidence, models[0], covariances[0])
    if any(absorbed):
        reach = models[1].spread[:, : evidence.layout.rank]
        off = fine.search.settings.fixed_factor**4 * reach @ fine.search.prior.base @ reach.T
        covariances[1] = covariances[1] + off  # what the URDF's tolerance does to them
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


def _off_their_bounds(evidence: Evidence, prior: Prior, groups: Sequence[Group]) -> list[Bool[Array, " k"]]:
    """For each group which of its coefficients are not held at zero by their sign, all groups solved together."""
    columns = np.concatenate([group.columns for group in groups])
    signed = np.concatenate([np.isin(np.arange(len(g.columns)), g.signed) for g in groups])
    if not signed.any():
        return [np.ones(len(group.columns), dtype=bool) for group in groups]
    beta = project(evidence.gram(), evidence, prior).solve(columns, signed)
    free = np.split(~signed | (beta > 0.0), np.cumsum([len(group.columns) for group in groups])[:-1])
    return [kept if kept.any() else np.ones_like(kept) for kept in free]


def widened(interval: Interval, doubt: float, place: bool = False) -> Interval:
    """An interval that also holds what an arm's own law of an effect may differ from the catalogue's.

    An interval that does not go beyond zero never does, but for a place: doubt about a size is a share of it.
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


def _beside(
    search: Search, group: Group, others: Sequence[Group], rivals: Sequence[Group], own: float
) -> tuple[set[Key], dict[Key, float]]:
    """Which candidates explain something else than a name does, and what it adds beside each other one.

    What leaves a name most of its own evidence is no rival: both may be there.

    Args:
        search: The search.
        group: The name.
        others: The other names.
        rivals: The candidates.
        own: The name's evidence [nats].
    """
    gram, apart, added = search.evidence.gram(), set[Key](), dict[Key, float]()
    for rival in rivals:
        left = search.score_beside(gram, group, [*others, rival])
        if left > MOST * own:
            apart.add(rival.key)
        elif left > 0.0:
            added[rival.key] = left
    return apart, added


def _most_of_it(
    search: Search,
    best: Mapping[Key, tuple[float, Group]],
    group: Group,
    others: Sequence[Group],
    apart: Collection[Key],
    unit: float,
) -> dict[str, float]:
    """Log evidence of each effect that is a part of a name's law and explains most of what that does, by its id.

    A constant torque beside a slight spring is what a spring that rests out of reach is; a zero of the first joint
    beside a slight tilt is a tilt. Together with the name it explains the same, for the cost of one effect more.
    """
    gram, score, found = search.evidence.gram(), best[group.key][0], dict[str, float]()
    whole = project(gram, search.evidence, search.prior, [*others, group])
    for own, rival in best.values():
        most = own >= MOST * score and rival.key not in {group.key, *apart} and not rival.effect.event
        if most and search.score_of(whole, rival) <= 0.0:
            found[rival.effect.id] = score / unit - search.cost_of(rival)
    return found


def weigh_rivals(
    search: Search, projection: Projection, group: Group, others: Sequence[Group], excess: float
) -> tuple[float, tuple[str, ...], dict[str, float]]:
    """Probability of a name against all others for its slot, the names too near to it, and its odds against each.

    No arm obeys a law to the letter. Where its own differs by a share d of the torque, a rival may explain as much as
    ½ d² of the whole gain less: evidence is counted in units of that and of what tempers it anyway.
    """
    held, gram = search.settings, search.evidence.gram()
    standing = replace(search, barred=search.barred - (search.redundant - search.absurd))
    best = standing.best_by_key(projection, others, group)
    share = group.effect.doubt.share / NORMAL_95
    unit = excess + held.temper * 0.5 * share**2 * search.gain_of(projection, best[group.key][1])[0]
    least = max(best[group.key][0] - held.rival_nats * unit, held.least_nats)
    rivals = [rival for score, rival in best.values() if score > least and rival.key != group.key]
    allowed = {rival.key for rival in rivals} | {group.key}
    apart, added = _beside(search, group, others, rivals, best[group.key][0])
    ahead = {rival.key for rival in rivals if best[rival.key][0] > best[group.key][0]} - apart
    # Nor is one ahead that would not get the name itself.
    stronger = search.judge(gram, projection, others, [best[key] for key in ahead])
    allowed -= apart | {item.group.key for item in stronger if not item.gates.passed}
    scores: dict[Key, float] = {key: score / unit for key, (score, _) in best.items() if key in allowed}
    both = [scores[key] + added[key] / unit for key in (ahead & allowed & added.keys()) - search.redundant]
    own = max([scores[group.key], *both])
    best_of_effect = _most_of_it(search, best, group, others, apart, unit)
    for (effect, _, _), score in scores.items():
        best_of_effect[effect] = max(best_of_effect.get(effect, -np.inf), score)
    best_of_effect[group.effect.id] = own
    ids = list(best_of_effect)
    # Where a law that no arm has explains it better by far, something of that shape is there that the catalogue lacks.
    absurd = search.best_absurd(projection).values()
    nameless = [score / unit for score, one in absurd if search.score_beside(gram, group, [*others, one]) <= 0.0]
    logs = held.temper * np.array([*best_of_effect.values(), *nameless, 0.0])
    weights = np.exp(logs - logs.max())
    probability = held.most_sure * float(weights[ids.index(group.effect.id)] / weights.sum())
    ahead_of = {name: held.temper * (own - score) for name, score in best_of_effect.items() if name != group.effect.id}
    odds = {name: float(np.exp(np.clip(nats, -MOST_NATS, MOST_NATS))) for name, nats in ahead_of.items()}
    near = sorted((name for name, one in odds.items() if one <= held.class_odds), key=odds.__getitem__)
    return probability, (group.effect.id, *near), odds
