"""The size of a joint's torque as a multiple of the model's, told by gravity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float
from ident.checks.effort import TRANSITION_RAD_S, States, jackknife
from ident.checks.report import issue_of, with_reach
from ident.checks.settings import ARRANGEMENT
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

# States by which a URDF's tolerance is weighed (chosen: limit of work).
TOLERANCE_STATES = 200
# Share of its root mean square speed above which a joint slides, far from where a filter blurs its
# stops (chosen: between rest and its usual speed).
SLIDES = 0.5
# Fewest states in which it slides that tell a scale alone (chosen: three for each unknown).
LEAST_SLIDING = 24


class TorqueScale(NamedTuple):
    """A joint's torque as a multiple of the model's."""

    scale: float
    error: float  # standard
    beside_spring: float  # the scale where the joint may have a spring, too


def fit_scale(states: States, joint: int) -> TorqueScale:
    """A joint's torque as a multiple of the model's, told by gravity.

    A factor shows where the joint slides, and everywhere: of the two the one nearer to one. A joint
    that has stopped keeps a share of its friction, by the side from which it came to where it
    stands, and that goes with gravity.

    Args:
        states: Of all joints.
        joint: Which of them.
    """
    sliding = _fit_rows(states, joint, _sliding(states.dq[:, joint]))
    everywhere = fit_scale_everywhere(states, joint)
    return min((sliding, everywhere), key=_standard_errors_from_one)


def fit_scale_everywhere(states: States, joint: int) -> TorqueScale:
    """The same from all states, standing ones, too: for a column whose unit is not known yet, which
    has to follow gravity there as well.
    """
    return _fit_rows(states, joint, np.ones(len(states.dq), dtype=bool))


def _fit_rows(states: States, joint: int, rows: Bool[Array, " T"]) -> TorqueScale:
    """The scale by some states.

    Least squares beside inertia, the rotor's (no part of the model, which could bend gravity's),
    friction, friction that grows with the load, and an offset. The error is the delete-one-piece
    jackknife's, and half of what a spring makes of the scale is added.
    """
    tau = states.tau[rows, joint]
    gravity = states.gravity[rows, joint]
    dq = states.dq[rows, joint]
    side = np.tanh(dq / TRANSITION_RAD_S)
    inertia = [states.inertial[rows, joint], states.ddq[rows, joint]]
    friction = [side, dq, np.abs(gravity) * side]
    bare = np.column_stack([gravity, *inertia, *friction, np.ones(len(dq))])
    sprung = np.column_stack([bare, states.q[rows, joint]])
    weights, errors = jackknife(bare, tau, states.settings.pieces)
    weights_beside_spring, _ = jackknife(sprung, tau, states.settings.pieces)
    scale = float(weights[0])
    beside_spring = float(weights_beside_spring[0])
    error = float(np.hypot(float(errors[0]), 0.5 * (scale - beside_spring)))
    return TorqueScale(scale, error, beside_spring)


def _standard_errors_from_one(fit: TorqueScale) -> float:
    """By how many of its errors a scale is off."""
    return abs(fit.scale - 1.0) / max(fit.error, 1e-300)


def _sliding(dq: Float[Array, " T"]) -> Bool[Array, " T"]:
    """Where a joint surely slides: faster than a share of its root mean square speed.

    Everywhere, where that is hardly anywhere, as beside a single leap.
    """
    slides = np.abs(dq) > SLIDES * np.sqrt(np.mean(dq**2))
    return slides if slides.sum() >= LEAST_SLIDING else np.ones_like(slides)


class ScaleOff(NamedTuple):
    """A joint whose torque is the model's at another size."""

    joint: int
    scale: float
    error: float  # standard


def check_scales(session: Session, states: States, arm: ArmModel) -> list[TelemetryIssue]:
    """Moving joints whose whole torque is the model's at another size.

    A gain is off, or masses are. Where gravity changes much, a size is told that the recordings
    tell; where it hardly does, one that its URDF's tolerance, too, leaves no room for; where it is
    constant, none.
    """
    settings = states.settings
    tested = np.flatnonzero(states.alive & states.moving & states.varies)
    heavy_sure = _chance_for_all(int(states.heavy[tested].sum()), settings.pieces)
    sure = _chance_for_all(len(tested), settings.pieces)
    change = states.gravity.std(axis=0)
    tolerance = gravity_tolerance(states, arm)
    scales = []
    for joint in map(int, tested):
        scale, error, beside_spring = fit_scale(states, joint)
        off = abs(scale - 1.0)
        # What a spring explains for the most part is no scale.
        if abs(beside_spring - 1.0) <= 0.5 * off:
            continue
        if states.heavy[joint]:
            is_off = off > max(settings.scale_off, heavy_sure * error)
        else:
            doubt = float(np.hypot(error * change[joint], tolerance[joint]))
            is_off = off * change[joint] > sure * doubt
        if is_off:
            scales.append(ScaleOff(joint, scale, error))
    if not scales:
        return []
    scales.sort(key=lambda off: -abs(np.log(max(off.scale, 1e-9))))
    words = []
    for joint, scale, error in scales:
        interval = with_reach(scale, 2.0 * error)
        times = f"{interval} times the model's gravity torque{states.counted}"
        words.append(f"{session.joints[joint]} reads {times}")
    joints = [off.joint for off in scales]
    return [issue_of("scale", session, joints, reported="; ".join(words))]


def _chance_for_all(count: int, pieces: int) -> float:
    """Standard errors beyond which one in twenty sound arms has any of so many joints.

    Student's t, for errors of so few pieces.
    """
    return float(stdtrit(pieces - 1, 1.0 - 0.025 / max(count, 1)))


def gravity_tolerance(states: States, arm: ArmModel) -> Float[Array, " n"]:
    """What a URDF within its tolerance has otherwise of each joint's change of gravity [N m].

    A standard deviation. Its links are off by their tolerance, and its base by any tilt up to the
    one that a diagnosis finds.
    """
    q = states.q[:: max(1, len(states.q) // TOLERANCE_STATES)]
    still = np.zeros_like(q)
    spread = arm.regressor(q, still, still).var(axis=0)
    deviation = PRIOR_SHARE["consistent"] * parameter_scale(arm)
    square = (spread * deviation**2).sum(axis=-1)
    tilt = np.radians(ARRANGEMENT.least_turn_deg) / np.sqrt(3.0)  # of a uniform distribution
    size = float(np.linalg.norm(arm.model.gravity.linear))
    for axis in np.eye(3):
        square += (tilt * arm.with_gravity(size * axis).gravity(q)).var(axis=0)
    return np.asarray(np.sqrt(square))
