"""What the URDF says of each joint and link beside what the recordings say, in every verdict.

In: the tuned baseline and the sums that it was solved from. Out: an `IdentifiedNumbers`, a figure
for each number.

A figure has the URDF's value, the value of the model as tuned beside the named effects, and two
intervals of 95 %:

- given the URDF's other numbers: its link inertias are held at their values, friction and rotors
  are free. The estimate there need not be the tuned value; the interval reaches as far as both.
- with the URDF's tolerance: link inertias are free within what a URDF is usually off by. It holds
  the first one.

A gain or an offset that no effect names is not in the tuned model. Its figure is what would be
found if it alone were free beside that model: the gain of a healthy joint is 1, its offset 0,
within their intervals.

Covariances are block sandwiches, as those of effects (`regression.run_spread`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS, TunedJoint
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.tuned_links import TunedLink
from ident.effects.base import Interval, SessionContext, impossible
from ident.effects.intervals import NORMAL_95
from ident.inference.estimate import Estimate
from ident.model.linearisation import LEAST_MOVING
from ident.records import JsonRecord
from ident.regression.baseline import Baseline
from ident.regression.design import LOSS_PARAMETERS, Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection
from ident.regression.run_spread import robust_covariance
from ident.robot.urdf_elements import COULOMB, VISCOUS, stated_friction

ARMATURE = "armature_kgm2"
OFFSET = "offset_Nm"
GAIN = "torque_gain"
# Keys of a joint's losses, in the order of the baseline's columns.
LOSS_FIGURES = dict(zip(LOSS_KEYS, (ARMATURE, VISCOUS, COULOMB), strict=True))
# The effect whose parameter a figure is, that parameter, and the figure of a joint that reads true.
READINGS = {
    OFFSET: ("torque_offset", "offset_Nm", 0.0),
    GAIN: ("torque_gain_error", "gain", 1.0),
}


@dataclass(frozen=True)
class Figure:
    """One number of the arm: what the URDF says, and what the recordings say."""

    nominal: float | None  # of the URDF; None where it says nothing
    value: float | None  # of the recordings; None where they say nothing
    given_urdf: tuple[float, float] | None = None  # 95 % interval, the URDF's other numbers given
    with_urdf: tuple[float, float] | None = None  # the same with the URDF's tolerance
    change_rms: float | None = (
        None  # torque that the difference from the URDF makes, rms while moving [N m]
    )

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            `nominal`, `value`, `low` and `high` (given the URDF), `low_with_urdf` and
            `high_with_urdf`, None where they are not known; and `change_rms_Nm` where there is one.
        """
        low, high = self.given_urdf or (None, None)
        low_with_urdf, high_with_urdf = self.with_urdf or (None, None)
        record = {
            "nominal": self.nominal,
            "value": self.value,
            "low": low,
            "high": high,
            "low_with_urdf": low_with_urdf,
            "high_with_urdf": high_with_urdf,
        }
        return record if self.change_rms is None else {**record, "change_rms_Nm": self.change_rms}


@dataclass(frozen=True)
class LinkFigures:
    """The determined numbers of one link."""

    joint: str  # the joint that moves it
    mass: Figure  # [kg]
    moment: Mapping[str, Figure]  # first moment in its joint's frame, by axis [kg m]
    beyond_tolerance: bool  # whether any differs from the URDF by more than URDFs are off

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: `joint`, `mass_kg`, `moment_kgm` by axis, and `beyond_tolerance`."""
        return {
            "joint": self.joint,
            "mass_kg": self.mass.to_dict(),
            "moment_kgm": {axis: figure.to_dict() for axis, figure in self.moment.items()},
            "beyond_tolerance": self.beyond_tolerance,
        }


@dataclass(frozen=True)
class IdentifiedNumbers:
    """All figures, joint by joint and link by link.

    Attributes:
        joints: By joint name, its figures by their keys.
        links: By link name.
        urdf_rms: Error of the URDF as a simulator loads it, `<dynamics>` included, by each joint
            that moves [N m].
        rigid_rms: Error of its rigid body alone, likewise [N m].
    """

    joints: Mapping[str, Mapping[str, Figure]]
    links: Mapping[str, LinkFigures]
    urdf_rms: Mapping[str, float]
    rigid_rms: Mapping[str, float]

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: by joint name its figures' records, and `links` by link name."""
        record: JsonRecord = {}
        for joint, figures in self.joints.items():
            record[joint] = {key: figure.to_dict() for key, figure in figures.items()}
        return {**record, "links": {name: link.to_dict() for name, link in self.links.items()}}


