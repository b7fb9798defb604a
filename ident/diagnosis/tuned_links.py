"""Change of each link's inertia from the URDF by tuning, with a relevance test for each link.

In: the solved model. Out: a `TunedLink` for each link. It is always reported, for tuning leaves no residual.

Of the inertial parameters π only the base parameters β = B π act on the torques. The model knows their change δ with
information J, that of the recordings alone. Two changes are reported of each link:

- About its joint's axis: the first moment of all that turns with the joint, averaged over full turns of the joints
  behind it. Gravity shows this combination, M = W π with W in the row space of B, so it needs no prior.
- The link's own mass and first moment. These are no base parameters: how a change is divided among links depends on
  their prior variances. Each link's standard deviation σ_k is the URDF's usual one unless the log evidence

      log p(y | σ) = ½ hᵀ (J + C⁻¹)⁻¹ h − ½ log|I + C J|,    C = B S(σ) Bᵀ,  h = J δ,

supports a larger one (automatic relevance determination, one link after the other). A parameter whose prior variance
the recordings reduce by less than half is left out: it is the URDF's.

Often several links could carry the same change. The evidence for a link is that it or one of those is off by more than
usual, for that is what the recordings know; the evidence for it against each of those is reported beside.

A link is beyond tolerance if the interval of one of its own parameters lies wholly beyond three standard deviations of
a usual URDF; or, where its own are not determined and its σ_k is larger than usual, if that about its axis does.

Source: MacKay 1992 and Tipping 2001 (relevance determination); Gautier 1991 (base parameters).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
# Parameter names of a link's changes.
MASS = "mass_change_kg"
MOMENT = "moment_change_{}_kgm"
ABOUT = "about_axis_kgm"
# Links that together could take one's place, by index, with the log evidence for that one against them [nats].
Places = tuple[tuple[frozenset[int], float], ...]


@dataclass(frozen=True, eq=False)
class TunedLink:
    """Change of a link's inertia from the URDF."""

    joint: str  # the joint that moves it
    mass: Interval | None  # change of its mass [kg]; None where it is not determined
    moment: Mapping[str, Interval]  # change of its first moment in its joint's frame, by determined axis [kg m]
    # Change of the first moment of all that turns with the joint, about its axis, along that of the URDF [kg m]; None
    # where gravity does not determine it.
    about_axis: Interval | None
    urdf_moment: float  # that moment by the URDF [kg m]; 0 where it is below the URDF's usual error
    beyond: frozenset[str]  # names, as in `changes`, of the changes that exceed the URDF's tolerance
    # Log Bayes factor that it, or a link that could take its place, is off by more than usual [nats]; 0 where nothing
    # of it is beyond.
    evidence: float = 0.0
    against: Places = ()  # links that could take its place

    @property
    def beyond_tolerance(self) -> bool:
        """Whether any change exceeds the URDF's tolerance."""
        return bool(self.beyond)

    @property
    def share(self) -> Interval | None:
        """Change about the axis as a share of the URDF's moment."""
        if self.about_axis is None or self.urdf_moment == 0.0:
            return None
        return Interval(*(getattr(self.about_axis, end) / self.urdf_moment for end in ("value", "low", "high")))

    def to_dict(self) -> dict[str, Any]:
        """Its record, without undetermined parameters."""
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
        """All determined changes by parameter name."""
        accepted = {MASS: self.mass, ABOUT: self.about_axis}
        moments = {MOMENT.format(axis): one for axis, one in self.moment.items()}
        return {name: one for name, one in accepted.items() if one is not None} | moments

    def words(self, link: str) -> str:
        """The link's error as a sentence."""
        parts = []
        if ABOUT in self.beyond and self.about_axis is not None:
            moved = self.about_axis.words("kg m") if self.share is None else self.share.words("%", 100.0)
            parts.append(f"the moment about its axis by {moved}")
        if MASS in self.beyond and self.mass is not None:
            parts.append(f"its mass by {self.mass.words('kg')}")
        along = [(axis, one) for axis, one in self.moment.items() if MOMENT.format(axis) in self.beyond]
        parts += [f"its moment along {axis} by {one.words('kg m')}" for axis, one in along]
        how = f"tuning moved {' and '.join(parts)}"
        return f"{link} is off by more than URDFs are: {how}; correct its <inertial>, or the gain of {self.joint}"


def measure_tuned_links(
    baseline: Baseline, evidence: Evidence, projection: Projection, prior: Prior, inflation: float
) -> dict[str, TunedLink]:
    """Change of every link, by link name.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence: Scale and layout of the columns.
        projection: The solved model with the accepted effects.
        prior: Prior of the inertias that it was solved with.
        inflation: Variance inflation.
    """
    arm = baseline.nominal
    mapping = baseline.base.mapping
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
    # A prior so wide that it does not matter where the recordings determine a parameter.
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
        log_evidence, against = relevance.compare_places(factors, k) if wrong else (0.0, ())
        found[link] = TunedLink(arm.joint_names[k], mass, moment, about, urdf, frozenset(wrong), log_evidence, against)
    return found


