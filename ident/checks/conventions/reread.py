"""A session as a hypothesis reads it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.checks.arrangement import GRAVITY, find_direction, pulls_of
from ident.checks.conventions.closely import Scored
from ident.checks.conventions.find import (
    Conventions,
    find_conventions,
    likelier_mount,
    what_is_sure,
)
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, UNITS, ZEROS, Hypothesis
from ident.checks.conventions.settings import SEARCH
from ident.checks.conventions.told import describe, tell
from ident.checks.conventions.words import guess_in_words
from ident.checks.effort import collect_states, fit_signed
from ident.checks.filtered_run import compare_velocities
from ident.checks.settings import USUAL_EFFORT, EffortSettings
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.records import JsonRecord
from ident.robot.arm import ArmModel

# How far gravity's direction, followed to where it is likeliest, may lie from where the search
# found it [degrees].
FOLLOWED_DEG = 25.0
PLACES = ("position", "position_command")
RATES = ("velocity", "acceleration", "velocity_command")
TORQUES = ("effort", "effort_command", "current")


def reread(session: Session, hypothesis: Hypothesis) -> Session:
    """The session in the URDF's order, directions, zeros and units.

    Its torques have the URDF's signs.
    """
    order = list(hypothesis.order)
    efforts = list(hypothesis.effort_order)
    turns = np.array(hypothesis.direction, dtype=float)
    direction = turns * np.array(hypothesis.gear)
    unit = np.array([UNITS.get(name, 1.0) for name in hypothesis.unit])
    rate = unit if _velocities_alike(session) else np.ones_like(unit)
    zero = np.array(ZEROS)[list(hypothesis.quarters)]
    sign = np.array(hypothesis.direction) * np.array(hypothesis.effort_sign)

    def changed(run: Recording) -> Recording:
        channels = {}
        for name, values in run.channels().items():
            if name in TORQUES:
                channels[name] = sign * values[:, efforts]
                continue
            in_order = values[:, order]
            if name in PLACES:
                in_order = hypothesis.with_shares(direction * unit * in_order + zero)
            elif name in RATES:
                in_order = hypothesis.with_shares(direction * rate * in_order)
            channels[name] = in_order
        return run.replace(**channels)

    return session.replace(runs=[changed(run) for run in session.runs])


def _velocities_alike(session: Session) -> bool:
    """Whether velocities are in the positions' unit, or none are measured."""
    compared = compare_velocities(session)
    if compared is None:
        return True
    is_moving, slope, _ = compared
    if not is_moving.any():
        return True
    return float(np.median(slope[is_moving])) > 0.1


def corrected_arm(arm: ArmModel, hypothesis: Hypothesis) -> ArmModel:
    """The arm with the masses, guessed links or body at its end that a hypothesis asks for.

    The same object where it asks for none.
    """
    if hypothesis.parameters is not None:
        return arm.with_inertial_parameters(np.array(hypothesis.parameters))
    if hypothesis.mass_factor == 1.0 and hypothesis.body is None:
        return arm
    parameters = np.array(arm.inertial_parameters) * hypothesis.mass_factor
    if hypothesis.body is not None:
        parameters[-10:-6] += np.array(hypothesis.body)
    return arm.with_inertial_parameters(parameters)


@dataclass(frozen=True, eq=False)
class Reading:
    """A session as its conventions are found to be."""

    session: Session
    arm: ArmModel  # the URDF's, as it is mounted
    # The same with the masses that the torques ask for: what later checks hold them against.
    judged: ArmModel
    issues: list[TelemetryIssue]
    is_compensated: bool  # whether gravity is not in the effort
    conventions: tuple[JsonRecord, ...]  # for JSON, the best two
    guessed: str = ""  # what `judged` has beside the URDF, in words


def as_it_is(session: Session, arm: ArmModel) -> Reading:
    """A session read as it says: no changes, no issues."""
    return Reading(
        session=session,
        arm=arm,
        judged=arm,
        issues=[],
        is_compensated=False,
        conventions=(),
    )


def read_conventions(
    session: Session, arm: ArmModel, settings: EffortSettings = USUAL_EFFORT
) -> Reading:
    """Searches a session's conventions, tells what they are, and reads it so.

    Gravity that session.toml states stands; so does what it says of the effort.
    """
    if session.effort_kind == "gravity_compensated":
        return as_it_is(session, arm)
    searched = find_conventions(session, arm)
    if searched is None:
        return as_it_is(session, arm)
    record = [_record_of(searched.best, session)]
    if searched.second is not None:
        record.append(_record_of(searched.second, session))
    used = what_is_used(searched, session, arm, settings.sign_explains)
    if used is None:
        return replace(as_it_is(session, arm), conventions=tuple(record))
    hypothesis = used.best.hypothesis
    reread_session = reread(session, hypothesis)
    turned = arm
    if not isinstance(hypothesis.gravity, str) and session.gravity is None:
        gravity = followed_gravity(reread_session, arm, np.array(hypothesis.gravity))
        if is_tilt(gravity, arm) and not is_misread(reread_session, arm):
            hypothesis = replace(hypothesis, gravity=AS_STATED)
        else:
            x, y, z = (float(value) for value in gravity)
            turned = arm.with_gravity(gravity)
            reread_session = reread_session.replace(gravity=(x, y, z))
            hypothesis = replace(hypothesis, gravity=(x, y, z))
        best = replace(used.best, hypothesis=hypothesis)
        used = replace(used, best=best)
    is_stated = session.effort_kind is not None
    return Reading(
        session=reread_session,
        arm=turned,
        judged=corrected_arm(turned, hypothesis),
        issues=tell(used, session, arm),
        is_compensated=hypothesis.gravity == COMPENSATED and not is_stated,
        conventions=tuple(record),
        guessed=guess_in_words(hypothesis),
    )


def _record_of(reading: Scored, session: Session) -> JsonRecord:
    """A reading for JSON."""
    return {
        "hypothesis": describe(reading.hypothesis, session.joints),
        "explains": reading.explains,
    }


def what_is_used(
    searched: Conventions, session: Session, arm: ArmModel, least: float
) -> Conventions | None:
    """What is sure, else a mount that spares a torque.

    None where log and URDF are read as they say.
    """
    sure = what_is_sure(searched, least)
    if sure is not None:
        return sure
    mount = likelier_mount(searched, least)
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
    low = states.settings.scale_low
    high = states.settings.scale_high
    judged = states.heavy & states.alive & states.moving
    for joint in np.flatnonzero(judged).tolist():
        fits = [fit_signed(states, joint, sign) for sign in (1.0, -1.0)]
        if not low < max(fits).gravity < high:
            return True
    return False


def followed_gravity(
    session: Session, arm: ArmModel, searched: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """Gravity's direction [m/s²] where all joints' torque is likeliest.

    Followed from where the search found it.
    """
    states = collect_states(session, arm)
    pulls = {} if states is None else pulls_of(states, arm)
    if not pulls:
        return searched
    best = find_direction(list(pulls.values()))
    least = np.cos(np.radians(FOLLOWED_DEG)) * np.linalg.norm(searched)
    if best @ searched <= least:
        return np.asarray(searched)
    return np.asarray(GRAVITY * best)
