"""Parameters of each accepted effect with intervals that are robust to correlated noise.

In: the accepted effects on coarse and fine grids. Out: an `Estimate` each. Coefficients have the block sandwich
covariance, S = A⁻¹ (Σ_b g_b g_bᵀ) A⁻¹ with the score g_b of block b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from ident.arrays import Array, Bool, Float
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.criteria import Evaluated
from ident.diagnosis.selection.profile import profile
from ident.effects import optional
from ident.effects.base import Interval, SessionContext, undefined
from ident.inference.estimate import Estimate as CauseEstimate
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, project
from ident.regression.run_spread import measure_inflation, robust_covariance


@dataclass(frozen=True, eq=False)
class Estimate(CauseEstimate):
    """Parameters of one accepted effect, and whether they are significant; probability and rivals as far as known."""

    significant: bool = False  # whether its essential coefficients differ from zero at 95 %

    @property
    def undefined(self) -> str | None:
        """Why the effect is not established, or None.

        A parameter may be undetermined though the effect is significant: the stiffness of a spring at a rest out of
        reach.
        """
        return None if self.significant else undefined(self.refined.effect, self.parameters)


@dataclass(frozen=True, eq=False)
class Refined:
    """Accepted effects at their best points of the fine grids."""

    search: Candidates  # over the sums of the fine grids alone
    groups: tuple[Group, ...]  # the effects at their best points


def estimate_effects(
    fine: Refined, session: SessionContext, effects: Sequence[Evaluated], widening: Sequence[float] = ()
) -> list[Estimate]:
    """Parameters of every accepted effect, each as certain as can be: nobody has weighed it against rivals yet.

    Args:
        fine: The accepted effects on fine grids.
        session, effects: The runs, and the accepted effects on the coarse grids.
        widening: For each effect a factor on the standard deviations of its coefficients; ones if empty.
    """
    absorbed = [item.absorbed for item in effects]
    found = _parameters(fine, session, absorbed, widening or [1.0] * len(effects))
    estimates = []
    for item, refined, (parameters, beta, cells, significant) in zip(effects, fine.groups, found, strict=True):
        name = item.group.effect.id
        estimate = Estimate(item.group, parameters, 1.0, (name,), refined, beta, cells, {}, significant=significant)
        estimates.append(estimate)
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
        essential = optional.essential(group.effect, group.variant)
        found.append((parameters, beta, cells, is_significant(beta, cells, essential)))
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