def _of_recordings(
    evidence: Evidence, projection: Projection, prior: Prior, inflation: float
) -> tuple[Float[Array, "r r"], Float[Array, " r"]]:
    """Information and score of the recordings alone about the base parameters, other columns profiled out."""
    rank = evidence.layout.rank
    scale = evidence.scale[:rank]
    whole = np.linalg.inv(projection.spread[:rank, :rank])
    values, vectors = np.linalg.eigh(whole - prior.base)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    score = whole @ projection.estimate[:rank]
    return information * np.outer(scale, scale) / inflation, score * scale / inflation


@dataclass(frozen=True, eq=False)
class _Relevance:
    """Automatic relevance determination: for each link a factor on the usual standard deviation of its inertia."""

    baseline: Baseline  # the arm, and the usual standard deviations
    information: Float[Array, "r r"]  # of the recordings about the base parameters
    score: Float[Array, " r"]  # gradient of the log likelihood at the URDF's base parameters

    def std(self, factors: Sequence[float]) -> Float[Array, " 10n"]:
        """Prior standard deviation of every link's inertial parameters, given the factors."""
        return np.asarray(np.repeat(factors, 10) * self.baseline.number_std)

    def best(self, start: Sequence[float] = (), excluded: Collection[int] = ()) -> tuple[float, ...]:
        """Factors of greatest log evidence by coordinate ascent from `start` (or ones); `excluded` links stay as is."""
        factors = tuple(start) or (1.0,) * self.baseline.nominal.n
        reached = self._log_evidence(factors)
        for _ in range(2 * len(factors)):
            tried = [
                (*factors[:k], factor, *factors[k + 1 :])
                for k in range(len(factors))
                for factor in (1.0, *LIMIT.factors)
                if k not in excluded and factor != factors[k]
            ]
            found = [self._log_evidence(one) for one in tried]
            if max(found, default=-np.inf) <= reached:
                break
            reached = max(found)
            factors = tried[int(np.argmax(found))]
        return factors

    def compare_places(self, factors: tuple[float, ...], link: int) -> tuple[float, Places]:
        """Log Bayes factor that a link, or some that could take its place, are off by more than usual; against those.

        Some take its place if their factors are larger where the link's is one. The other links' factors are maximised
        in all cases.
        """
        if factors[link] == 1.0:
            return 0.0, ()
        right = {link}
        against = list[tuple[frozenset[int], float]]()
        reached = self._log_evidence(factors)
        while True:
            without = self.best([1.0 if k in right else one for k, one in enumerate(factors)], right)
            lost = reached - self._log_evidence(without)
            others = frozenset(k for k, one in enumerate(without) if one > factors[k])
            if not others:
                return lost, tuple(against)
            against.append((others, lost))
            right |= others

    def _log_evidence(self, factors: tuple[float, ...]) -> float:
        """Log evidence of some factors, with a prior cost for each that is not one [nats]."""
        mapping = self.baseline.base.mapping
        std = self.std(factors)
        root = np.linalg.cholesky((mapping * std**2) @ mapping.T)
        half = np.linalg.cholesky(np.eye(len(root)) + root.T @ self.information @ root)
        along = solve_triangular(half, root.T @ self.score, lower=True)
        cost = (LIMIT.least_nats + np.log(len(factors))) * sum(factor != 1.0 for factor in factors)
        return float(0.5 * along @ along - np.log(np.diag(half)).sum() - cost)


def turning_moment(arm: ArmModel, joint: int) -> Float[Array, "3 10n"]:
    """Matrix that maps all inertial parameters to the first moment of all that turns with a joint [kg m].

    The moment is in the joint's frame and averaged over full turns of the revolute joints behind it, by which only the
    components along their axes remain.
    """
    mass = np.zeros((1, 10 * arm.n))
    moment = np.zeros((3, 10 * arm.n))
    for k in reversed(range(joint, arm.n)):
        mass[0, 10 * k] = 1.0
        moment[:, 10 * k + 1 : 10 * k + 4] = moment[:, 10 * k + 1 : 10 * k + 4] + np.eye(3)
        if k == joint:
            return moment
        axis = arm.joint_axes[k]
        place = arm.model.jointPlacements[k + 1]
        kept = moment if arm.sliding_joints[k] else np.outer(axis, axis) @ moment
        moment = place.rotation @ kept + np.outer(place.translation, mass)
    return moment


def _about_axis(
    baseline: Baseline, joint: int, covariance: Float[Array, "r r"], change: Float[Array, " r"]
) -> tuple[Interval | None, float, float]:
    """The moment about a joint's axis, along the URDF's own: its change, the URDF's value and usual error."""
    arm = baseline.nominal
    mapping = baseline.base.mapping
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
    """Normal interval at 95 %."""
    return Interval(float(value), float(value - NORMAL_95 * std), float(value + NORMAL_95 * std))


def _is_beyond(change: Interval, usual: float) -> bool:
    """Whether an interval lies wholly beyond the URDF's tolerance, on either side."""
    return max(change.low, -change.high) > LIMIT.beyond * usual
