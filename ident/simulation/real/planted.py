"""What is planted: each effect by its own physics on a recorded motion, none by the catalogue's
columns.

An effect is a function of the arm, the joint, a size that grows with what it does, and a source of
its other numbers; `EFFECTS` says how large it may be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.simulation.causes.mechanisms import length_of, tilted, vector
from ident.simulation.real.moved_arm import MovedArm, View, model_of, rigid_torque, twist_of
from ident.simulation.real.sources import with_body

Parameters = dict[str, float | str]
Draw = np.random.Generator
# Travel over which dry friction turns round [rad].
BRISTLE = 3e-4
# Time over which a push sets in, and ends [s].
RAMP = 0.1


@dataclass(frozen=True, eq=False)
class PlantedChange:
    """What a planted effect does to a session."""

    parameters: Parameters  # what is true, by the catalogue's names and units
    torque: Float[Array, "N n"]  # added to the recorded torque [N m]
    shift: Float[Array, " n"] | float = 0.0  # added to the recorded positions [rad]
    # the URDF that is given, if that changes; then the bodies' torque is `unseen`
    urdf: str | None = None
    unseen: Array | float = 0.0  # torque that the given model lacks [N m]

    @property
    def felt(self) -> Float[Array, "N n"]:
        """Torque that a model without the effect would have to explain [N m]."""
        return self.torque + self.unseen


@dataclass(frozen=True)
class Planted:
    """An effect that can be planted."""

    change: Callable[[MovedArm, int, float, Draw], PlantedChange]  # its physics
    most: Callable[[MovedArm, int], float]  # largest size that an arm has
    view: View = "refit"  # what a refit may absorb before the rest counts as visible
    whole_arm: bool = False  # whether it is named of the arm, not of a joint
    local: bool = False  # whether it acts for a while only, and is measured then
    neighbours: bool = False  # whether another joint has a part in it


def at_joint(
    arm: MovedArm, j: int, torque: Float[Array, " N"], parameters: Parameters
) -> PlantedChange:
    """A torque added at one joint [N m], nothing at the others.

    Args:
        arm: The motion.
        j: Number of the joint.
        torque: At each row.
        parameters: What the answer says of it.
    """
    added = np.zeros_like(arm.tau)
    added[:, j] = torque
    return PlantedChange(parameters, added)


def bristle(
    arm: MovedArm, speed: Float[Array, " N"], travel: float = BRISTLE
) -> Float[Array, " N"]:
    """Sign of a speed with a memory: z' = |v| (sign v - z) / travel, from rest at the start of each
    run.
    """
    begins = ~np.isfinite(arm.steps)
    steps = np.where(begins, 0.0, arm.steps)
    keep = np.exp(-np.abs(speed) * steps / travel)
    rows = zip(keep.tolist(), np.sign(speed).tolist(), begins.tolist(), strict=True)
    deflection = np.empty(len(speed))
    z = 0.0
    for k, (stay, sign, is_begin) in enumerate(rows):
        if is_begin:
            z = 0.0
        z = sign + (z - sign) * stay
        deflection[k] = z
    return deflection


def decay(arm: MovedArm, power: Float[Array, " N"], constant: float) -> Float[Array, " N"]:
    """θ' = power - θ / constant over the session's clock, pauses included."""
    dt = np.diff(arm.t, prepend=arm.t[0])
    keep = np.exp(-dt / constant)
    heat = power * np.where(np.isfinite(arm.steps), dt, 0.0)
    warmth = np.empty(len(power))
    theta = 0.0
    for k, (stay, gained) in enumerate(zip(keep.tolist(), heat.tolist(), strict=True)):
        theta = theta * stay + gained
        warmth[k] = theta
    return warmth


# Friction


def plant_stribeck(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction that falls as motion sets in, by so much at rest [N m]."""
    speed = float(np.exp(draw.uniform(np.log(0.02), np.log(0.15))))
    exponent = float(draw.uniform(0.9, 2.0))
    v = arm.v[:, j]
    level = size * np.exp(-(np.abs(v / speed) ** exponent))
    truth: Parameters = {
        "amplitude_Nm": size,
        "stribeck_velocity_rad_s": speed,
        "exponent": exponent,
    }
    return at_joint(arm, j, level * bristle(arm, v), truth)