@dataclass(frozen=True, eq=False)
class SolvedSession:
    """What the figures are computed from.

    Attributes:
        baseline, session, evidence: The tuned model, the runs, and the sums.
        prior: What the URDF says of the base parameters, in the scale of the sums.
        tuned: The model beside the effects, the URDF's inertias free within their tolerance.
        fixed: The same with the URDF's inertias held.
        joints: The tuned model's parameters, by joint name.
        links: Change of each link by tuning, by link name.
        estimates: The named effects.
        series: Residuals of all runs, for what was counted.
        inflation: Variance inflation of the tuned model.
    """

    baseline: Baseline
    session: SessionContext
    evidence: Evidence
    prior: Prior
    tuned: Projection
    fixed: Projection
    joints: Mapping[str, TunedJoint]
    links: Mapping[str, TunedLink]
    estimates: Sequence[Estimate]
    series: Sequence[RunResidual]
    inflation: float


def identify(solved: SolvedSession) -> IdentifiedNumbers:
    """All figures of a solved session."""
    arm = solved.baseline.nominal
    losses = _loss_figures(solved)
    joints: dict[str, dict[str, Figure]] = {}
    for j, joint in enumerate(arm.joint_names):
        joints[joint] = losses[joint]
        for key in READINGS:
            joints[joint][key] = _reading_figure(solved, j, key)
    urdf, rigid = _nominal_errors(solved)
    links = {name: _link_figures(solved, k, name) for k, name in enumerate(solved.links)}
    return IdentifiedNumbers(joints, links, urdf, rigid)


def _loss_figures(solved: SolvedSession) -> dict[str, dict[str, Figure]]:
    """Rotor inertia, viscous and Coulomb friction of every joint."""
    evidence = solved.evidence
    rank = evidence.layout.rank
    stated = stated_friction(solved.baseline.nominal)
    # What the named effects take of a loss is theirs whether the inertias are held or not.
    tuned = evidence.layout.tuned
    apart = solved.fixed.estimate[:tuned] - solved.tuned.estimate[:tuned]
    shift = apart / evidence.scale[:tuned]
    std_fixed = _standard_deviations(evidence, solved.fixed)
    std_tuned = _standard_deviations(evidence, solved.tuned)
    moving = evidence.weights.sum(axis=0) >= LEAST_MOVING
    units = _torque_of_a_unit(solved.series)
    figures: dict[str, dict[str, Figure]] = {}
    for j, joint in enumerate(solved.baseline.nominal.joint_names):
        record = solved.joints[joint].to_dict()
        figures[joint] = {}
        for k, (loss, key) in enumerate(LOSS_FIGURES.items()):
            nominal = stated[joint].get(key)
            if not moving[j]:
                figures[joint][key] = Figure(nominal, None)
                continue
            column = rank + LOSS_PARAMETERS * j + k
            value = float(record[loss])
            centre = max(value + float(shift[column]), 0.0)
            given_urdf = _around(value, centre, NORMAL_95 * std_fixed[column])
            tolerant = _around(value, value, NORMAL_95 * std_tuned[column])
            figures[joint][key] = Figure(
                nominal=nominal,
                value=value,
                given_urdf=_not_negative(given_urdf),
                with_urdf=_not_negative(_hull(given_urdf, tolerant)),
                change_rms=float(abs(value - (nominal or 0.0)) * units[k][j]),
            )
    return figures


def _standard_deviations(evidence: Evidence, model: Projection) -> Float[Array, " t"]:
    """Standard deviation of each of the baseline's coefficients, in its own unit."""
    variance = np.diag(robust_covariance(evidence, model))[: evidence.layout.tuned]
    return np.sqrt(np.maximum(variance, 0.0)) / evidence.scale[: evidence.layout.tuned]


