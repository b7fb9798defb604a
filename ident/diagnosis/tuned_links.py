"""Change of each link's inertia from the URDF by tuning, with a relevance test for each link.

In: the solved model. Out: a `TunedLink` for each link. It is always reported, for tuning leaves no
residual.

Of the inertial parameters π only the base parameters β = B π act on the torques. The model knows
their change δ with information J, that of the recordings alone. Two changes are reported of each
link:

- About its joint's axis: the first moment of all that turns with the joint, averaged over full
  turns of the joints behind it. Gravity shows this combination, M = W π with W in the row space of
  B, so it needs no prior.
- The link's own mass and first moment. These are no base parameters: how a change is divided among
  links depends on their prior variances. Each link's standard deviation σ_k is the URDF's usual one
  unless the log evidence

      log p(y | σ) = ½ hᵀ (J + C⁻¹)⁻¹ h − ½ log|I + C J|,    C = B S(σ) Bᵀ,  h = J δ,

supports a larger one (automatic relevance determination, one link after the other). A parameter
whose prior variance the recordings reduce by less than half is left out: it is the URDF's.

Often several links could carry the same change. The evidence for a link is that it or one of those
is off by more than usual, for that is what the recordings know; the evidence for it against each of
those is reported beside.

A link is beyond tolerance if the interval of one of its own parameters lies wholly beyond three
standard deviations of a usual URDF; or, where its own are not determined and its σ_k is larger than
usual, if that about its axis does.

Source: MacKay 1992 and Tipping 2001 (relevance determination); Gautier 1991 (base parameters).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from ident.arrays import Array, Bool, Float
from ident.diagnosis.settings import TUNED_LINKS as LIMIT
from ident.effects.intervals import NORMAL_95, Interval
from ident.model.inertia import base_prior
from ident.records import JsonRecord
from ident.regression.baseline import Baseline
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection
from ident.robot.arm import ArmModel

# Parameter names of a link's changes.
MASS = "mass_change_kg"
MOMENT = "moment_change_{}_kgm"
ABOUT = "about_axis_kgm"
# What is said of a link beyond tolerance, after its name.
BEYOND_URDFS = "is off by more than URDFs are"
# Links that together could take one's place, by index, with the log evidence for that one against
# them [nats].
Places = tuple[tuple[frozenset[int], float], ...]


@dataclass(frozen=True, eq=False)
class TunedLink:
    """Change of a link's inertia from the URDF.

    Attributes:
        joint: The joint that moves it.
        mass: Change of its mass [kg]; None where it is not determined.
        moment: Change of its first moment in its joint's frame, by determined axis [kg m].
        about_axis: Change of the first moment of all that turns with the joint, about its axis,
            along that of the URDF [kg m]; None where gravity does not determine it.
        urdf_moment: That moment by the URDF [kg m]; 0 where it is below the URDF's usual error.
        beyond: Names, as in `changes`, of the changes that exceed the URDF's tolerance.
        evidence: Log Bayes factor that it, or a link that could take its place, is off by more than
            usual [nats]; 0 where nothing of it is beyond.
        against: Links that could take its place.
    """

    joint: str
    mass: Interval | None
    moment: Mapping[str, Interval]
    about_axis: Interval | None
    urdf_moment: float
    beyond: frozenset[str]
    evidence: float = 0.0
    against: Places = ()

    @property
    def beyond_tolerance(self) -> bool:
        """Whether any change exceeds the URDF's tolerance."""
        return bool(self.beyond)

    @property
    def share(self) -> Interval | None:
        """Change about the axis as a share of the URDF's moment.

        None where the change is not determined, or the URDF's moment is 0.
        """
        change = self.about_axis
        whole = self.urdf_moment
        if change is None or whole == 0.0:
            return None
        return Interval(change.value / whole, change.low / whole, change.high / whole)

    def to_dict(self) -> JsonRecord:
        """Its record for JSON, without undetermined parameters.

        Returns:
            `joint`, `beyond_tolerance`, `moment_kgm` (intervals by axis), and where they are known
            `mass_kg`, `about_axis_kgm` and `about_axis_share`.
        """
        record: JsonRecord = {"joint": self.joint, "beyond_tolerance": self.beyond_tolerance}
        if self.mass is not None:
            record["mass_kg"] = self.mass.to_dict()
        record["moment_kgm"] = {axis: change.to_dict() for axis, change in self.moment.items()}
        if self.about_axis is not None:
            record["about_axis_kgm"] = self.about_axis.to_dict()
        if self.share is not None:
            record["about_axis_share"] = self.share.to_dict()
        return record

    def changes(self) -> dict[str, Interval]:
        """All determined changes with 95 % intervals, by parameter name; empty without any."""
        changes: dict[str, Interval] = {}
        if self.mass is not None:
            changes[MASS] = self.mass
        if self.about_axis is not None:
            changes[ABOUT] = self.about_axis
        for axis, change in self.moment.items():
            changes[MOMENT.format(axis)] = change
        return changes

    def words(self, link: str) -> str:
        """The link's error beyond the URDF's tolerance as a sentence with the remedy.

        Args:
            link: Name of the link.
        """
        moved = []
        if ABOUT in self.beyond and self.about_axis is not None:
            share = self.share
            size = self.about_axis.words("kg m") if share is None else share.words("%", 100.0)
            moved.append(f"the moment about its axis by {size}")
        if MASS in self.beyond and self.mass is not None:
            moved.append(f"its mass by {self.mass.words('kg')}")
        for axis, change in self.moment.items():
            if MOMENT.format(axis) in self.beyond:
                moved.append(f"its moment along {axis} by {change.words('kg m')}")
        off = f"{link} {BEYOND_URDFS}: tuning moved {' and '.join(moved)}"
        return f"{off}; correct its <inertial>, or the gain of {self.joint}"