def plant_curved(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A power of the speed, or the lubricant's own law (Eyring), which has no such parameters."""
    v = arm.v[:, j]
    exponent = float(draw.uniform(0.3, 0.8))
    if draw.random() < 0.5:
        knee = float(draw.uniform(0.03, 0.2))
        return at_joint(arm, j, size * np.arcsinh(v / knee), {"eyring_Nm": size})
    torque = size * np.abs(v) ** exponent * bristle(arm, v)
    return at_joint(arm, j, torque, {"coefficient": size, "exponent": exponent})


def plant_load(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that grows with the load, by a share of it [1]."""
    torque = size * np.abs(arm.load[:, j]) * bristle(arm, arm.v[:, j])
    return at_joint(arm, j, torque, {"mu": size})


def plant_thermal(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction warms the gear; viscous friction falls by `size` from the coldest to the warmest
    moment.
    """
    constant = float(np.exp(draw.uniform(np.log(30.0), np.log(200.0))))
    dry = float(draw.uniform(0.1, 0.4))
    v = arm.v[:, j]
    turn = bristle(arm, v)
    friction = arm.coulomb[j] * turn + arm.viscous[j] * v
    warmth = decay(arm, np.maximum(friction * v, 0.0), constant)
    shown = np.concatenate([warmth[rows] for rows in arm.given])
    coldest = shown[0]
    span = max(float(shown.max() - coldest), 1e-9)
    share = np.clip((warmth - coldest) / span, 0.0, 1.0)
    torque = -size * share * (arm.viscous[j] * v + dry * arm.coulomb[j] * turn)
    truth: Parameters = {
        "viscous_change": -size,
        "coulomb_change": -dry * size,
        "time_constant_s": constant,
    }
    return at_joint(arm, j, torque, truth)


def plant_hysteresis(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction of a size [N m] that builds up over a travel drawn by chance."""
    travel = float(np.exp(draw.uniform(np.log(2e-3), np.log(3e-2))))
    q = arm.q[:, j]
    within_run = np.isfinite(arm.steps)
    dt = np.where(within_run, arm.steps, 1.0)
    speed = np.where(within_run, np.diff(q, prepend=q[0]), 0.0) / dt
    truth: Parameters = {"amplitude_Nm": size, "displacement_rad": travel}
    return at_joint(arm, j, size * bristle(arm, speed, travel), truth)


def plant_seat(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that waves by a size [N m] once or twice a turn."""
    order = int(draw.integers(1, 3))
    phase = float(draw.uniform(-np.pi, np.pi))
    level = size * np.cos(order * arm.q[:, j] - phase)
    truth: Parameters = {"amplitude_Nm": size, "order": order, "phase_rad": phase}
    return at_joint(arm, j, level * bristle(arm, arm.v[:, j]), truth)


def plant_asymmetric(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """More friction in one direction: `size` of viscous friction, and some dry."""
    way = float(draw.choice([-1.0, 1.0]))
    dry = float(draw.uniform(0.2, 0.6))
    v = arm.v[:, j]
    ahead = way * v > 0.0
    extra = dry * size * arm.coulomb[j] / arm.viscous[j]
    torque = np.where(ahead, size * v + extra * bristle(arm, v), 0.0)
    truth: Parameters = {
        "coulomb_difference_Nm": way * extra,
        "viscous_difference_Nms_rad": way * size,
    }
    return at_joint(arm, j, torque, truth)


def plant_coupling(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The motor is also turned by its neighbour: friction and rotor of both; drag counts by the
    neighbour's motion.
    """
    other = neighbour(arm, j, draw)
    way = float(draw.choice([-1.0, 1.0]))
    speed = arm.v[:, j] + way * arm.v[:, other]
    viscous = 0.4 * size * arm.viscous[j] / arm.coulomb[j]
    inertia = 0.002 * size
    turned = inertia * (arm.a[:, j] + way * arm.a[:, other])
    torque = size * bristle(arm, speed) + viscous * speed + turned
    truth: Parameters = {
        "coulomb_Nm": size,
        "viscous_Nms_rad": way * viscous,
        "other_joint": arm.source.joints[other],
    }
    return at_joint(arm, j, torque, truth)


def neighbour(arm: MovedArm, j: int, draw: Draw) -> int:
    """The joint before or after one, by chance."""
    beside = [k for k in (j - 1, j + 1) if 0 <= k < arm.n]
    return int(draw.choice(beside))


# Gears


def _turned(
    arm: MovedArm, j: int, states: tuple[Array, Array, Array], parameters: Parameters
) -> PlantedChange:
    """The link stands a twist behind the motor, whose encoder is read: the bodies' torque is that
    of the link.
    """
    q = arm.q.copy()
    v = arm.v.copy()
    a = arm.a.copy()
    for channel, twist in zip((q, v, a), states, strict=True):
        channel[:, j] -= twist
    return PlantedChange(parameters, rigid_torque(arm.model, q, v, a) - arm.rigid)


def plant_elasticity(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A gear that twists by so much under a torque [rad/(N m)], little damped."""
    stiffness = 1.0 / size
    ratio = float(draw.uniform(0.03, 0.15))
    states, damping = twist_of(arm, j, stiffness, ratio)
    truth: Parameters = {"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping}
    return _turned(arm, j, states, truth)


def plant_backlash(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Play of a gear beside one that only twists: that twist is no play."""
    stiffness = 400.0 * float(arm.peak[j])
    with_play, _ = twist_of(arm, j, stiffness, 0.3, size)
    without, _ = twist_of(arm, j, stiffness, 0.3, 0.0)
    loose = _turned(arm, j, with_play, {}).torque
    tight = _turned(arm, j, without, {}).torque
    return PlantedChange({"gap_rad": size}, loose - tight)


def plant_ripple(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Teeth that pass 1.5 to 5 times a second at the joint's usual speed."""
    usual = float(np.quantile(np.abs(arm.v[:, j]), 0.6)) + 1e-3
    frequency = draw.uniform(1.5, 5.0)
    order = float(np.clip(round(2.0 * np.pi * frequency / usual), 5, 160))
    phase = float(draw.uniform(-np.pi, np.pi))
    truth: Parameters = {"amplitude_Nm": size, "order": order, "phase_rad": phase}
    return at_joint(arm, j, size * np.cos(order * arm.q[:, j] - phase), truth)


def plant_spring(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A spring of a stiffness [N m/rad], at rest at an angle within the motion."""
    low, high = np.quantile(arm.q[:, j], [0.05, 0.95])
    rest = float(draw.uniform(low, high))
    truth: Parameters = {"stiffness_Nm_rad": size, "rest_rad": rest}
    return at_joint(arm, j, size * (arm.q[:, j] - rest), truth)


# Bodies, gravity, pushes


def plant_payload(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A body of a mass [kg] near the end of the last link."""
    reach = length_of(arm.model)
    com = reach * 0.06 * draw.uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 1.2])
    heavier = with_body(arm.source.urdf, arm.source.joints[-1], size, com, 0.03 * reach)
    torque = rigid_torque(model_of(heavier), arm.q, arm.v, arm.a) - arm.rigid
    return PlantedChange({"mass_kg": size, **vector("com", com, "m")}, torque)


def plant_link(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Mass that the URDF's link lacks or has too much; planted in the torque, or the other way
    round in the URDF.
    """
    body = arm.model.inertias[j + 1]
    urdf = arm.source.urdf
    joint = arm.source.joints[j]
    centre = np.array(body.lever)
    mass = size * body.mass * float(draw.choice([-1.0, 1.0]))
    place = centre * draw.uniform(0.9, 1.1)
    if mass > 0.0:
        place = centre + 0.06 * length_of(arm.model) * draw.uniform(-1.0, 1.0, 3)
    truth: Parameters = {"mass_change_kg": mass, **vector("moment_change", mass * place, "kgm")}
    if draw.random() < 0.5 and mass < 0.0:
        changed = with_body(urdf, joint, -mass, place, 0.0)
        unseen = arm.rigid - rigid_torque(model_of(changed), arm.q, arm.v, arm.a)
        return PlantedChange(truth, np.zeros_like(arm.tau), urdf=changed, unseen=unseen)
    changed = with_body(urdf, joint, mass, place, 0.0)
    torque = rigid_torque(model_of(changed), arm.q, arm.v, arm.a)
    return PlantedChange(truth, torque - arm.rigid)


def plant_tilt(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A base that stands askew by an angle [rad], towards a side drawn by chance."""
    heading = float(draw.uniform(-np.pi, np.pi))
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    askew = arm.model.copy()
    askew.gravity.linear = tilted(arm.model.gravity.linear, axis, size)
    # Gravity turns one way in the base's frame where the base stands askew the other way.
    truth: Parameters = {"tilt_x_rad": float(-size * axis[0]), "tilt_y_rad": float(-size * axis[1])}
    return PlantedChange(truth, rigid_torque(askew, arm.q, arm.v, arm.a) - arm.rigid)


def plant_contact(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Somebody pushes against a point of a link for a while, in one run; the motors hold against
    it.
    """
    run = arm.given[int(draw.integers(len(arm.given)))]
    clock = arm.t[run]
    q = arm.q[run]
    span = float(np.ptp(clock))
    length = min(float(draw.uniform(0.6, 2.0)), 0.3 * span)
    start = float(clock[0] + draw.uniform(0.15 * span, 0.85 * span - length))
    way = draw.standard_normal(3)
    direction = way / np.linalg.norm(way)
    point = pin.SE3(np.eye(3), 1.5 * np.array(arm.model.inertias[j + 1].lever))
    torque = np.zeros_like(arm.tau)
    data = arm.model.createData()
    from_ends = np.minimum(clock - start, start + length - clock)
    window = np.clip(from_ends / RAMP, 0.0, 1.0)
    for k in np.flatnonzero(window > 0.0):
        pin.forwardKinematics(arm.model, data, q[k])
        jacobian = pin.computeJointJacobian(arm.model, data, q[k], j + 1)
        at_point = point.toActionMatrixInverse() @ jacobian
        world = data.oMi[j + 1].rotation @ at_point[:3]
        torque[run.start + k] = -window[k] * size * (world.T @ direction)
    # No force: what it is hangs on where on the link somebody pushes, which a diagnosis can't know.
    return PlantedChange({"start_s": start, "end_s": start + length}, torque)


# Sensors


def plant_gain(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A torque that is read too large or too small by a share [1]."""
    gain = size * float(draw.choice([-1.0, 1.0]))
    return at_joint(arm, j, gain * arm.tau[:, j], {"gain": gain})


def plant_offset(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A torque that is read too large or too small by so much [N m], with a slow drift."""
    offset = size * float(draw.choice([-1.0, 1.0]))
    drift = float(offset * draw.uniform(-0.1, 0.1) / 60.0)
    first = arm.t[arm.given[0].start]
    last = arm.t[arm.given[-1].stop - 1]
    middle = 0.5 * (first + last)
    truth: Parameters = {"offset_Nm": offset, "drift_Nm_s": drift}
    return at_joint(arm, j, offset + drift * (arm.t - middle), truth)


def plant_delay(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """All torques are late by a time [s]."""

    def delayed(t: Array, tau: Array) -> Array:
        """A run's torque as it is read."""
        return np.column_stack([np.interp(t - size, t, column) for column in tau.T])

    late = arm.over_runs(arm.tau, delayed)
    return PlantedChange({"delay_s": size}, late - arm.tau)


def plant_saturation(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Flat at `1 - size` of the peak, at once or after a bend."""
    limit = (1.0 - size) * float(arm.peak[j])
    tau = arm.tau[:, j]
    if draw.random() < 0.5:
        flat = np.clip(tau, -limit, limit)
    else:
        bend = 0.05 * limit
        modulus = np.abs(tau)
        bent = limit - bend * np.logaddexp(0.0, (limit - modulus) / bend)
        flat = np.where(modulus < 0.7 * limit, tau, np.sign(tau) * bent)
    return at_joint(arm, j, flat - tau, {"limit_Nm": limit})


def plant_encoder(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A zero that is off to either side by an angle [rad]."""
    shift = np.zeros(arm.n)
    shift[j] = size * float(draw.choice([-1.0, 1.0]))
    unseen = arm.rigid - rigid_torque(arm.model, arm.q + shift, arm.v, arm.a)
    # Reported is what has to be added to a reading.
    truth: Parameters = {"offset_rad": -float(shift[j])}
    return PlantedChange(truth, np.zeros_like(arm.tau), shift, unseen=unseen)


def up_to(share: float) -> Callable[[MovedArm, int], float]:
    """A torque of so many times what the joint's drive hardly exceeds."""
    return lambda arm, j: share * float(arm.peak[j])


def at_speed(share: float) -> Callable[[MovedArm, int], float]:
    """A coefficient of speed that makes a share of the joint's largest torque at its fastest.

    Args:
        share: Of the torque that the joint's drive hardly exceeds.

    Returns:
        What takes a moved arm and a joint's index to the coefficient [N m s/rad].
    """

    def largest(arm: MovedArm, j: int) -> float:
        fastest = float(np.quantile(np.abs(arm.v[:, j]), 0.95))
        return share * float(arm.peak[j]) / (fastest + 1e-3)

    return largest


def of_friction(share: float) -> Callable[[MovedArm, int], float]:
    """A torque of so many times the joint's Coulomb friction: friction brakes, and static friction
    is not far more.
    """
    return lambda arm, j: share * float(arm.coulomb[j])


def over_range(share: float) -> Callable[[MovedArm, int], float]:
    """A stiffness that makes such a torque over half of the joint's range."""

    def largest(arm: MovedArm, j: int) -> float:
        span = float(np.ptp(arm.q[:, j]))
        return 2.0 * share * float(arm.peak[j]) / (span + 1e-3)

    return largest


def fixed(most: float) -> Callable[[MovedArm, int], float]:
    """A function of arm and joint number that gives the same largest size for every joint."""
    return lambda arm, j: most


EFFECTS: dict[str, Planted] = {
    "stribeck_friction": Planted(plant_stribeck, of_friction(2.0)),
    "nonlinear_viscous_friction": Planted(plant_curved, up_to(1.5)),
    "load_dependent_friction": Planted(plant_load, fixed(0.5)),
    "thermal_friction": Planted(plant_thermal, fixed(0.95)),
    "presliding_hysteresis": Planted(plant_hysteresis, of_friction(1.5)),
    "position_dependent_friction": Planted(plant_seat, of_friction(1.0)),
    "asymmetric_friction": Planted(plant_asymmetric, lambda arm, j: 1.5 * float(arm.viscous[j])),
    "joint_coupling": Planted(plant_coupling, up_to(0.8), neighbours=True),
    "joint_elasticity": Planted(plant_elasticity, lambda arm, j: 0.1 / float(arm.peak[j])),
    "backlash": Planted(plant_backlash, fixed(0.015)),
    "torque_ripple": Planted(plant_ripple, up_to(0.15)),
    "spring_torque": Planted(plant_spring, over_range(1.5)),
    # As much as half of the strongest joint's peak torque lifts at half of the arm's length [kg].
    "payload": Planted(
        plant_payload,
        lambda arm, j: float(arm.peak.max()) / (9.81 * length_of(arm.model)),
        view="loss",
        whole_arm=True,
    ),
    "link_inertial_error": Planted(plant_link, fixed(0.8), view="loss"),
    "gravity_misalignment": Planted(plant_tilt, fixed(0.35), whole_arm=True),
    "torque_gain_error": Planted(plant_gain, fixed(0.6), view="loss"),
    "torque_offset": Planted(plant_offset, up_to(1.0), view="no_offset"),
    "torque_delay": Planted(plant_delay, fixed(0.06), whole_arm=True),
    "torque_saturation": Planted(plant_saturation, fixed(0.4)),
    "encoder_offset": Planted(plant_encoder, fixed(0.2), view="loss"),
    "external_contact": Planted(
        plant_contact, lambda arm, j: 4.0 * float(arm.peak.max()) / length_of(arm.model), local=True
    ),
}
"""The catalogue's effects."""
