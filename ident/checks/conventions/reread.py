"""A session as a hypothesis reads it, and what the user is told to write."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.checks.arrangement import GRAVITY, find_direction, pulls_of
from ident.checks.conventions.closely import Scored
from ident.checks.conventions.description import MASSES, SEARCH
from ident.checks.conventions.find import (
    Conventions,
    find_conventions,
    likelier_mount,
    what_is_sure,
)
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, UNITS, ZEROS, Hypothesis
from ident.checks.conventions.words import columns_in_words, guess_in_words, in_words
from ident.checks.effort import collect_states, fit_signed
from ident.checks.filtered_run import USUAL_EFFORT, EffortSettings, compare_velocities
from ident.checks.ratings import tell_whole
from ident.checks.report import WORDS, issue_of
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

# How far gravity's direction, followed to where it is likeliest, may lie from where the search
# found it [degrees].
FOLLOWED_DEG = 25.0
PLACES = ("position", "position_command")
RATES = ("velocity", "acceleration", "velocity_command")
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
TORQUES = ("effort", "effort_command", "current")


def reread(session: Session, hypothesis: Hypothesis) -> Session:
    """The session in the URDF's order, directions, zeros and units.

    Its torques have the URDF's signs.
    """
    order, efforts = list(hypothesis.order), list(hypothesis.effort_order)
    direction = np.array(hypothesis.direction, dtype=float) * np.array(hypothesis.gear)
    unit = np.array([UNITS.get(name, 1.0) for name in hypothesis.unit])
    rate = unit if _velocities_alike(session) else np.ones_like(unit)
    zero = np.array(ZEROS)[list(hypothesis.quarters)]
    sign = np.array(hypothesis.direction) * np.array(hypothesis.effort_sign)

    def changed(run: Recording) -> Recording:
        channels = run.channels()
        found = {name: values[:, order] for name, values in channels.items() if name not in TORQUES}
        found.update(
            {name: direction * unit * found[name] + zero for name in PLACES if name in found}
        )
        found.update({name: direction * rate * found[name] for name in RATES if name in found})
        angles = [name for name in (*PLACES, *RATES) if name in found]
        found.update({name: hypothesis.with_shares(found[name]) for name in angles})
        found.update(
            {name: sign * channels[name][:, efforts] for name in TORQUES if name in channels}
        )
        return run.replace(**found)

    return session.replace(runs=[changed(run) for run in session.runs])


def _velocities_alike(session: Session) -> bool:
    """Whether velocities are in the positions' unit, or none are measured."""
    found = compare_velocities(session)
    return found is None or not found[0].any() or float(np.median(found[1][found[0]])) > 0.1


def corrected_arm(arm: ArmModel, hypothesis: Hypothesis) -> ArmModel:
    """The arm with the masses, guessed links or body at its end that a hypothesis asks for.

    The same object where it asks for none.
    """
    if hypothesis.parameters is not None:
        return arm.with_inertial_parameters(np.array(hypothesis.parameters))
    parameters = np.array(arm.inertial_parameters) * hypothesis.mass_factor
    if hypothesis.body is not None:
        parameters[-10:-6] += np.array(hypothesis.body)
    unchanged = hypothesis.mass_factor == 1.0 and hypothesis.body is None
    return arm if unchanged else arm.with_inertial_parameters(parameters)


