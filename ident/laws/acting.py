"""Laws of the log (gain, offset, lateness, flat tops), and of bodies, gravity and angles that are
not as modelled.

A payload hangs under the gravity and at the angles that are there, so that these effects are one
change of the arm. Beside them all laws by the ids of their effects, and the torque of some of them
together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.laws.carried import COLUMNS, Columns
from ident.laws.elastic import backlash, elasticity
from ident.laws.friction_laws import JointStates, coupling, hysteresis, ripple, spring, thermal
from ident.laws.motion import Array, MovingArm, rigid_torque, rotation_about

# An effect: its id, its joint's index (-1 for the whole arm), its parameters.
Effect = tuple[str, int, dict[str, float]]
# What the log reports of a torque, against what turns the joint, in the order in which it does.
SENSING = ("torque_gain_error", "torque_offset", "torque_delay", "torque_saturation")
BODIES = ("payload", "link_inertial_error", "gravity_misalignment", "encoder_offset")


def read_log(effects: Sequence[Effect], torque: Array, interval: float) -> Array:
    """What the log reads of a torque: gain, offset, then lateness, then flat tops [N m].

    The offset is that of the middle of the diagnosed session; its drift is left out.

    Args:
        effects: Name, index of the joint and parameters of each; those that are not of the log do
            nothing.
        torque: Torque of the joints over a run, shape (T, n) [N m].
        interval: Sampling interval [s].
    """
    log = np.array(torque, dtype=float)
    for name, joint, p in _sensing(effects):
        if name == "torque_gain_error":
            log[:, joint] *= 1.0 + p["gain"]
        elif name == "torque_offset":
            log[:, joint] += p["offset_Nm"]
        elif name == "torque_delay":
            log = shifted(log, p["delay_s"], interval)
        else:
            above = np.maximum(np.abs(log[:, joint]) - p["knee_Nm"], 0.0)
            log[:, joint] -= p["lost"] * np.sign(log[:, joint]) * above
    return log


def undo_log(effects: Sequence[Effect], log: Array, interval: float) -> Array:
    """Torque behind a log, the inverse of `read_log` but for what flat tops cut off [N m].

    Args:
        effects: As `read_log` takes them.
        log: Readings of the joints over a run, shape (T, n) [N m].
        interval: Sampling interval [s].
    """
    torque = np.array(log, dtype=float)
    for name, joint, p in reversed(_sensing(effects)):
        if name == "torque_gain_error":
            torque[:, joint] /= 1.0 + p["gain"]
        elif name == "torque_offset":
            torque[:, joint] -= p["offset_Nm"]
        elif name == "torque_delay":
            torque = shifted(torque, -p["delay_s"], interval)
    return torque


def _sensing(effects: Sequence[Effect]) -> list[Effect]:
    """What the log reports of a torque, in the order in which it does."""
    return [effect for name in SENSING for effect in effects if effect[0] == name]


def shifted(values: Array, delay: float, interval: float) -> Array:
    """Signals late by a time, by the cubic through the four samples around each instant; ends are
    held.

    Args:
        values: Signals, shape (T, n).
        delay: The time, negative for early [s].
        interval: Sampling interval [s].

    Raises:
        ValueError: There is a delay but no interval.
    """
    if delay == 0.0:
        return values
    if interval <= 0.0:
        raise ValueError("a delay needs a whole run, evenly sampled, and its interval")
    whole = int(np.floor(delay / interval))
    u = delay / interval - whole
    weights = (
        -u * (1 - u) * (2 - u) / 6,  # of one sample later
        (1 + u) * (1 - u) * (2 - u) / 2,
        (1 + u) * u * (2 - u) / 2,
        -(1 + u) * u * (1 - u) / 6,
    )
    instants = np.arange(len(values)) - whole
    total = np.zeros_like(values)
    for offset, weight in zip((1, 0, -1, -2), weights, strict=True):
        total += weight * values[np.clip(instants + offset, 0, len(values) - 1)]
    return total


def changed_arm(effects: Sequence[Effect], m: MovingArm) -> Array:
    """Rigid torque of the arm as it is, less that of the model [N m].

    Args:
        effects: Name, index of the joint and parameters of payloads, errors of links, of gravity
            and of encoders; others do nothing.
        m: The run.
    """
    q = m.q.copy()
    links = m.arm.links.copy()
    gravity = m.arm.gravity
    for name, joint, p in effects:
        if name == "payload":
            links[-1] += payload_parameters(p)
        elif name == "link_inertial_error":
            links[joint] += link_change(m.arm.links[joint], p)
        elif name == "gravity_misalignment":
            gravity = turned_gravity(gravity, p)
        elif name == "encoder_offset":
            q[:, joint] += p["offset_rad"]
    return rigid_torque(m.arm, q, m.dq, m.ddq, gravity, links) - m.rigid


def point_mass(centre: Array) -> Array:
    """Ten inertial numbers of a unit point mass: 1, its centre, and its inertia about the origin.

    Args:
        centre: Where it is, shape (3,) [m].
    """
    inertia = centre @ centre * np.eye(3) - np.outer(centre, centre)
    return np.concatenate([[1.0], centre, _six(inertia)])


def moment_change(centre: Array) -> Array:
    """Change of the ten numbers per change of the first moment, for a body that is shifted, shape
    (10, 3).
    """
    unit = np.eye(3)
    columns = []
    for axis in unit:
        product = np.outer(centre, axis)
        inertia = 2.0 * (centre @ axis) * unit - product - np.outer(axis, centre)
        columns.append(np.concatenate([[0.0], axis, _six(inertia)]))
    return np.stack(columns, axis=1)


def _six(inertia: Array) -> Array:
    """Entries xx, xy, yy, xz, yz, zz of an inertia matrix."""
    return inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]


def payload_parameters(p: dict[str, float]) -> Array:
    """Ten inertial numbers of a point mass, from `mass_kg`, `com_x_m`, `com_y_m` and `com_z_m`."""
    centre = np.array([p[f"com_{axis}_m"] for axis in "xyz"])
    return p["mass_kg"] * point_mass(centre)


def link_change(link: Array, p: dict[str, float]) -> Array:
    """Change of a link's ten numbers: more of its own density, or a body at a place, then a shift
    of its first moment.

    What the parameters leave open, the second moments, follows as in the diagnosis: they grow with
    the mass, and with the shift of the first moment as those of a body near the link's centre or
    that place.

    Args:
        link: Its ten numbers in the model.
        p: `mass_change_kg`, `moment_change_x_kgm` and so on, and the place `x_m`, `y_m`, `z_m`
            where there is one.
    """
    mass = link[0]
    centre = np.zeros(3)
    density = np.eye(10)[0]
    if mass > 0.0:
        centre = link[1:4] / mass
        density = link / mass
    if "x_m" in p:
        centre = np.array([p[f"{axis}_m"] for axis in "xyz"])
        density = point_mass(centre)
    moment = np.array([p[f"moment_change_{axis}_kgm"] for axis in "xyz"])
    shift = moment - p["mass_change_kg"] * centre
    return p["mass_change_kg"] * density + moment_change(centre) @ shift


def turned_gravity(gravity: Array, p: dict[str, float]) -> Array:
    """Gravity seen from a base that is turned by small angles, shape (3,) [m/s²].

    Args:
        gravity: As the URDF has it, in the base's axes [m/s²].
        p: The angles about its own x and y, `tilt_x_rad` and `tilt_y_rad`.
    """
    tilt = np.array([p["tilt_x_rad"], p["tilt_y_rad"], 0.0])
    angle = float(np.linalg.norm(tilt))
    if angle == 0.0:
        return gravity
    turn = rotation_about(tilt / angle, np.array([-angle]))[0]
    return turn @ gravity


Law = Callable[[MovingArm, int, dict[str, float]], Array]


def of_columns(columns: Columns) -> Law:
    """A law that is linear in its coefficients, from its columns: their sum, weighted by
    `coefficient_0` and so on.
    """

    def law(m: MovingArm, j: int, p: dict[str, float]) -> Array:
        states = JointStates(
            m.q[:, j],
            m.dq[:, j],
            m.rigid[:, j],
            m.direction[:, j],
        )
        shapes = columns(states, p)
        weighted = [p[f"coefficient_{k}"] * x for k, x in enumerate(shapes)]
        return m.at(j, sum(weighted))

    return law


LAWS: dict[str, Law] = {
    **{name: of_columns(columns) for name, columns in COLUMNS.items()},
    "thermal_friction": thermal,
    "presliding_hysteresis": hysteresis,
    "joint_coupling": coupling,
    "joint_elasticity": elasticity,
    "backlash": backlash,
    "torque_ripple": ripple,
    "spring_torque": spring,
}
KNOWN = frozenset({*LAWS, *BODIES, *SENSING})


def acting_torque(effects: Sequence[Effect], motion: MovingArm) -> Array:
    """Torque of the effects that act on the joints, shape (T, n) [N m].

    Args:
        effects: Name, index of the joint and parameters of each; those of the log alone add
            nothing.
        motion: The run.
    """
    total = np.zeros_like(motion.q)
    for name, joint, p in effects:
        if name in LAWS:
            total = total + LAWS[name](motion, joint, p)
    bodies = [effect for effect in effects if effect[0] in BODIES]
    return total + changed_arm(bodies, motion) if bodies else total
