"""How far tuning moved each link from its URDF: what it absorbs no residual shows, so it is always reported.

Of the inertial numbers π only the base parameters β = B π act on the torques. The solved model knows their change δ
with information J, whatever the URDF says. Two things are reported of each link:

- About its joint's axis: the first moment of all that turns with the joint, averaged over full turns of the joints
  behind it. That is the combination that gravity shows, M = W π with W in the row space of B, so it needs no prior.
- The link's own mass and first moment. Those are no base parameters: which link a change belongs to hangs on how wrong
  each may be. Every link has a variance of its own, σ_k, a URDF's usual error unless

      log p(y | σ) = ½ hᵀ (J + C⁻¹)⁻¹ h − ½ log|I + C J|,    C = B S(σ) Bᵀ,  h = J δ,

  speaks for more at that link (automatic relevance determination, one link after the other). Numbers of which the
  recordings take away less than half of the prior's variance are left out: they are the URDF's word.

A link is beyond tolerance where the interval of one of its own numbers lies wholly beyond three standard deviations of
a usual URDF; or, where its own are not determined and the recordings speak for more at that link, that about its axis.

Source: MacKay 1992 and Tipping 2001 (relevance determination); Gautier 1991 (base parameters).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from ident.arrays import Array, Float
from ident.effects.intervals import NORMAL_95, Interval
from ident.model.inertia import base_prior
from ident.records import read_group
from ident.regression.baseline import Baseline
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "tuned_links")
# Names of a link's changes.
MASS, MOMENT, ABOUT = "mass_change_kg", "moment_change_{}_kgm", "about_axis_kgm"


@dataclass(frozen=True, eq=False)
class TunedLink:
    """Change of a link from its URDF."""

    joint: str  # the joint that moves it
    mass: Interval | None  # change of its mass [kg]; None where the recordings don't determine it
    # Change of its first moment in its joint's frame, by axis, as far as determined [kg m].
    moment: Mapping[str, Interval]
    # Change of the first moment about the joint's axis of all that turns with it, along the URDF's own [kg m]; None
    # where gravity shows nothing of it.
    about_axis: Interval | None
    urdf_moment: float  # what the URDF says of that moment [kg m]; 0 where that is no more than URDFs are off by
    beyond: frozenset[str]  # which of its changes, by their names in `changes`, are more than URDFs are wrong by
    # Log evidence that it is, its neighbours as far off as they like [nats]; 0 where nothing is beyond.
    evidence: float = 0.0

    @property
    def beyond_tolerance(self) -> bool:
        """Whether any change is more than URDFs are wrong by."""
        return bool(self.beyond)

    @property
    def share(self) -> Interval | None:
        """Change about the axis as a share of the URDF's moment."""
        if self.about_axis is None or self.urdf_moment == 0.0:
            return None
        return Interval(*(getattr(self.about_axis, end) / self.urdf_moment for end in ("value", "low", "high")))

    def to_dict(self) -> dict[str, Any]:
        """Its record; what is not determined is left out."""
        record: dict[str, Any] = {"joint": self.joint, "beyond_tolerance": self.beyond_tolerance}
        if self.mass is not None:
            record["mass_kg"] = self.mass.to_dict()
        record["moment_kgm"] = {axis: one.to_dict() for axis, one in self.moment.items()}
        if self.about_axis is not None:
            record["about_axis_kgm"] = self.about_axis.to_dict()
        if self.share is not None:
            record["about_axis_share"] = self.share.to_dict()
        return record

    def changes(self) -> dict[str, Interval]:
        """Its changes by name."""
        named = {MASS: self.mass, ABOUT: self.about_axis}
        moments = {MOMENT.format(axis): one for axis, one in self.moment.items()}
        return {name: one for name, one in named.items() if one is not None} | moments

    def words(self, link: str) -> str:
        """What is wrong with the URDF's link, in a sentence."""
        parts = []
        if ABOUT in self.beyond and self.about_axis is not None:
            moved = self.about_axis.words("kg m") if self.share is None else self.share.words("%", 100.0)
            parts.append(f"the moment about its axis by {moved}")
        if MASS in self.beyond and self.mass is not None:
            parts.append(f"its mass by {self.mass.words('kg')}")
        along = [(axis, one) for axis, one in self.moment.items() if MOMENT.format(axis) in self.beyond]
        parts += [f"its moment along {axis} by {one.words('kg m')}" for axis, one in along]
        how = f"tuning moved {' and '.join(parts)}"
        return f"{link} is off by more than URDFs are: {how}; mend its <inertial>, or the gain of {self.joint}"