def describe(hypothesis: Hypothesis, joints: tuple[str, ...]) -> dict[str, Any]:
    """A hypothesis for JSON: only what it changes.

    Args:
        hypothesis: The reading.
        joints: Names of the joints.

    Returns:
        By convention; a reading that changes nothing gives an empty dict.
    """
    own = tuple(range(len(joints)))
    found: dict[str, Any] = {}
    if hypothesis.order != own:
        found["order"] = {joints[j]: joints[k] for j, k in enumerate(hypothesis.order) if j != k}
    moved = [(j, k) for j, k in enumerate(hypothesis.effort_order) if k != hypothesis.order[j]]
    if moved:
        found["effort_order"] = {joints[j]: joints[k] for j, k in moved}
    found["direction"] = {joints[j]: -1 for j, sign in enumerate(hypothesis.direction) if sign < 0}
    found["zero_rad"] = {
        joints[j]: round(ZEROS[k], 4) for j, k in enumerate(hypothesis.quarters) if k
    }
    found["unit"] = {joints[j]: unit for j, unit in enumerate(hypothesis.unit) if unit}
    gears = enumerate(hypothesis.gear)
    found["angle_factor"] = {joints[j]: factor for j, factor in gears if factor != 1.0}
    shares = enumerate(hypothesis.share)
    found["share_of_joint_before"] = {joints[j]: share for j, share in shares if share}
    found["effort_sign"] = {
        joints[j]: -1 for j, sign in enumerate(hypothesis.effort_sign) if sign < 0
    }
    if hypothesis.gravity == COMPENSATED:
        found["effort_kind"] = "gravity_compensated"
    elif hypothesis.gravity != AS_STATED:
        found["gravity_mps2"] = [round(float(value), 2) + 0.0 for value in hypothesis.gravity]
    if hypothesis.mass_factor != 1.0:
        found["mass_factor"] = float(f"{hypothesis.mass_factor:.3g}")
    if hypothesis.effort_scale:
        found["effort_scale"] = {
            joints[j]: float(f"{scale:.3g}") for j, scale in hypothesis.effort_scale
        }
    if hypothesis.body is not None:
        mass, *moment = hypothesis.body
        found["body"] = {
            "mass_kg": round(mass, 3),
            "moment_kgm": [round(value, 4) for value in moment],
        }
    if hypothesis.parameters is not None:
        found["masses"] = "guessed"
    return {name: value for name, value in found.items() if value != {}}