def _torque_of_a_unit(series: Sequence[RunResidual]) -> Float[Array, "3 n"]:
    """Root mean square torque that one unit of each loss makes while a joint moves."""
    squares = np.zeros((LOSS_PARAMETERS, series[0].valid.shape[1]))
    counts = np.zeros(series[0].valid.shape[1])
    for item in series:
        motion = item.run.motion
        columns = np.stack([motion.ddq, motion.dq, item.run.direction])
        seen = columns[:, motion.coarse] * item.valid
        squares += np.sum(seen**2, axis=1)
        counts += item.valid.sum(axis=0)
    return np.sqrt(squares / np.maximum(counts, 1.0))


def _reading_figure(solved: SolvedSession, joint: int, key: str) -> Figure:
    """Gain or offset of a joint's torque reading, with the torque that its error makes."""
    figure = _find_reading(solved, joint, key)
    if figure.value is None:
        return figure
    size = 1.0 if key == OFFSET else _torque_rms(solved.series, joint)
    _, _, true = READINGS[key]
    return replace(figure, change_rms=abs(figure.value - true) * size)


def _torque_rms(series: Sequence[RunResidual], joint: int) -> float:
    """Root mean square of a joint's recorded torque while it moves [N m]."""
    torque = [item.run.motion.tau_filtered[item.valid[:, joint], joint] for item in series]
    values = np.concatenate(torque)
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _find_reading(solved: SolvedSession, joint: int, key: str) -> Figure:
    """That of a named effect, else what is found of it alone."""
    effect, parameter, true = READINGS[key]
    named = _named(solved.estimates, effect, joint)
    if named is not None:
        interval = named.parameters[parameter]
        ends = (true + interval.low, true + interval.high)
        return Figure(true, true + interval.value, ends, ends)
    group = _candidate(solved.evidence, effect, joint)
    if group is None:
        return Figure(true, None)
    given = _alone(solved, solved.fixed, group, parameter)
    tolerant = _alone(solved, solved.tuned, group, parameter)
    if given is None:
        return Figure(true, None)
    ends = (true + given.low, true + given.high)
    if tolerant is None:
        return Figure(true, true + given.value, ends)
    # The first interval is moved to where the second one lies only as far as it has to hold the
    # value.
    wide = _hull(ends, (true + tolerant.low, true + tolerant.high))
    return Figure(true, true + given.value, ends, wide)


def _named(estimates: Sequence[Estimate], effect: str, joint: int) -> Estimate | None:
    """The named effect of an id at a joint."""
    for estimate in estimates:
        if estimate.group.effect.id == effect and estimate.group.joint == joint:
            return estimate
    return None


def _candidate(evidence: Evidence, effect: str, joint: int) -> Group | None:
    """The first point of an effect's grid at a joint, if it can be tested there."""
    for group in evidence.layout.groups:
        if group.effect.id == effect and group.joint == joint and not group.borrows:
            return group
    return None


def _alone(
    solved: SolvedSession, model: Projection, group: Group, parameter: str
) -> Interval | None:
    """A parameter of a candidate that alone is free beside a model.

    None where the model leaves nothing to be seen of it, or where no arm can have what is found:
    something else has the candidate's shape there, and the number would be nobody's.
    """
    seen = model.seen(group.columns)
    if not seen[0]:
        return None
    columns = group.columns[seen]
    scale = solved.evidence.scale[columns]
    scaled = model.solve(columns, np.zeros(len(columns), dtype=bool))
    spread = solved.inflation * np.linalg.pinv(model.rest(columns), hermitian=True)
    places = np.flatnonzero(seen)
    size = len(group.columns)
    coefficients = np.zeros(size)
    coefficients[places] = scaled / scale
    covariance = np.zeros((size, size))
    covariance[np.ix_(places, places)] = spread / np.outer(scale, scale)
    parameters = group.effect.parameters(
        solved.session, group.joint, group.variant, coefficients, covariance
    )
    if impossible(group.effect, solved.session, group.joint, parameters) is not None:
        return None
    return parameters[parameter]