@dataclass(frozen=True, eq=False)
class _TunedNumbers:
    """The links' inertial parameters by the model, ten a link.

    Attributes:
        change: Change of each parameter from the URDF, with its interval.
        known: Whether the recordings determine it.
        std: Its prior standard deviation.
    """

    change: Sequence[Interval]
    known: Bool[Array, " 10n"]
    std: Float[Array, " 10n"]


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
    information, score = _of_recordings(evidence, projection, prior, inflation)
    relevance = _Relevance(baseline, information, score)
    factors = relevance.best()
    numbers = _tuned_numbers(relevance, factors)
    # A prior so wide that it does not matter where the recordings determine a parameter.
    wide = base_prior(baseline.base, LIMIT.unknown * baseline.number_std)
    free = np.linalg.inv(information + wide)
    links: dict[str, TunedLink] = {}
    for k, link in enumerate(arm.links):
        about, urdf, usual = _about_axis(baseline, k, free, free @ score)
        # The link's mass, and its first moment along each axis.
        first = 10 * k
        mass = numbers.change[first] if numbers.known[first] else None
        moment = {}
        for place, axis in enumerate("xyz", first + 1):
            if numbers.known[place]:
                moment[axis] = numbers.change[place]
        wrong = _names_beyond(numbers, baseline.number_std, first)
        enlarged = numbers.std[first] > baseline.number_std[first]
        if about is not None and enlarged and _is_beyond(about, usual):
            wrong.add(ABOUT)
        log_evidence, against = relevance.compare_places(factors, k) if wrong else (0.0, ())
        links[link] = TunedLink(
            joint=arm.joint_names[k],
            mass=mass,
            moment=moment,
            about_axis=about,
            urdf_moment=urdf,
            beyond=frozenset(wrong),
            evidence=log_evidence,
            against=against,
        )
    return links


