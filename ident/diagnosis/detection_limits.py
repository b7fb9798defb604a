"""Detection limits: the least size at which an effect that was not found would have been accepted nine times in ten.

In: the final model and its sums. Out: a `SizeLimit` for each effect at each joint, without a further fit. Where the
model leaves the columns the information I (a Schur complement of the whitened sums, encoder noise subtracted, the
URDF's prior included), coefficients β gain ½ λ ± √λ nats, λ = βᵀ I β. Acceptance needs T nats, and a fall of the
held-out error that matters. Both measures grow with the square of the size; the least multiple m of a typical effect
satisfies

    m² = max( z² s / λ, (least mean square that matters) / (βᵀ A β) ),  z = √(2 T) + 1.28,

with s the variance inflation and A the plain sums per sample of what the model leaves of the columns. At z nine in ten
would be accepted if the criteria were only these; they are stricter by a factor that was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.compiled import compiled
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.criteria import SearchResults
from ident.effects.base import Effect, SessionContext, impossible
from ident.records import read_group
from ident.regression.design import Group, NotTestable
from ident.regression.least_squares import Projection
from ident.regression.noise import Whitening

LIMIT = read_group(__file__, "detection_limits")

HIDES = {"encoder": "encoder noise", "torque": "torque noise", "tolerance": "the URDF's tolerance"}


@dataclass(frozen=True, eq=False)
class SizeLimit:
    """Detection limit of an effect at a joint."""

    effect: Effect  # the effect
    joint: int  # index of its joint
    parameter: str  # the reported parameter that is its size
    # Limit in the parameter's unit, an upper one for an inverse parameter (a stiffness); None for an invisible effect.
    value: float | None
    hidden: bool  # whether the limit is beyond the plausible range: no plausible effect would have been accepted
    bound_by: str  # what hides smaller effects: one of `HIDES`, or `size` if they are too small to matter

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """Its record, with joint names."""
        return {
            "effect": self.effect.id,
            "joints": [joints[self.joint]] if self.effect.scope == "joint" else list(joints),
            "figure": self.parameter,
            "limit": self.value,
            "named": "below" if self.effect.typical.inverse else "above",
            "hidden": self.hidden,
            "bound_by": self.bound_by,
        }

    def untestable(self, joints: Sequence[str]) -> NotTestable:
        """The entry of `not_testable` for an effect that is hidden."""
        where = f" of {joints[self.joint]}" if self.effect.scope == "joint" else ""
        least = "above" if self.effect.typical.inverse else "below"
        limit = f"{self.parameter} {least} {{:.2g}}, more than is plausible"
        hidden = "it completely" if self.value is None else limit.format(self.value)
        return NotTestable(self.effect, self.joint, f"{HIDES[self.bound_by]}{where} hides {hidden}")


@dataclass(frozen=True, eq=False)
class _TypicalEffect:
    """An effect of typical size at a joint, and by how much it must grow to be accepted."""

    group: Group  # its point of the grid
    beta: Float[Array, " k"]  # its coefficients
    size: float  # the parameter that is its size
    by_noise: float  # least multiple whose log evidence suffices
    by_size: float  # least multiple whose held-out gain suffices

    @property
    def multiple(self) -> float:
        """Least multiple that would have been accepted."""
        return LIMIT.in_practice * max(self.by_noise, self.by_size)


def find_limits(
    search: Candidates,
    found: SearchResults,
    views: tuple[Projection, Projection],
    inflation: float,
    session: SessionContext,
) -> tuple[SizeLimit, ...]:
    """Detection limits of all effects at all joints where they were not accepted.

    Args:
        search, found, session: The search, its results, and the runs.
        views, inflation: The final model, with tuned and with fixed inertias, and its variance inflation.
    """
    accepted = {item.group.key[:2] for item in found.accepted}
    places: dict[tuple[str, int], dict[int | None, list[Group]]] = {}
    for group in search.evidence.layout.groups:
        if group.key[:2] not in accepted and not group.effect.event and group.effect.typical.figure:
            places.setdefault(group.key[:2], {}).setdefault(group.variant.other, []).append(group)
    finder = _LimitFinder(search, found, views, inflation, session)
    limits = (_limit_at(finder, list(by_other.values())) for by_other in places.values())
    return tuple(limit for limit in limits if limit is not None)


def _limit_at(finder: _LimitFinder, by_other: Sequence[Sequence[Group]]) -> SizeLimit | None:
    """The limit of an effect at a joint at typical inner parameters; of effects with a second joint, the worst one."""
    worst: _TypicalEffect | None = None
    for groups in by_other:
        tried = [one for one in map(finder.at, _typical_points(groups)) if one is not None]
        best = min(tried, key=lambda one: one.multiple, default=None)
        if best is not None and (worst is None or best.multiple > worst.multiple):
            worst = best
    if worst is None:
        return None
    effect, multiple = worst.group.effect, worst.multiple
    hidden = multiple * effect.typical.share > 1.0 or finder.is_impossible(worst)
    bound = finder.bound_by(worst.group) if worst.by_noise >= worst.by_size else "size"
    value = worst.size / multiple if effect.typical.inverse else worst.size * multiple
    shows = multiple * effect.typical.share < LIMIT.nothing
    return SizeLimit(effect, worst.group.joint, effect.typical.figure, value if shows else None, hidden, bound)


def _typical_points(groups: Sequence[Group]) -> list[Group]:
    """The grid points nearest to the typical inner parameters; all points if none are typical."""
    apart = [group.effect.typical.distance(group.variant.inner) for group in groups]
    return [group for group, one in zip(groups, apart, strict=True) if one <= min(apart) + 1e-9]


class _LimitFinder:
    """Computes the multiples of typical effects that the final model would have accepted."""

    def __init__(
        self,
        search: Candidates,
        found: SearchResults,
        views: tuple[Projection, Projection],
        inflation: float,
        session: SessionContext,
    ) -> None:
        self.search, self.views, self.inflation, self.session = search, views, inflation, session
        evidence = search.evidence
        self.floor, self.last = evidence.floor, found.ladder[-1].rms
        self.gap = np.maximum(found.ladder[0].rms ** 2 - self.floor**2, 0.0)
        self.plain = tuple(one.over() for one in evidence.plain)
        self.counts = np.maximum(evidence.weights.sum(axis=0), 1.0)
        self._parts: dict[tuple[str, int, float | None], Bool[Array, " k"] | None] = {}

    def at(self, group: Group) -> _TypicalEffect | None:
        """A typical effect at a grid point; None if its size is not proportional to its coefficients."""
        beta = self._coefficients(group)
        if beta is None:
            return None
        absorbed = self._is_absorbed(group)
        kept = beta != 0.0
        columns, scaled = group.columns[kept], (beta * self.search.evidence.scale[group.columns])[kept]
        scaled = np.where(self.views[0].seen(columns), scaled, 0.0)
        power = float(scaled @ self.views[0].rest(columns) @ scaled)
        needed = np.sqrt(2.0 * max(self._required_log_evidence(group, absorbed, beta), 0.0)) + LIMIT.nine_in_ten
        by_noise = needed * np.sqrt((1.0 if absorbed else self.inflation) / max(power, 1e-300))
        joints = group.acts_on(self.search.evidence.layout.n)
        closed = np.array([self._closed(self.views[absorbed], columns, scaled, j) for j in joints])
        by_size = 1.0 / np.sqrt(max(self._relevance(absorbed, closed, joints), 1e-300))
        return _TypicalEffect(group, beta, self._size(group, beta), float(by_noise), float(by_size))

    def is_impossible(self, one: _TypicalEffect) -> bool:
        """Whether no arm has the effect at the size that it would need."""
        group, beta = one.group, one.multiple * one.beta
        certain, context = np.zeros((len(beta), len(beta))), self._context(group)
        estimates = group.effect.parameters(context, group.joint, group.variant, beta, certain)
        return impossible(group.effect, context, group.joint, estimates) is not None

    def bound_by(self, group: Group) -> str:
        """What hides an effect most."""
        if self._is_absorbed(group):
            return "tolerance"
        if self.views[0].buried(group.columns).any():  # by encoder noise
            return "encoder"
        shares = encoder_share(self.search.evidence.whitening)[group.acts_on(self.search.evidence.layout.n)]
        return "encoder" if float(shares.max()) > 0.5 else "torque"

    def _coefficients(self, group: Group) -> Float[Array, " k"] | None:
        """Coefficients of a typical effect, zero where its size does not depend on them."""
        width = len(group.columns)
        beta = group.effect.typical_coefficients(self._context(group), group.joint, group.variant, width)
        key = group.effect.id, width, group.variant.shape.get("law")
        if key not in self._parts:  # all joints share the answer
            self._parts[key] = self._parts_of(group, beta)
        parts = self._parts[key]
        return None if parts is None else np.where(parts, beta, 0.0)

    def _parts_of(self, group: Group, beta: Float[Array, " k"]) -> Bool[Array, " k"] | None:
        """Which coefficients determine the size; None if it is not proportional to them."""
        whole = self._size(group, beta)
        parts = beta != 0.0
        for k in np.flatnonzero(parts):
            without = np.where(np.arange(len(beta)) == k, 0.0, beta)
            if without.any() and np.isclose(self._size(group, without), whole, rtol=1e-6):
                parts[k] = False
        half = self._size(group, np.where(parts, 0.5 * beta, 0.0)) * (0.5 if group.effect.typical.inverse else 2.0)
        return parts if parts.any() and whole > 0.0 and abs(half / whole - 1.0) < LIMIT.proportion else None

    def _size(self, group: Group, beta: Float[Array, " k"]) -> float:
        """Value of the parameter that is an effect's size."""
        return group.effect.size_of(self._context(group), group.joint, group.variant, beta)

    def _context(self, group: Group) -> SessionContext:
        return self.session

    def _is_absorbed(self, group: Group) -> bool:
        return self.search.is_absorbed(*self.views, group)

    def _required_log_evidence(self, group: Group, absorbed: bool, beta: Float[Array, " k"]) -> float:
        """Gain that acceptance needs: the cost of the effect's prior, columns and grid, and the threshold [nats]."""
        cost = self.search.complexity_cost(group)
        if group.prior is not None:
            known = self.views[0].rest(group.columns)
            scaled = beta * self.search.evidence.scale[group.columns]
            return self.search.inertial_threshold + self.search.prior_cost(group, group.prior, scaled, known)
        return self.search.settings.least_nats + cost

    def _closed(self, view: Projection, columns: Array, beta: Array, joint: int) -> float:
        """Mean square of the torque at a joint that coefficients explain beyond a model [N² m²]."""
        weights = (view.left_of(columns) @ beta)[self.search.evidence.layout.local[joint]]
        used = np.flatnonzero(weights)
        squares = weights[used] @ self.plain[joint][np.ix_(used, used)] @ weights[used]
        return max(float(squares) / float(self.counts[joint]), 0.0)

    def _relevance(self, absorbed: bool, closed: Float[Array, " k"], joints: Sequence[int]) -> float:
        """Least ratio of the closed mean squares to those that the acceptance criteria need."""
        settings = self.search.settings
        ratio = float(np.max(closed / np.maximum(settings.least_own_share * self.gap[joints], 1e-12)))
        if absorbed:
            return ratio
        left = self.last[joints] ** 2
        share = settings.least_gap_fall / (1.0 - settings.least_gap_fall)
        fall = (1.0 - settings.least_rms_fall) ** -2 - 1.0
        least = np.maximum(fall * left, share * (left - self.floor[joints] ** 2))
        return min(ratio, float(np.max(closed / np.maximum(least, 1e-12))))


def encoder_share(whitening: Whitening) -> Float[Array, " n"]:
    """Share of each joint's residual variance that is encoder noise in its columns."""
    response = np.zeros((len(whitening.coefficients), LIMIT.response))
    _respond(np.ascontiguousarray(whitening.coefficients), response)
    total = whitening.innovation**2 * np.sum(response**2, axis=1)
    return np.clip(1.0 - whitening.level**2 / np.maximum(total, 1e-300), 0.0, 1.0)


@compiled(error_model="numpy", nogil=True)
def _respond(filtering: Array, response: Array) -> None:
    """Impulse response of autoregressive noise, from its prediction-error filter (1, −a₁, …), filter by filter."""
    for i in range(filtering.shape[0]):
        response[i, 0] = 1.0
        for k in range(1, response.shape[1]):
            for lag in range(1, min(k, filtering.shape[1] - 1) + 1):
                response[i, k] -= filtering[i, lag] * response[i, k - lag]
