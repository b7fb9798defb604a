"""What the user is told of a log's conventions: a record, and an issue with the line to write."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.closely import Scored
from ident.checks.conventions.find import Conventions
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, ZEROS, Hypothesis
from ident.checks.conventions.settings import MASSES, SEARCH
from ident.checks.conventions.words import columns_in_words, in_words
from ident.checks.ratings import tell_whole
from ident.checks.report import WORDS, issue_of
from ident.checks.settings import USUAL_EFFORT
from ident.recordings.recording import Session, Severity, TelemetryIssue
from ident.recordings.session_toml import effort_unit_near
from ident.records import JsonRecord
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

# What session.toml may say of conventions, by its keys.
STATED = (
    "order",
    "effort_order",
    "direction",
    "zero_rad",
    "unit",
    "effort_sign",
    "effort_kind",
    "gravity_mps2",
)
# Issues of single joints, by what is read otherwise of them.
ISSUES_OF_JOINTS = {
    "direction": "axis",
    "zero_rad": "zero",
    "unit": "joint_unit",
    "effort_sign": "sign",
}


def describe(hypothesis: Hypothesis, joints: tuple[str, ...]) -> JsonRecord:
    """A hypothesis for JSON: only what it changes.

    Args:
        hypothesis: The reading.
        joints: Names of the joints.

    Returns:
        By convention; a reading that changes nothing gives an empty dict.
    """
    record: JsonRecord = {
        **_columns_described(hypothesis, joints),
        **_joints_described(hypothesis, joints),
    }
    if hypothesis.gravity == COMPENSATED:
        record["effort_kind"] = "gravity_compensated"
    elif hypothesis.gravity != AS_STATED:
        record["gravity_mps2"] = [round(float(value), 2) + 0.0 for value in hypothesis.gravity]
    if hypothesis.mass_factor != 1.0:
        record["mass_factor"] = _three_digits(hypothesis.mass_factor)
    if hypothesis.effort_scale:
        scales = hypothesis.effort_scale
        record["effort_scale"] = {joints[j]: _three_digits(scale) for j, scale in scales}
    if hypothesis.body is not None:
        mass, *moment = hypothesis.body
        record["body"] = {
            "mass_kg": round(mass, 3),
            "moment_kgm": [round(value, 4) for value in moment],
        }
    if hypothesis.parameters is not None:
        record["masses"] = "guessed"
    return record


def _columns_described(
    hypothesis: Hypothesis, joints: tuple[str, ...]
) -> dict[str, dict[str, str]]:
    """Joints whose columns of position or effort stand elsewhere, each with whose place it is."""
    described: dict[str, dict[str, str]] = {}
    moved = {}
    for j, column in enumerate(hypothesis.order):
        if column != j:
            moved[joints[j]] = joints[column]
    if moved:
        described["order"] = moved
    efforts = {}
    for j, column in enumerate(hypothesis.effort_order):
        if column != hypothesis.order[j]:
            efforts[joints[j]] = joints[column]
    if efforts:
        described["effort_order"] = efforts
    return described


def _joints_described(hypothesis: Hypothesis, joints: tuple[str, ...]) -> dict[str, JsonRecord]:
    """What is read otherwise of single joints; kinds of which there is none are left out."""
    turned: JsonRecord = {}
    zeros: JsonRecord = {}
    units: JsonRecord = {}
    factors: JsonRecord = {}
    shares: JsonRecord = {}
    signs: JsonRecord = {}
    for j, joint in enumerate(joints):
        if hypothesis.direction[j] < 0:
            turned[joint] = -1
        if hypothesis.quarters[j]:
            zeros[joint] = round(ZEROS[hypothesis.quarters[j]], 4)
        if hypothesis.unit[j]:
            units[joint] = hypothesis.unit[j]
        if hypothesis.gear[j] != 1.0:
            factors[joint] = hypothesis.gear[j]
        if hypothesis.share[j]:
            shares[joint] = hypothesis.share[j]
        if hypothesis.effort_sign[j] < 0:
            signs[joint] = -1
    described = {
        "direction": turned,
        "zero_rad": zeros,
        "unit": units,
        "angle_factor": factors,
        "share_of_joint_before": shares,
        "effort_sign": signs,
    }
    return {kind: by_joint for kind, by_joint in described.items() if by_joint}


def tell(searched: Conventions, session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """One issue a kind of change.

    Each has what the best two readings explain, and the line to write.
    """
    best = searched.best.hypothesis
    joints = session.joints
    compared = "; ".join(in_words(other, joints) for other in rivals(searched))
    seen: JsonRecord = {
        "explains": _percent(searched.best),
        "others": compared,
    }
    known = describe(best, joints)
    issues = _issues_of_joints(known, session, seen)
    issues += _angle_issues(known, session, seen)
    moved = {**known.get("order", {}), **known.get("effort_order", {})}
    if moved:
        parts = "; ".join(columns_in_words(best, joints))
        given = [key for key in ("order", "effort_order") if key in known]
        lines = "` and `".join(toml_line(key, known[key]) for key in given)
        issues.append(issue_of("swapped", session, moved, parts=parts, lines=lines, **seen))
    if "gravity_mps2" in known:
        issues.append(_mount(known["gravity_mps2"], session, arm, seen))
    if "mass_factor" in known:
        issues.append(_factor_issue(best.mass_factor, session, arm, seen))
    if "masses" in known:
        plain = _percent(searched.as_it_is)
        issues.append(issue_of("guessed_masses", session, joints, plain=plain, **seen))
    if best.body is not None:
        issues.append(_body_issue(np.array(best.body), session, arm, seen))
    if searched.second is not None and searched.has_doubtful_change:
        readings = (searched.best, searched.second)
        both = "; or ".join(_with_lines(reading, joints) for reading in readings)
        issues.append(issue_of("untold", session, joints, both=both))
    return issues


def _percent(reading: Scored) -> str:
    """How much of the torque a reading explains."""
    return f"{100.0 * reading.explains:.1f} %"


def _issues_of_joints(
    known: JsonRecord, session: Session, seen: JsonRecord
) -> list[TelemetryIssue]:
    """Directions, zeros, units and signs of single joints that are not as the log says."""
    joints = session.joints
    issues = []
    for kind, key in ISSUES_OF_JOINTS.items():
        if kind not in known:
            continue
        changed = known[kind]
        names = ", ".join(changed)
        is_every = len(changed) == len(joints) > 1
        words = seen | {
            "names": names,
            "places": "every joint" if is_every else names,
            "line": toml_line(kind, changed),
        }
        issues.append(issue_of(key, session, changed, **words))
    return issues


def _factor_issue(
    factor: float, session: Session, arm: ArmModel, seen: JsonRecord
) -> TelemetryIssue:
    """That all torques are of other masses than the URDF's, or in another unit."""
    low, high = WORDS["usual_mass_factor"]
    severity: Severity = "warning" if low < factor < high else "fatal"
    weight = float(arm.inertial_parameters[::10].sum())
    figures = seen | {
        "weight": _three_digits(weight),
        "right": _three_digits(factor * weight),
        "factor": factor,
        "counts": tell_whole(session),
    }
    key = "mass_factor" if weighs_better(arm, factor) else "common_unit"
    unit = effort_unit_near([factor], USUAL_EFFORT.scale_off)
    if key == "common_unit" and unit is not None:
        key = "known_unit"
        figures["line"] = toml_line("effort_unit", unit)
    return issue_of(key, session, session.joints, severity=severity, **figures)


