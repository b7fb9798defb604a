"""Detection limits: the least size of an effect that would have been named, nine times in ten.

In: the sums that the named effects and the discrepancies leave. Out: a `SizeLimit` for each effect
at each joint, without a further fit. Coefficients β of which these sums hold the information R gain
½ λ ± √λ nats, λ = βᵀ R β. A name needs T nats, the log evidence at which half of the corpus'
effects were right, and the cost C of its coefficients' prior. The least multiple m of a typical
effect satisfies

    m² = z² / λ,  z = √(2 (T + C)) + 1.28.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.compiled import compiled
from ident.diagnosis.settings import DETECTION_LIMITS as LIMIT
from ident.effects import optional
from ident.effects.base import Effect, SessionContext, impossible
from ident.inference.conclusion import Conclusion
from ident.inference.search import SetSearch
from ident.inference.solution import FIXED
from ident.regression.design import Group, NotTestable
from ident.regression.noise import Whitening

HIDES = {"encoder": "encoder noise", "torque": "torque noise", "tolerance": "the URDF's tolerance"}


@dataclass(frozen=True, eq=False)
class SizeLimit:
    """Detection limit of an effect at a joint."""

    effect: Effect  # the effect
    joint: int  # index of its joint
    parameter: str  # the reported parameter that is its size
    # Limit in the parameter's unit, an upper one for an inverse parameter (a stiffness); None for
    # an invisible effect.
    value: float | None
    # Whether the limit is beyond the plausible range: no plausible effect would have been accepted.
    hidden: bool
    bound_by: str  # what hides smaller effects: one of `HIDES`

    def to_dict(self, joints: Sequence[str]) -> dict[str, object]:
        """Its record for JSON.

        Args:
            joints: Names of the arm's joints.

        Returns:
            `effect`, `joints`, `figure` (name of the parameter), `limit` (None if the effect is
            hidden at any size), `named` (`above` or `below` the limit), `hidden` and `bound_by`.
        """
        of_a_joint = self.effect.scope == "joint"
        return {
            "effect": self.effect.id,
            "joints": [joints[self.joint]] if of_a_joint else list(joints),
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
    multiple: float  # least multiple that would have been named


def find_limits(conclusion: Conclusion, session: SessionContext) -> tuple[SizeLimit, ...]:
    """Detection limits of all effects at all joints where they are no names.

    Effects that happen once, and those without a size, have none.

    Args:
        conclusion, session: The causes, and the runs.
    """
    named = {name.group.key[:2] for name in conclusion.names}
    places: dict[tuple[str, int], dict[int | None, list[Group]]] = {}
    for group in conclusion.inference.best.search.names.groups:
        place = group.key[:2]
        known = place in named or group.effect.event
        if not known and group.effect.typical.figure:
            by_other = places.setdefault(place, {})
            by_other.setdefault(group.variant.other, []).append(group)
    finder = _LimitFinder(conclusion, session)
    limits = (_limit_at(finder, list(by_other.values())) for by_other in places.values())
    return tuple(limit for limit in limits if limit is not None)


def _limit_at(finder: _LimitFinder, by_other: Sequence[Sequence[Group]]) -> SizeLimit | None:
    """The limit of an effect at a joint, at typical inner parameters.

    Args:
        finder: What computes multiples of typical effects.
        by_other: The effect's grid points by its second joint, of which the worst one decides.
    """
    worst: _TypicalEffect | None = None
    for groups in by_other:
        points = map(finder.typical_effect, _typical_points(groups))
        proportional = [typical for typical in points if typical is not None]
        best = min(proportional, key=lambda typical: typical.multiple, default=None)
        if best is not None and (worst is None or best.multiple > worst.multiple):
            worst = best
    if worst is None:
        return None
    typical = worst.group.effect.typical
    # Of what is plausible, the share that the limit takes.
    share = worst.multiple * typical.share
    size = worst.size / worst.multiple if typical.inverse else worst.size * worst.multiple
    return SizeLimit(
        effect=worst.group.effect,
        joint=worst.group.joint,
        parameter=typical.figure,
        value=size if share < LIMIT.nothing else None,
        hidden=share > 1.0 or finder.is_impossible(worst),
        bound_by=finder.bound_by(worst),
    )


def _typical_points(groups: Sequence[Group]) -> list[Group]:
    """The grid points nearest to the typical inner parameters; all points if none are typical."""
    distances = [group.effect.typical.distance(group.variant.inner) for group in groups]
    nearest = min(distances) + 1e-9
    points = zip(groups, distances, strict=True)
    return [group for group, distance in points if distance <= nearest]


class _LimitFinder:
    """Computes the multiples of typical effects that would have been named."""

    def __init__(self, conclusion: Conclusion, session: SessionContext) -> None:
        best = conclusion.inference.best
        chosen = [name.described.coarse for name in conclusion.names]
        self.session = session
        self.evidence = best.model.sums.evidence
        self.needed_nats = conclusion.calibration.even_nats
        self.names = best.search.names
        self.first = best.search.names.first
        self.scale = best.search.scale
        self.rest = best.search.beside(chosen)
        fixed = best.model.with_urdf(best.model.components.urdf.divided(FIXED))
        self.rest_fixed = SetSearch.of(fixed).beside(chosen)
        self._decisive: dict[tuple[str, int, float | None], Bool[Array, " k"] | None] = {}

    def typical_effect(self, group: Group) -> _TypicalEffect | None:
        """The typical effect of a grid point; None if its size is not proportional to β."""
        beta = self._coefficients(group)
        if beta is None:
            return None
        deviation = self.names.deviation[group]
        columns = group.columns - self.first
        information = self.rest[np.ix_(columns, columns)]
        widened = np.eye(len(columns)) + deviation[:, None] * information * deviation
        _, log_determinant = np.linalg.slogdet(widened)
        cost = 0.5 * float(log_determinant) - self.names.log_odds[group]
        nats = max(self.needed_nats + cost, 0.0)
        needed = np.sqrt(2.0 * nats) + LIMIT.nine_in_ten
        power = max(self._power(self.rest, group, beta), 1e-300)
        multiple = float(needed / np.sqrt(power))
        return _TypicalEffect(group, beta, self._size(group, beta), multiple)

    def _power(self, rest: Float[Array, "c c"], group: Group, beta: Float[Array, " k"]) -> float:
        """Whitened squares of an effect's torque beside everything else."""
        columns = group.columns - self.first
        scaled = beta * self.scale[columns]
        return float(scaled @ rest[np.ix_(columns, columns)] @ scaled)

    def is_impossible(self, typical: _TypicalEffect) -> bool:
        """Whether no arm has the effect at the size that it would need."""
        group = typical.group
        beta = typical.multiple * typical.beta
        certain = np.zeros((len(beta), len(beta)))
        estimates = group.effect.parameters(self.session, group.joint, group.variant, beta, certain)
        return impossible(group.effect, self.session, group.joint, estimates) is not None

    def bound_by(self, typical: _TypicalEffect) -> str:
        """What hides an effect most: a key of `HIDES`."""
        group = typical.group
        power = self._power(self.rest, group, typical.beta)
        power_urdf_fixed = self._power(self.rest_fixed, group, typical.beta)
        # Inertias that may be off take more of it than noise leaves.
        if 2.0 * power < power_urdf_fixed:
            return "tolerance"
        joints = group.acts_on(self.evidence.layout.n)
        shares = encoder_share(self.evidence.whitening)[joints]
        return "encoder" if float(shares.max()) > 0.5 else "torque"

    def _coefficients(self, group: Group) -> Float[Array, " k"] | None:
        """Coefficients of a typical effect, zero where its size does not depend on them."""
        width = len(group.columns)
        beta = optional.typical_coefficients(
            group.effect, self.session, group.joint, group.variant, width
        )
        key = (group.effect.id, width, group.variant.shape.get("law"))
        if key not in self._decisive:  # all joints share the answer
            self._decisive[key] = self._decisive_of(group, beta)
        decisive = self._decisive[key]
        return None if decisive is None else np.where(decisive, beta, 0.0)

    def _decisive_of(self, group: Group, beta: Float[Array, " k"]) -> Bool[Array, " k"] | None:
        """Which coefficients determine the size; None if it is not proportional to them."""
        whole = self._size(group, beta)
        decisive = beta != 0.0
        for k in np.flatnonzero(decisive):
            without = np.where(np.arange(len(beta)) == k, 0.0, beta)
            if without.any() and np.isclose(self._size(group, without), whole, rtol=1e-6):
                decisive[k] = False
        if not decisive.any() or not whole > 0.0:
            return None
        size_of_half = self._size(group, np.where(decisive, 0.5 * beta, 0.0))
        expected = 2.0 if group.effect.typical.inverse else 0.5
        ratio = size_of_half / expected / whole
        return decisive if abs(ratio - 1.0) < LIMIT.proportion else None

    def _size(self, group: Group, beta: Float[Array, " k"]) -> float:
        """Value of the parameter that is an effect's size."""
        return optional.size_of(group.effect, self.session, group.joint, group.variant, beta)


def encoder_share(whitening: Whitening) -> Float[Array, " n"]:
    """Share, from 0 to 1, of each joint's residual variance that encoder noise in its columns makes
    up.
    """
    response = np.zeros((len(whitening.coefficients), LIMIT.response))
    _respond(np.ascontiguousarray(whitening.coefficients), response)
    variance = whitening.innovation**2 * np.sum(response**2, axis=1)
    torque_share = whitening.level**2 / np.maximum(variance, 1e-300)
    return np.clip(1.0 - torque_share, 0.0, 1.0)


@compiled(error_model="numpy", nogil=True)
def _respond(filtering: Array, response: Array) -> None:
    """Impulse responses of autoregressive noise, from prediction-error filters (1, −a₁, …)."""
    for i in range(filtering.shape[0]):
        response[i, 0] = 1.0
        for k in range(1, response.shape[1]):
            for lag in range(1, min(k, filtering.shape[1] - 1) + 1):
                response[i, k] -= filtering[i, lag] * response[i, k - lag]