def _tuned_numbers(relevance: _Relevance, factors: tuple[float, ...]) -> _TunedNumbers:
    """Every inertial parameter by the model, with the prior of greatest evidence.

    With C = B S Bᵀ the prior covariance of the base parameters and L = S Bᵀ C⁻¹, the parameters are
    L δ, and their covariance S − L B S + L (J + C⁻¹)⁻¹ Lᵀ.
    """
    baseline = relevance.baseline
    mapping = baseline.base.mapping
    std = relevance.std(factors)
    prior = base_prior(baseline.base, std)
    posterior = np.linalg.inv(relevance.information + prior)
    lift = (std[:, None] ** 2 * mapping.T) @ prior
    change = lift @ (posterior @ relevance.score)
    told = np.sum(lift * (mapping * std**2).T, axis=1)
    left_open = np.sum((lift @ posterior) * lift, axis=1)
    variance = std**2 - told + left_open
    widths = np.sqrt(np.maximum(variance, 0.0))
    intervals = [_interval(value, width) for value, width in zip(change, widths, strict=True)]
    known = variance < (1.0 - LIMIT.least_share) * std**2
    return _TunedNumbers(intervals, known, std)


def _names_beyond(numbers: _TunedNumbers, usual: Float[Array, " 10n"], first: int) -> set[str]:
    """Names of a link's parameters that exceed the URDF's tolerance.

    Args:
        numbers: All links' parameters.
        usual: A URDF's usual error of each.
        first: Place of the link's mass.
    """
    names = (MASS, *(MOMENT.format(axis) for axis in "xyz"))
    beyond = set()
    for place, name in enumerate(names, first):
        if numbers.known[place] and _is_beyond(numbers.change[place], usual[place]):
            beyond.add(name)
    return beyond


def _of_recordings(
    evidence: Evidence, projection: Projection, prior: Prior, inflation: float
) -> tuple[Float[Array, "r r"], Float[Array, " r"]]:
    """Information and score of the recordings alone about the base parameters.

    Other columns are profiled out.
    """
    rank = evidence.layout.rank
    scale = evidence.scale[:rank]
    whole = np.linalg.inv(projection.spread[:rank, :rank])
    values, vectors = np.linalg.eigh(whole - prior.base)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    score = whole @ projection.estimate[:rank]
    return information * np.outer(scale, scale) / inflation, score * scale / inflation


@dataclass(frozen=True, eq=False)
class _Relevance:
    """Automatic relevance determination of links.

    For each link a factor on the usual standard deviation of its inertia.
    """

    baseline: Baseline  # the arm, and the usual standard deviations
    information: Float[Array, "r r"]  # of the recordings about the base parameters
    score: Float[Array, " r"]  # gradient of the log likelihood at the URDF's base parameters

    def std(self, factors: Sequence[float]) -> Float[Array, " 10n"]:
        """Prior standard deviation of every link's inertial parameters, given the factors."""
        return np.asarray(np.repeat(factors, 10) * self.baseline.number_std)

    def best(
        self, start: Sequence[float] = (), excluded: Collection[int] = ()
    ) -> tuple[float, ...]:
        """Factors of greatest log evidence by coordinate ascent.

        Args:
            start: Factors to begin with; ones if there are none.
            excluded: Links whose factors stay as they are.
        """
        factors = tuple(start) or (1.0,) * self.baseline.nominal.n
        reached = self._log_evidence(factors)
        for _ in range(2 * len(factors)):
            tried = self._neighbours(factors, excluded)
            values = [self._log_evidence(neighbour) for neighbour in tried]
            if max(values, default=-np.inf) <= reached:
                break
            reached = max(values)
            factors = tried[int(np.argmax(values))]
        return factors

    def _neighbours(
        self, factors: tuple[float, ...], excluded: Collection[int]
    ) -> list[tuple[float, ...]]:
        """All factors of which one differs from some, those of excluded links never."""
        neighbours = []
        for k, present in enumerate(factors):
            if k in excluded:
                continue
            others = [factor for factor in (1.0, *LIMIT.factors) if factor != present]
            neighbours += [(*factors[:k], factor, *factors[k + 1 :]) for factor in others]
        return neighbours

    def compare_places(self, factors: tuple[float, ...], link: int) -> tuple[float, Places]:
        """How much speaks for a link, or some that could take its place, being off.

        Some take its place if their factors are larger where the link's is one. The other links'
        factors are maximised in all cases.

        Returns:
            Log Bayes factor that the link or one of these is off by more than usual, and the links
            with the log evidence against each of them [nats].
        """
        if factors[link] == 1.0:
            return 0.0, ()
        right = {link}
        against = list[tuple[frozenset[int], float]]()
        reached = self._log_evidence(factors)
        while True:
            start = [1.0 if k in right else factor for k, factor in enumerate(factors)]
            without = self.best(start, right)
            lost = reached - self._log_evidence(without)
            larger = [k for k, factor in enumerate(without) if factor > factors[k]]
            if not larger:
                return lost, tuple(against)
            others = frozenset(larger)
            against.append((others, lost))
            right |= others

    def _log_evidence(self, factors: tuple[float, ...]) -> float:
        """Log evidence of some factors, with a prior cost for each that is not one [nats].

        With C = R Rᵀ and I + Rᵀ J R = H Hᵀ it is ½ |H⁻¹ Rᵀ h|² − log |H|.
        """
        mapping = self.baseline.base.mapping
        std = self.std(factors)
        root = np.linalg.cholesky((mapping * std**2) @ mapping.T)
        inner = root.T @ self.information @ root
        half = np.linalg.cholesky(np.eye(len(root)) + inner)
        along = solve_triangular(half, root.T @ self.score, lower=True)
        enlarged = sum(factor != 1.0 for factor in factors)
        cost = (LIMIT.least_nats + np.log(len(factors))) * enlarged
        log_determinant = np.log(np.diag(half)).sum()
        return float(0.5 * along @ along - log_determinant - cost)