def _three_digits(value: float) -> float:
    """A number to three digits."""
    return float(f"{value:.3g}")


def _with_lines(scored: Scored, joints: tuple[str, ...]) -> str:
    """A reading in words, and what of it can be written at the top of session.toml."""
    known = describe(scored.hypothesis, joints)
    words = in_words(scored, joints)
    lines = [f"`{toml_line(key, known[key])}`" for key in STATED if key in known]
    if not lines:
        return words
    return f"{words}: {' and '.join(lines)}"


def _body_issue(
    body: Float[Array, " 4"], session: Session, arm: ArmModel, seen: JsonRecord
) -> TelemetryIssue:
    """That the arm carries more or less at its end than is known of, and the payload to write.

    Args:
        body: Mass [kg] and first moment [kg m] beyond the URDF and the payload that is known.
        session: The recordings.
        arm: Their robot.
        seen: What the best readings explain.
    """
    mass, *moment = (float(value) for value in body)
    # Rounded to nothing it has no sign.
    centre = ", ".join(f"{round(value / mass, 2) + 0.0:.2f}" for value in moment) if mass else ""
    payload = session.payload
    figures: JsonRecord = {
        "mass": abs(mass),
        "centre": centre,
        "link": arm.links[-1],
        "known": "the URDF has",
        "place": "at the top of session.toml",
        "or_payload": "",
    }
    whole = body
    if payload is not None:
        whole = body + payload.mass_kg * np.array([1.0, *payload.com_m])
        figures["known"] = "the URDF and [payload] of session.toml have"
        figures["place"] = "in place of [payload] of session.toml"
        figures["or_payload"] = ", or mend [payload] of session.toml"
    if mass <= 0.0:
        return issue_of("body_too_much", session, session.joints[-1:], **figures, **seen)
    com = [round(float(value), 3) + 0.0 for value in whole[1:] / whole[0]]
    table = {"mass_kg": float(f"{whole[0]:.3g}"), "com_m": com}
    line = toml_line("payload", table)
    return issue_of("body_lacks", session, session.joints[-1:], line=line, **figures, **seen)