def measure_tuned_links(
    baseline: Baseline, evidence: Evidence, projection: Projection, prior: Prior, inflation: float
) -> dict[str, TunedLink]:
    """Change of every link, by its name.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence: Scale and layout of the columns.
        projection: The solved model, the named effects in it.
        prior: The belief about the URDF that it was solved with.
        inflation: How many times the modelled variance blocks vary.
    """
    arm, mapping = baseline.nominal, baseline.base.mapping
    information, score = _of_recordings(evidence, projection, prior, inflation)
    relevance = _Relevance(baseline, information, score)
    factors = relevance.best()
    std = relevance.std(factors)
    posterior = np.linalg.inv(information + base_prior(baseline.base, std))
    lift = (std[:, None] ** 2 * mapping.T) @ base_prior(baseline.base, std)
    change = lift @ (posterior @ score)
    variance = std**2 - np.sum(lift * (mapping * std**2).T, axis=1) + np.sum((lift @ posterior) * lift, axis=1)
    own = [_interval(value, width) for value, width in zip(change, np.sqrt(np.maximum(variance, 0.0)), strict=True)]
    known = variance < (1.0 - LIMIT.least_share) * std**2
    # As good as no prior: what the recordings leave open stays far wider than a URDF's error.
    free = np.linalg.inv(information + base_prior(baseline.base, LIMIT.unknown * baseline.number_std))
    found = {}
    for k, link in enumerate(arm.links):
        at = range(10 * k, 10 * k + 4)
        about, urdf, usual = _about_axis(baseline, k, free, free @ score)
        names = (MASS, *(MOMENT.format(axis) for axis in "xyz"))
        wrong = {
            name for name, i in zip(names, at, strict=True) if known[i] and _is_beyond(own[i], baseline.number_std[i])
        }
        if about is not None and std[at[0]] > baseline.number_std[at[0]] and _is_beyond(about, usual):
            wrong.add(ABOUT)
        moment = {axis: own[i] for axis, i in zip("xyz", at[1:], strict=True) if known[i]}
        mass = own[at[0]] if known[at[0]] else None
        apart = relevance.apart(factors, k) if wrong else 0.0
        found[link] = TunedLink(arm.joint_names[k], mass, moment, about, urdf, frozenset(wrong), apart)
    return found


def _of_recordings(
    evidence: Evidence, projection: Projection, prior: Prior, inflation: float
) -> tuple[Float[Array, "r r"], Float[Array, " r"]]:
    """Information of the recordings alone about the base parameters, the model's other columns free, and its score."""
    rank = evidence.layout.rank
    scale = evidence.scale[:rank]
    whole = np.linalg.inv(projection.spread[:rank, :rank])
    values, vectors = np.linalg.eigh(whole - prior.base)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    score = whole @ projection.estimate[:rank]
    return information * np.outer(scale, scale) / inflation, score * scale / inflation