def tell(found: Conventions, session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """One issue a kind of change.

    Each has what the best two readings explain, and the line to write.
    """
    best, joints = found.best.hypothesis, session.joints
    compared = "; ".join(in_words(other, joints) for other in rivals(found))
    seen: dict[str, Any] = {"explains": f"{100.0 * found.best.explains:.1f} %", "others": compared}
    known = describe(best, joints)
    issues = []
    for kind, key in (
        ("direction", "axis"),
        ("zero_rad", "zero"),
        ("unit", "joint_unit"),
        ("effort_sign", "sign"),
    ):
        if kind in known:
            names = ", ".join(known[kind])
            places = "every joint" if len(known[kind]) == len(joints) > 1 else names
            line = toml_line(kind, known[kind])
            words = seen | {"names": names, "places": places, "line": line}
            issues.append(issue_of(key, session, known[kind], **words))
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
        factor = best.mass_factor
        low, high = WORDS["usual_mass_factor"]
        severity: Severity = "warning" if low < factor < high else "fatal"
        weight = float(arm.inertial_parameters[::10].sum())
        shown = {"weight": _three_digits(weight), "right": _three_digits(factor * weight)}
        figures = seen | shown | {"factor": factor, "counts": tell_whole(session)}
        key = "mass_factor" if weighs_better(arm, factor) else "common_unit"
        issues.append(issue_of(key, session, joints, severity=severity, **figures))
    if "masses" in known:
        plain = f"{100.0 * found.as_it_is.explains:.1f} %"
        issues.append(issue_of("guessed_masses", session, joints, plain=plain, **seen))
    if best.body is not None:
        issues.append(_body_issue(np.array(best.body), session, arm, seen))
    if found.second is not None and found.has_doubtful_change:
        both = "; or ".join(_with_lines(reading, joints) for reading in (found.best, found.second))
        issues.append(issue_of("untold", session, joints, both=both))
    return issues


def _three_digits(value: float) -> float:
    """A number to three digits."""
    return float(f"{value:.3g}")


def _with_lines(scored: Scored, joints: tuple[str, ...]) -> str:
    """A reading in words, and what of it can be written at the top of session.toml."""
    known = describe(scored.hypothesis, joints)
    lines = [f"`{toml_line(key, known[key])}`" for key in STATED if key in known]
    return ": ".join([in_words(scored, joints), *([" and ".join(lines)] if lines else [])])


def _body_issue(
    body: Float[Array, " 4"], session: Session, arm: ArmModel, seen: dict[str, Any]
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
    figures: dict[str, Any] = {
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


def _angle_issues(
    known: dict[str, Any], session: Session, seen: dict[str, Any]
) -> list[TelemetryIssue]:
    """Angles that are counted elsewhere than between a joint's two links."""
    joints = list(session.joints)
    issues = []
    for name, factor in known.get("angle_factor", {}).items():
        figures: dict[str, Any] = {"factor": factor, "reported": 1.0 / factor}
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
    steps = [
        float(np.linalg.norm(placement.translation))
        for placement in list(arm.model.jointPlacements)[2:]
    ]
    last = arm.inertial_parameters[-10:-6]
    reach = sum(steps) + float(np.linalg.norm(last[1:])) / max(float(last[0]), 1e-9)
    usual = MASSES.usual_density * max(reach, 1e-3) ** 3
    weight = float(arm.inertial_parameters[::10].sum())
    return bool(abs(np.log(factor * weight / usual)) < abs(np.log(weight / usual)))


def rivals(found: Conventions) -> list[Scored]:
    """Readings to compare the best with: the second best, and log and URDF as they say.

    The latter only where the second, if there is one, changes anything itself.
    """
    second = [] if found.second is None else [found.second]
    return second + [found.as_it_is] * all(each.hypothesis.changes for each in second)


def _mount(
    gravity: list[float], session: Session, arm: ArmModel, seen: dict[str, Any]
) -> TelemetryIssue:
    """That the base is mounted otherwise: by which turn, and gravity's line."""
    now = np.array(arm.model.gravity.linear)
    best = np.array(gravity) / np.linalg.norm(gravity)
    now = now / np.linalg.norm(now)
    angle = float(np.degrees(np.arccos(np.clip(best @ now, -1.0, 1.0))))
    axis = np.cross(best, now)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-6 else np.eye(3)[0]
    named = [
        name
        for name, part in zip(("x", "y", "z", "-x", "-y", "-z"), (*axis, *-axis), strict=True)
        if part > 0.99
    ]
    words = named[0] if named else f"({', '.join(f'{part:.2f}' for part in axis)})"
    line = toml_line("gravity_mps2", [round(value, 2) for value in gravity])
    key = "mounted" if session.gravity is None else "mounted_otherwise"
    # A few degrees are used, a mount is proposed.
    severity: Severity = "fatal" if key == "mounted" and angle > SEARCH.nearest_deg else "warning"
    return issue_of(key, session, severity=severity, turn=angle, axis=words, line=line, **seen)


@dataclass(frozen=True, eq=False)
class Reading:
    """A session as its conventions are found to be."""

    session: Session
    arm: ArmModel  # the URDF's, as it is mounted
    # The same with the masses that the torques ask for: what later checks hold them against.
    judged: ArmModel
    issues: list[TelemetryIssue]
    is_compensated: bool  # whether gravity is not in the effort
    conventions: tuple[dict[str, Any], ...]  # for JSON, the best two
    guessed: str = ""  # what `judged` has beside the URDF, in words


def as_it_is(session: Session, arm: ArmModel) -> Reading:
    """A session read as it says: no changes, no issues."""
    return Reading(session, arm, arm, [], False, ())


def read_conventions(
    session: Session, arm: ArmModel, settings: EffortSettings = USUAL_EFFORT
) -> Reading:
    """Searches a session's conventions, tells what they are, and reads it so.

    Gravity that session.toml states stands; so does what it says of the effort.
    """
    stated_kind = session.effort_kind is not None
    found = find_conventions(session, arm) if session.effort_kind != "gravity_compensated" else None
    if found is None:
        return as_it_is(session, arm)
    kept = tuple(each for each in (found.best, found.second) if each is not None)
    record = tuple(
        {"hypothesis": describe(s.hypothesis, session.joints), "explains": s.explains} for s in kept
    )
    found = what_is_used(found, session, arm, settings.sign_explains)
    if found is None:
        return Reading(session, arm, arm, [], False, record)
    hypothesis = found.best.hypothesis
    reread_session = reread(session, hypothesis)
    turned = arm
    if not isinstance(hypothesis.gravity, str) and session.gravity is None:
        gravity = followed_gravity(reread_session, arm, np.array(hypothesis.gravity))
        if is_tilt(gravity, arm) and not is_misread(reread_session, arm):
            hypothesis = replace(hypothesis, gravity=AS_STATED)
        else:
            x, y, z = (float(value) for value in gravity)
            turned, reread_session = (
                arm.with_gravity(gravity),
                reread_session.replace(gravity=(x, y, z)),
            )
            hypothesis = replace(hypothesis, gravity=(x, y, z))
        found = replace(found, best=replace(found.best, hypothesis=hypothesis))
    issues = tell(found, session, arm)
    compensated = hypothesis.gravity == COMPENSATED and not stated_kind
    judged = corrected_arm(turned, hypothesis)
    guessed = guess_in_words(hypothesis)
    return Reading(reread_session, turned, judged, issues, compensated, record, guessed)


def what_is_used(
    found: Conventions, session: Session, arm: ArmModel, least: float
) -> Conventions | None:
    """What is sure, else a mount that spares a torque.

    None where log and URDF are read as they say.
    """
    sure = what_is_sure(found, least)
    if sure is not None:
        return sure
    mount = likelier_mount(found, least)
    if mount is None or not is_spared(mount, session, arm):
        return None
    return mount


def is_spared(mount: Conventions, session: Session, arm: ArmModel) -> bool:
    """Whether a joint would be refused as the URDF's base stands, and none is under a mount.

    One of the two is wrong: the joint's torque or the mount. The search has compared them.
    """
    if session.gravity is not None or not is_misread(session, arm):
        return False
    gravity = np.array(mount.best.hypothesis.gravity, dtype=float)
    turned = arm.with_gravity(followed_gravity(session, arm, gravity))
    return not is_misread(session, turned)


def is_tilt(gravity: Float[Array, " 3"], arm: ArmModel) -> bool:
    """Whether gravity lies so near to where the URDF has it that it is for a diagnosis to find."""
    stated = np.array(arm.model.gravity.linear)
    cosine = gravity @ stated / np.linalg.norm(gravity) / np.linalg.norm(stated)
    return bool(cosine > np.cos(np.radians(SEARCH.nearest_deg)))


def is_misread(session: Session, arm: ArmModel) -> bool:
    """Whether a joint that carries much follows gravity at no size of a torque.

    It would be refused.
    """
    states = collect_states(session, arm)
    if states is None:
        return False
    low, high = states.settings.scale_low, states.settings.scale_high
    joints = map(int, np.flatnonzero(states.heavy & states.alive & states.moving))
    sizes = [max(fit_signed(states, j, sign) for sign in (1.0, -1.0)).gravity for j in joints]
    return any(not low < size < high for size in sizes)


def followed_gravity(
    session: Session, arm: ArmModel, found: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """Gravity's direction [m/s²] where all joints' torque is likeliest.

    Followed from where the search found it.
    """
    states = collect_states(session, arm)
    pulls = {} if states is None else pulls_of(states, arm)
    if not pulls:
        return found
    best = find_direction(list(pulls.values()))
    near = best @ found > np.cos(np.radians(FOLLOWED_DEG)) * np.linalg.norm(found)
    return np.asarray(GRAVITY * best if near else found)