def turning_moment(arm: ArmModel, joint: int) -> Float[Array, "3 10n"]:
    """Matrix from all inertial parameters to the first moment of all that turns with a joint.

    The moment [kg m] is in the joint's frame, and averaged over full turns of the revolute joints
    behind it, by which only the components along their axes remain.
    """
    mass = np.zeros((1, 10 * arm.n))
    moment = np.zeros((3, 10 * arm.n))
    for k in reversed(range(joint, arm.n)):
        mass[0, 10 * k] = 1.0
        first = slice(10 * k + 1, 10 * k + 4)
        moment[:, first] = moment[:, first] + np.eye(3)
        if k == joint:
            return moment
        axis = arm.joint_axes[k]
        place = arm.model.jointPlacements[k + 1]
        averaged = moment if arm.sliding_joints[k] else np.outer(axis, axis) @ moment
        moment = place.rotation @ averaged + np.outer(place.translation, mass)
    return moment


def _about_axis(
    baseline: Baseline, joint: int, covariance: Float[Array, "r r"], change: Float[Array, " r"]
) -> tuple[Interval | None, float, float]:
    """The moment about a joint's axis, along the URDF's: its change, and that of the URDF.

    Args:
        baseline, joint: The arm, and the joint.
        covariance, change: Of the base parameters.

    Returns:
        Its change, None where gravity does not determine it; the URDF's value, 0 where that is
        below its usual error; and this error [kg m].
    """
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
    error = np.linalg.norm(weights @ mapping - along)
    determined = error < 1e-6 * np.linalg.norm(along)
    std = float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
    usual = float(np.sqrt(np.sum((along * baseline.number_std) ** 2)))
    if not determined or not 0.0 < std < usual:
        return None, size, usual
    return _interval(float(weights @ change), std), size if size > usual else 0.0, usual


def _interval(value: float, std: float) -> Interval:
    """Normal interval at 95 %."""
    reach = NORMAL_95 * std
    return Interval(float(value), float(value - reach), float(value + reach))


def _is_beyond(change: Interval, usual: float) -> bool:
    """Whether an interval lies wholly beyond the URDF's tolerance, on either side."""
    return max(change.low, -change.high) > LIMIT.beyond * usual