def _nominal_errors(solved: SolvedSession) -> tuple[dict[str, float], dict[str, float]]:
    """Error of the URDF as a simulator loads it, and of its rigid body alone, by joint [N m]."""
    arm = solved.baseline.nominal
    stated = stated_friction(arm)
    damping = np.array([stated[joint].get(VISCOUS, 0.0) for joint in arm.joint_names])
    friction = np.array([stated[joint].get(COULOMB, 0.0) for joint in arm.joint_names])
    squares = np.zeros((2, arm.n))
    counts = np.zeros(arm.n)
    for item in solved.series:
        motion = item.run.motion
        carrying = arm.with_payload(motion.payload)
        rigid = carrying.inverse_dynamics(motion.q, motion.dq, motion.ddq)
        loaded = rigid + damping * motion.dq + friction * item.run.direction
        for k, torque in enumerate((loaded, rigid)):
            left = (motion.tau_filtered - motion.filtered(torque)) * item.valid
            squares[k] += np.sum(left**2, axis=0)
        counts += item.valid.sum(axis=0)
    errors = np.sqrt(squares / np.maximum(counts, 1.0))
    urdf: dict[str, float] = {}
    rigid_alone: dict[str, float] = {}
    for j in np.flatnonzero(counts > 0):
        urdf[arm.joint_names[j]] = float(errors[0, j])
        rigid_alone[arm.joint_names[j]] = float(errors[1, j])
    return urdf, rigid_alone


def _link_figures(solved: SolvedSession, index: int, name: str) -> LinkFigures:
    """Mass and first moments of a link, as far as they are determined."""
    link = solved.links[name]
    first = 10 * index
    nominal = solved.baseline.nominal.inertial_parameters[first : first + 10]
    given_others = _links_given_the_others(solved)
    changes: dict[str, Interval | None] = {LINK_KEYS[0]: link.mass}
    for axis in "xyz":
        changes[f"moment_{axis}_kgm"] = link.moment.get(axis)
    figures = {}
    for k, (key, change) in enumerate(changes.items()):
        stated = float(nominal[k])
        figures[key] = _link_figure(stated, change, given_others[first + k])
    moment = {axis: figures[f"moment_{axis}_kgm"] for axis in "xyz"}
    return LinkFigures(link.joint, figures[LINK_KEYS[0]], moment, link.beyond_tolerance)


def _link_figure(stated: float, change: Interval | None, alone: Interval | None) -> Figure:
    """The figure of one number of a link.

    Args:
        stated: The URDF's.
        change: Its change by tuning; None where it is not determined.
        alone: Its change if all other numbers are the URDF's.
    """
    if change is None:
        return Figure(stated, None)
    value = stated + change.value
    wide = (stated + change.low, stated + change.high)
    if alone is None:
        return Figure(stated, value, wide, wide)
    narrow = _around(value, stated + alone.value, 0.5 * (alone.high - alone.low))
    return Figure(stated, value, narrow, _hull(narrow, wide))


def _links_given_the_others(solved: SolvedSession) -> list[Interval | None]:
    """Change of each of the ten numbers of each link, if all the others are the URDF's.

    None of what acts on nothing.
    With J the recordings' information on the base parameters B π and h its score, that of one
    number π_i has the information b_iᵀ J b_i and the estimate b_iᵀ h / b_iᵀ J b_i, b_i the column
    of B.
    """
    rank = solved.evidence.layout.rank
    scale = solved.evidence.scale[:rank]
    # Losses are profiled out, and what the prior knows is taken off.
    whole = np.linalg.inv(solved.tuned.spread[:rank, :rank])
    information = (whole - solved.prior.base) * np.outer(scale, scale) / solved.inflation
    score = whole @ solved.tuned.estimate[:rank] * scale / solved.inflation
    mapping = solved.baseline.base.mapping
    power = np.einsum("ri,rs,si->i", mapping, information, mapping)
    changes: list[Interval | None] = []
    for number, size in enumerate(power):
        if size <= 0.0:
            changes.append(None)
            continue
        value = float(mapping[:, number] @ score / size)
        reach = NORMAL_95 * float(size) ** -0.5
        changes.append(Interval(value, value - reach, value + reach))
    return changes


def _around(value: float, centre: float, reach: float) -> tuple[float, float]:
    """An interval about a centre that reaches as far as the value."""
    return min(value, centre - reach), max(value, centre + reach)


def _hull(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """The least interval that holds both."""
    return min(first[0], second[0]), max(first[1], second[1])


def _not_negative(ends: tuple[float, float]) -> tuple[float, float]:
    """An interval of what can't be negative."""
    return max(ends[0], 0.0), max(ends[1], 0.0)
