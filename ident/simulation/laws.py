"""The plant's laws as tables, a record a joint, and what they do: friction, heat, gears, and a push
from outside.

A law is declared once, in `laws.toml`, as its columns; compiled code takes one table.

Dry friction is bristles that stick, not a function of velocity. Every sliding contact is a LuGre
bristle of deflection z,

    dz/dt = v - σ0 |v| z / g(v, …),    F = σ0 z + σ1(v) dz/dt,

which holds any torque below its level g at rest. The level carries the Stribeck fall, the mesh
load, the seat's eccentricity, the direction and the temperature; viscous drag is the lubricant's,
with shear thinning after Eyring. The lubricant warms by what friction loses, the housing takes it
up and cools to the air, with temperatures above ambient

    C_1 dθ_1/dt = P_loss - G_1 (θ_1 - θ_2),    C_2 dθ_2/dt = G_1 (θ_1 - θ_2) - G_2 θ_2.

Between motor and link lie a rotor, a spring, a gap, tooth ripple, and the dress pack around the
joint. MuJoCo carries a push, smooth at its start and end, to the joints; no Jacobian is written
down here.

Source: Canudas de Wit et al. 1995 (LuGre); Eyring 1936 (shear thinning); Bittencourt and Gunnarsson
2010 (load, temperature); Spong 1987 (two bodies and a spring); Hunt and Crossley 1975 (contact in
the gap).
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from ident.arrays import Array, Float
from ident.compiled import compiled

Law = np.recarray[Any, Any]
"""n records; `law.viscous` is a column of shape (n,)."""
Column = float | Array
"""A value of all joints, or one of each, shape (n,)."""


COLUMNS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
"""By law every column with its usual value."""
# Presliding of the ordinary (stiff) bristles before they slip [rad]: a third of a degree at the
# motor, behind the gear.
STIFF_PRESLIDING = 5e-5
# A contact younger than this has no more friction than a fresh one [s].
YOUNGEST_S = 0.02
# Damping ratio of the resonance that a kinematic error meets.
WOBBLE_DAMPING = 0.15


def make_law(law: str, n: int, **values: Column) -> Law:
    """A law of n joints of `laws.toml`; columns of shape (n,), or one value for all joints, in
    place of the usual.

    Args:
        law: A table of `laws.toml`.
        n: Number of joints.
        values: Columns by their names.
    """
    columns = COLUMNS[law]
    kinds = np.dtype([(name, type(value)) for name, value in columns.items()], align=True)
    records = np.zeros(n, dtype=kinds).view(np.recarray)
    for name, value in {**columns, **values}.items():
        records[name] = value
    return records


def change_law(law: Law, joint: int | None = None, **values: Column) -> Law:
    """A copy with some columns changed: at one joint, or as a whole where joint is None.

    Args:
        law: Left as it is.
        joint: Number of the joint; None for all.
        values: Columns by their names.
    """
    changed = law.copy()
    for name, value in values.items():
        changed[name][slice(None) if joint is None else joint] = value
    return changed


def plain_friction(
    coulomb: Float[Array, " n"], viscous: Float[Array, " n"], inertia: Float[Array, " n"]
) -> Law:
    """Friction of a healthy joint: Coulomb that sticks [N m], and viscous drag [N m s/rad]; of
    either none where zero.

    The least inertia that moves with the joint [kg m²] sets the bristles' damping.
    """
    stiffness = coulomb / STIFF_PRESLIDING
    bristles = {
        "bristle_stiffness": stiffness,
        "bristle_damping": 0.6 * np.sqrt(stiffness * inertia),
    }
    floor = 0.02 * coulomb + 1e-6
    return make_law(
        "friction", len(coulomb), coulomb=coulomb, viscous=viscous, load_floor=floor, **bristles
    )


def scale_friction(law: Law, coulomb: Array | float, viscous: Array | float) -> Law:
    """A copy of a friction law that rubs more or less.

    Args:
        law: Left as it is.
        coulomb: Factor on dry friction and its bristles, of each joint or of all.
        viscous: Factor on the drag.
    """
    dry = {"coulomb": law.coulomb * coulomb, "bristle_stiffness": law.bristle_stiffness * coulomb}
    return change_law(law, **dry, viscous=law.viscous * viscous)


@compiled()
def seat_shape(angle: float) -> float:
    """An eccentric seat rubs harder where it is tight: a bump a turn, of mean zero and amplitude
    about one.
    """
    return (np.exp(0.5 * np.cos(angle)) - 1.0634833707413236) / 0.51526


@compiled()
def sliding_level(
    joint: np.record, v: float, angle: float, transmitted: float, acceleration: float, warm: float
) -> float:
    """g: the dry friction that the ordinary contact of a joint would have if it slid steadily at v
    [N m].
    """
    level = joint.coulomb
    if joint.seat != 0.0:
        level *= 1.0 + joint.seat * seat_shape(joint.seat_order * angle + joint.seat_phase)
    if joint.stribeck != 0.0:
        level += joint.stribeck * np.exp(
            -((abs(v) / joint.stribeck_velocity) ** joint.stribeck_exponent)
        )
    if joint.load != 0.0:
        floor = joint.load_floor
        felt = np.sqrt(transmitted * transmitted + floor * floor) - floor
        level += (
            joint.load
            * felt
            * (1.0 + joint.load_drive * np.tanh(v * transmitted / (0.05 * floor + 1e-9)))
        )
    if joint.coulomb_skew != 0.0:
        level += 0.5 * joint.coulomb_skew * np.tanh(v / 1e-3)
    if joint.skid != 0.0:
        level += joint.skid * np.tanh(abs(acceleration) / joint.skid_scale)
    if joint.thermal_coulomb != 0.0:
        level *= np.exp(-joint.thermal_coulomb * warm)
    return max(level, 1e-6)


@compiled()
def bristle(
    z: float, v: float, level: float, stiffness: float, damping: float, dt: float
) -> tuple[float, float]:
    """One step of a bristle: its new deflection [rad] and its torque [N m].

    Implicit in z, so that it is stable at any speed; the damping dies out above creeping speed, or
    it would add viscous drag.
    """
    if stiffness <= 0.0:
        return 0.0, 0.0
    bent = (z + dt * v) / (1.0 + dt * stiffness * abs(v) / level)
    creep = level / stiffness * 50.0
    rate = damping / (1.0 + (v / creep) ** 2)
    return bent, stiffness * bent + rate * (bent - z) / dt


@compiled()
def viscous_drag(joint: np.record, v: float, warm: float) -> float:
    """Drag of the lubricant [N m]: Newtonian and shear-thinning part, thinner when warm.

    Args:
        joint: The joint's row of the friction law.
        v: Its speed [rad/s].
        warm: The lubricant above ambient [K].
    """
    drag = joint.viscous * v
    if joint.viscous_skew != 0.0:
        drag += 0.5 * joint.viscous_skew * abs(v)
    if joint.eyring != 0.0:
        drag += joint.eyring * np.arcsinh(v / joint.eyring_velocity)
    if joint.thermal_viscous != 0.0:
        drag *= np.exp(-joint.thermal_viscous * warm)
    return drag


def heat_law(
    rated_loss: Float[Array, " n"], rise: float = 25.0, time_constant: float = 90.0
) -> Law:
    """A network whose lubricant settles at a rise above ambient [K] under a rated loss, friction's
    in steady work [W].

    The time constant is the lubricant's against the housing [s]; the housing's own is ten times as
    long.
    """
    inner = rated_loss / (0.75 * rise)
    outer = rated_loss / (0.25 * rise)
    capacities = {"lubricant": time_constant * inner, "housing": 10.0 * time_constant * outer}
    return make_law("heat", len(rated_loss), **capacities, inner=inner, outer=outer)


@compiled()
def warm_up(joint: np.record, state: np.record, loss: float, dt: float) -> None:
    """Advances a joint's two temperatures above ambient [K] by dt [s] under a loss [W], in
    place.
    """
    flow = joint.inner * (state.lubricant_rise - state.housing_rise)
    state.lubricant_rise += dt * (loss - flow) / joint.lubricant
    state.housing_rise += dt * (flow - joint.outer * state.housing_rise) / joint.housing


def cool_down(law: Law, rise: Float[Array, "n 2"], pause: float) -> Float[Array, "n 2"]:
    """Temperatures above ambient [K] after a pause [s] at rest: the exact solution of the linear
    network.
    """
    cooled = np.empty_like(rise)
    for j in range(len(rise)):
        inner = law.inner[j]
        outer = law.outer[j]
        from_lubricant = inner / law.lubricant[j]
        from_housing = inner / law.housing[j]
        lost = outer / law.housing[j]
        rate = np.array([[-from_lubricant, from_lubricant], [from_housing, -from_housing - lost]])
        cooled[j] = expm(rate * pause) @ rise[j]
    return cooled


@compiled()
def spring_torque(joint: np.record, twist: float, rate: float) -> float:
    """Torque that the spring carries from motor to link [N m]; twist is motor less link angle
    [rad].

    Args:
        joint: The joint's row of the drive's law.
        twist: Motor less link angle [rad].
        rate: Its change [rad/s].
    """
    half = 0.5 * joint.gap
    if half <= 0.0:
        return joint.stiffness * twist + joint.damping * rate
    if abs(twist) <= half:
        return 0.0
    depth = abs(twist) - half
    side = 1.0 if twist > 0.0 else -1.0
    # Contact damping grows from zero with the depth, and a contact never pulls.
    share = min(depth / half, 1.0)
    return side * max(joint.stiffness * depth + side * joint.damping * share * rate, 0.0)


@compiled()
def ripple_torque(joint: np.record, angle: float, transmitted: float) -> float:
    """Torque by which the teeth help or hinder at a motor angle [N m]: main order, and a little of
    half and double.
    """
    if joint.ripple == 0.0:
        return 0.0
    phase = joint.ripple_order * angle + joint.ripple_phase
    wave = np.cos(phase) + 0.12 * np.cos(0.5 * phase) + 0.08 * np.cos(2.0 * phase)
    return joint.ripple * (1.0 + joint.ripple_load * abs(transmitted) / joint.effort_limit) * wave


@compiled()
def hose_torque(joint: np.record, angle: float) -> float:
    """Torque of the dress pack on the link [N m], against the deflection and stiffening with it."""
    if joint.hose_stiffness == 0.0:
        return 0.0
    span = joint.hose_span
    return -joint.hose_stiffness * span * np.sinh((angle - joint.hose_rest) / span)


class Contact(NamedTuple):
    """One push."""

    body: int  # MuJoCo's number of the link's body; 0 for none
    start: float  # begin and end, since the start of the run [s]
    end: float
    force: Array  # in the base frame [N], shape (3,)
    point: Array  # where it acts, in the link's frame [m], shape (3,)


def no_contact() -> Contact:
    """Nothing pushes: a contact without force."""
    return Contact(0, 0.0, 0.0, np.zeros(3), np.zeros(3))


@compiled()
def push(
    contact: Contact, elapsed: float, position: Array, rotation: Array, centre: Array, wrench: Array
) -> None:
    """Writes the wrench of the push on its body, about the body's centre of mass, in place.

    Args:
        contact: The push.
        elapsed: Time since the start of the run [s].
        position, rotation, centre: MuJoCo's xpos, xmat and xipos.
        wrench: MuJoCo's xfrc_applied, force then moment.
    """
    b = contact.body
    wrench[b] = 0.0
    if elapsed <= contact.start or elapsed >= contact.end:
        return
    ramp = min(0.05, 0.25 * (contact.end - contact.start))
    edge = min(elapsed - contact.start, contact.end - elapsed) / ramp
    scale = 1.0 if edge >= 1.0 else 0.5 - 0.5 * np.cos(np.pi * edge)
    lever = np.zeros(3)
    for i in range(3):
        lever[i] = position[b, i] - centre[b, i]
        for k in range(3):
            lever[i] += rotation[b, 3 * i + k] * contact.point[k]
    force = scale * contact.force
    wrench[b, :3] = force
    wrench[b, 3] = lever[1] * force[2] - lever[2] * force[1]
    wrench[b, 4] = lever[2] * force[0] - lever[0] * force[2]
    wrench[b, 5] = lever[0] * force[1] - lever[1] * force[0]


# Laws that no catalogue lists: causes that a diagnosis has to refuse to name. Never imported by it.
# Cable drag, velocity-product drag and brake drag act here as torques in the loop; the sloshing
# load is a body (`hardware.Slosh`), the skidding friction a level of the bristles of `laws.toml`,
# and the supply's sag a reading of the drive (`sensing.Sensing.sag`). Laws with a memory or of the
# mesh act here too: a seal that relaxes (Maxwell's element), dry friction that grows while the
# contact rests (rate and state), teeth whose friction turns round at the pitch point, and a gear's
# kinematic error, which shakes the link the harder the nearer its order comes to the drive's
# resonance. Source: Maxwell 1867; Dieterich 1979 and Ruina 1983 (rate and state); Velex and Cahouet
# 2000 (tooth friction); Tuttle and Seering 1996 (kinematic error of a strain-wave gear and its
# resonance).


@compiled()
def outside_torque(joint: np.record, j: int, q: Array, v: Array, elapsed: float) -> float:
    """Torque on joint j [N m], given all positions, velocities and the time since the run began
    [s].

    Args:
        joint: The joint's row of the law of what is outside.
        j: Its number.
        q: All positions (n,) [rad].
        v: All speeds (n,) [rad/s].
        elapsed: Since the run began [s].
    """
    torque = 0.0
    if joint.cable == 0.0 and joint.product == 0.0 and joint.brake == 0.0:
        return torque
    slide = np.tanh(v[j] / 0.01)
    if joint.cable != 0.0:
        centre = joint.cable_centre + joint.cable_share * q[joint.cable_other]
        # Angles wrap: the band lies on the circle.
        away = np.arctan2(np.sin(q[j] - centre), np.cos(q[j] - centre)) / joint.cable_width
        torque -= joint.cable * slide / (1.0 + away**6)
    if joint.product != 0.0:
        torque -= joint.product * v[j] * abs(v[joint.product_other])
    if joint.brake != 0.0:
        torque -= joint.brake * slide * np.exp(-elapsed / joint.brake_decay)
    return torque


@compiled()
def remembered_torque(joint: np.record, state: Any, angle: float, v: float, dt: float) -> float:
    """Torque on a joint [N m] of the laws that have a memory or live in the mesh; advances the
    memory in place.
    """
    torque = 0.0
    if joint.seal != 0.0:  # d(stretched)/dt = k v - stretched / relaxation, implicit
        state.stretched = (state.stretched + joint.seal * v * dt) / (
            1.0 + dt / joint.seal_relaxation
        )
        torque -= state.stretched
    if joint.ageing != 0.0:  # d(age)/dt = 1 - |v| age / slip, implicit
        state.age = (state.age + dt) / (1.0 + dt * abs(v) / joint.ageing_slip)
        torque -= joint.ageing * np.log(1.0 + state.age / YOUNGEST_S) * np.tanh(v / 2e-3)
    if joint.tooth != 0.0:
        wave = np.sin(joint.tooth_order * angle)
        torque -= joint.tooth * abs(state.transmitted) * np.tanh(v / 0.01) * np.tanh(4.0 * wave)
    if joint.wobble != 0.0:
        pulse = joint.wobble_order * v
        share = pulse / joint.wobble_resonance
        growth = 1.0 / np.sqrt((1.0 - share**2) ** 2 + (2.0 * WOBBLE_DAMPING * share) ** 2)
        torque -= (
            joint.wobble_inertia
            * joint.wobble
            * pulse**2
            * growth
            * np.sin(joint.wobble_order * angle)
        )
    return torque