def _angle_issues(known: JsonRecord, session: Session, seen: JsonRecord) -> list[TelemetryIssue]:
    """Angles that are counted elsewhere than between a joint's two links."""
    joints = list(session.joints)
    issues = []
    for name, factor in known.get("angle_factor", {}).items():
        figures: JsonRecord = {"factor": factor, "reported": 1.0 / factor}
        issues.append(issue_of("angle_scale", session, [name], name=name, **figures, **seen))
    for name, share in known.get("share_of_joint_before", {}).items():
        before = joints[joints.index(name) - 1]
        how = "plus" if share > 0 else "minus"
        figures = {"before": before, "how": how}
        issues.append(issue_of("angle_coupled", session, [name], name=name, **figures, **seen))
    return issues


def weighs_better(arm: ArmModel, factor: float) -> bool:
    """Whether an arm of its length weighs rather what it would with its masses multiplied.

    Else it weighs rather what its URDF says.
    """
    placements = list(arm.model.jointPlacements)[2:]
    steps = [float(np.linalg.norm(placement.translation)) for placement in placements]
    mass, *moment = arm.inertial_parameters[-10:-6]
    last = float(np.linalg.norm(moment)) / max(float(mass), 1e-9)
    reach = sum(steps) + last
    usual = MASSES.usual_density * max(reach, 1e-3) ** 3
    weight = float(arm.inertial_parameters[::10].sum())
    with_factor = abs(np.log(factor * weight / usual))
    without = abs(np.log(weight / usual))
    return bool(with_factor < without)


def rivals(searched: Conventions) -> list[Scored]:
    """Readings to compare the best with: the second best, and log and URDF as they say.

    The latter only where the second, if there is one, changes anything itself.
    """
    second = searched.second
    if second is None:
        return [searched.as_it_is]
    if second.hypothesis.changes:
        return [second, searched.as_it_is]
    return [second]


def _mount(
    gravity: list[float], session: Session, arm: ArmModel, seen: JsonRecord
) -> TelemetryIssue:
    """That the base is mounted otherwise: by which turn, and gravity's line."""
    stated = np.array(arm.model.gravity.linear)
    best = np.array(gravity) / np.linalg.norm(gravity)
    stated = stated / np.linalg.norm(stated)
    cosine = np.clip(best @ stated, -1.0, 1.0)
    angle = float(np.degrees(np.arccos(cosine)))
    axis = np.cross(best, stated)
    length = np.linalg.norm(axis)
    axis = axis / length if length > 1e-6 else np.eye(3)[0]
    line = toml_line("gravity_mps2", [round(value, 2) for value in gravity])
    key = "mounted" if session.gravity is None else "mounted_otherwise"
    # A few degrees are used, a mount is proposed.
    is_proposed = key == "mounted" and angle > SEARCH.nearest_deg
    severity: Severity = "fatal" if is_proposed else "warning"
    return issue_of(
        key,
        session,
        severity=severity,
        turn=angle,
        axis=_axis_in_words(axis),
        line=line,
        **seen,
    )


def _axis_in_words(axis: Float[Array, " 3"]) -> str:
    """An axis by its name in the base's frame, or by its numbers."""
    for name, along in zip(("x", "y", "z"), axis, strict=True):
        if along > 0.99:
            return name
        if -along > 0.99:
            return f"-{name}"
    numbers = ", ".join(f"{value:.2f}" for value in axis)
    return f"({numbers})"