@dataclass(frozen=True, eq=False)
class _Relevance:
    """How many times more than a URDF's links usually are each is off, and what the recordings say for it."""

    baseline: Baseline
    information: Float[Array, "r r"]  # of the recordings about the base parameters
    score: Float[Array, " r"]  # its score

    def std(self, factors: Sequence[float]) -> Float[Array, " 10n"]:
        """Standard deviation of every link's numbers."""
        return np.asarray(np.repeat(factors, 10) * self.baseline.number_std)

    def best(self, start: Sequence[float] = (), barred: int = -1) -> tuple[float, ...]:
        """Factors of most evidence, one link after the other.

        Args:
            start: To begin with; ones if none are given.
            barred: Link that has none.
        """
        factors = tuple(start) or (1.0,) * self.baseline.nominal.n
        reached = self._evidence(factors)
        for _ in range(2 * len(factors)):
            tried = [
                (*factors[:k], factor, *factors[k + 1 :])
                for k in range(len(factors))
                for factor in (1.0, *LIMIT.factors)
                if k != barred and factor != factors[k]
            ]
            found = [self._evidence(one) for one in tried]
            if max(found) <= reached:
                break
            reached, factors = max(found), tried[int(np.argmax(found))]
        return factors

    def apart(self, factors: tuple[float, ...], link: int) -> float:
        """Log evidence for a link's factor, the others' as they are best without it [nats]."""
        if factors[link] == 1.0:
            return 0.0
        without = self.best((*factors[:link], 1.0, *factors[link + 1 :]), link)
        return self._evidence(factors) - self._evidence(without)

    def _evidence(self, factors: tuple[float, ...]) -> float:
        mapping, std = self.baseline.base.mapping, self.std(factors)
        root = np.linalg.cholesky((mapping * std**2) @ mapping.T)
        half = np.linalg.cholesky(np.eye(len(root)) + root.T @ self.information @ root)
        along = solve_triangular(half, root.T @ self.score, lower=True)
        cost = (LIMIT.least_nats + np.log(len(factors))) * sum(factor != 1.0 for factor in factors)
        return float(0.5 * along @ along - np.log(np.diag(half)).sum() - cost)


def turning_moment(arm: ArmModel, joint: int) -> Float[Array, "3 10n"]:
    """Maps the links' numbers to the first moment, in a joint's frame, of all that turns with it [kg m].

    Averaged over full turns of the revolute joints behind it, which leaves of each link what lies along its axis.
    """
    mass, moment = np.zeros((1, 10 * arm.n)), np.zeros((3, 10 * arm.n))
    for k in reversed(range(joint, arm.n)):
        mass[0, 10 * k], moment[:, 10 * k + 1 : 10 * k + 4] = 1.0, moment[:, 10 * k + 1 : 10 * k + 4] + np.eye(3)
        if k == joint:
            return moment
        axis, place = arm.joint_axes[k], arm.model.jointPlacements[k + 1]
        kept = moment if arm.sliding_joints[k] else np.outer(axis, axis) @ moment
        moment = place.rotation @ kept + np.outer(place.translation, mass)
    return moment


def _about_axis(
    baseline: Baseline, joint: int, covariance: Float[Array, "r r"], change: Float[Array, " r"]
) -> tuple[Interval | None, float, float]:
    """Change of the moment about a joint's axis along the URDF's own, the URDF's, and what a usual URDF is off by."""
    arm, mapping = baseline.nominal, baseline.base.mapping
    axis = arm.joint_axes[joint]
    rows = (np.eye(3) - np.outer(axis, axis)) @ turning_moment(arm, joint)
    urdf = rows @ arm.inertial_parameters
    size = float(np.linalg.norm(urdf))
    mass = float(arm.inertial_parameters[10 * joint :: 10].sum())
    if arm.sliding_joints[joint] or size < LIMIT.least_moment * mass:
        return None, size, 0.0
    along = urdf / size @ rows
    weights = np.linalg.lstsq(mapping.T, along, rcond=None)[0]
    determined = np.linalg.norm(weights @ mapping - along) < 1e-6 * np.linalg.norm(along)
    std = float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
    usual = float(np.sqrt(np.sum((along * baseline.number_std) ** 2)))
    if not determined or not 0.0 < std < usual:
        return None, size, usual
    return _interval(float(weights @ change), std), size if size > usual else 0.0, usual


def _interval(value: float, std: float) -> Interval:
    return Interval(float(value), float(value - NORMAL_95 * std), float(value + NORMAL_95 * std))


def _is_beyond(change: Interval, usual: float) -> bool:
    return max(change.low, -change.high) > LIMIT.beyond * usual
