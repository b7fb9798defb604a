"""Causes that act on the links (bodies, gravity, pushes), and sensors that read something else than what is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.simulation.causes.base import Cause, Circumstances, Parameters, between, reading
from ident.simulation.hardware import AddedBody, Hardware, as_point
from ident.simulation.laws import Contact


def vector(name: str, values: Float[Array, " 3"], unit: str) -> Parameters:
    """A parameter for each axis."""
    return {f"{name}_{axis}_{unit}": float(value) for axis, value in zip("xyz", values, strict=True)}


def length_of(model: pin.Model) -> float:
    """Rough length of an arm [m]."""
    return float(sum(np.linalg.norm(one.translation) for one in list(model.jointPlacements)[1:])) + 1e-3


def reach(hardware: Hardware) -> float:
    """Rough length of the arm [m]."""
    return length_of(hardware.arm.model)


def tilted(gravity: Float[Array, " 3"], axis: Float[Array, " 3"], angle: float) -> Float[Array, " 3"]:
    """Gravity, turned about an axis of the base (Rodrigues)."""
    turned = gravity * np.cos(angle) + np.cross(axis, gravity) * np.sin(angle)
    return turned + axis * (axis @ gravity) * (1.0 - np.cos(angle))


def _payload(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A box at the flange that nobody mentioned."""
    h = scene.hardware
    com = 0.06 * reach(h) * scene.rng.uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 1.2])
    body = AddedBody(h.arm.links[-1], size, as_point(com), radius=0.03 * reach(h))
    hardware = h.replace(bodies=h.bodies.replace(added=(*h.bodies.added, body)))
    return hardware, {"mass_kg": size, **vector("com", com, "m")}


def _payload_bounds(scene: Circumstances) -> tuple[float, float]:
    """No more than twice what the wrist can hold."""
    h = scene.hardware
    return 0.0, 2.0 * float(h.drive.effort_limit.max()) / (9.81 * reach(h))


def _link_inertia(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Something is mounted on the link, or missing from it: mass, first and second moments change together."""
    h, j = scene.hardware, scene.joint
    nominal = h.arm.model.inertias[j + 1]
    mass = size * nominal.mass
    place = np.array(nominal.lever) + 0.08 * reach(h) * scene.rng.uniform(-1.0, 1.0, 3)
    # Taken away where it is: off-centre gaps could leave a link that no body can have.
    place = place if size > 0.0 else np.array(nominal.lever) * scene.rng.uniform(0.9, 1.1)
    body = AddedBody(h.arm.links[j], float(mass), as_point(place), radius=0.02 * reach(h) * (size > 0.0))
    hardware = h.replace(bodies=h.bodies.replace(added=(*h.bodies.added, body)))
    return hardware, {"mass_change_kg": float(mass), **vector("moment_change", mass * place, "kgm")}


def _tilt(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The base stands askew: gravity turns about a horizontal axis of the base."""
    h = scene.hardware
    heading = float(scene.rng.uniform(-np.pi, np.pi))
    tilt = size * np.array([np.cos(heading), np.sin(heading)])
    axis = np.array([tilt[0], tilt[1], 0.0]) / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    hardware = h.replace(bodies=h.bodies.replace(gravity=tilted(np.array(h.bodies.gravity), axis, size)))
    return hardware, {"tilt_x_rad": float(tilt[0]), "tilt_y_rad": float(tilt[1]), "tilt_rad": size}


def _contact(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Somebody pushes against a link for a while, in one run."""
    h, rng = scene.hardware, scene.rng
    run = int(rng.integers(len(scene.motions)))
    duration = scene.motions[run].duration
    length = min(float(rng.uniform(0.5, 1.5)), 0.4 * duration)
    start = float(rng.uniform(0.2 * duration, 0.75 * duration - length))
    direction = rng.standard_normal(3)
    force = size * direction / np.linalg.norm(direction)
    nominal = h.arm.model.inertias[scene.joint + 1]
    point = 1.5 * np.array(nominal.lever)
    push = Contact(scene.joint + 1, start, start + length, force, point)
    truth = {"run": run + 1, "start_s": start, "end_s": start + length, "force_N": size}
    return h.replace(contact=push, contact_run=run), {**truth, "link": h.arm.links[scene.joint]}


LOAD = (
    Cause(
        "payload",
        "mass_kg",
        lambda s: 0.02 * s.hardware.drive.effort_limit.max() / reach(s.hardware) / 9.81 * 4.0,
        _payload_bounds,
        _payload,
        whole_arm=True,
        view="loss",
    ),
    Cause("link_inertial_error", "mass_share", lambda s: 0.15, between(-0.6, 2.0), _link_inertia, view="loss"),
    Cause("gravity_misalignment", "tilt_rad", lambda s: 0.015, between(0.0, 0.35), _tilt, whole_arm=True),
    Cause("external_contact", "force_N", lambda s: 20.0, between(0.0, 500.0), _contact, needs_all=True),
)


# What a wrong calibration makes of a drive that still follows its reference: current gains, ages of readings [s],
# encoder zeros [rad].
GAINS, LARGEST_DELAY_S, ENCODER_ZEROS = (-0.4, 0.6), 0.05, (-0.1, 0.1)


def _offset(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """An offset that drifts by about a tenth of itself in a minute, and wanders a little."""
    drift = float(size * scene.rng.uniform(-0.1, 0.1) / 60.0)
    sensing = scene.hardware.sensing.set(scene.joint, offset=size, drift=drift, wander=0.03 * abs(size))
    return scene.hardware.replace(sensing=sensing), {"offset_Nm": size, "drift_Nm_s": drift}


def _delay(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    return scene.hardware.replace(sensing=scene.hardware.sensing.replace(delay=size)), {"delay_s": size}


def _delay_bounds(scene: Circumstances) -> tuple[float, float]:
    """Drives whose readings are older have lost them; none is older than the shortest run."""
    return 0.0, min(LARGEST_DELAY_S, *(motion.duration for motion in scene.motions))


SENSOR = (
    Cause("torque_gain_error", "gain", lambda s: 0.06, between(*GAINS), reading("gain", "gain", 1.0), view="loss"),
    Cause("torque_offset", "offset_Nm", lambda s: 0.004 * s.rated, lambda s: (-s.rated, s.rated), _offset, view="raw"),
    Cause("torque_delay", "delay_s", lambda s: 0.008, _delay_bounds, _delay, whole_arm=True),
    Cause(
        "torque_saturation",
        "limit_Nm",
        lambda s: 0.75 * s.peak_torque(),
        lambda s: (1e-3 * s.rated, 2.0 * s.rated),
        reading("limit", "limit_Nm"),
        inverse=True,
    ),
    Cause(
        "encoder_offset",
        "offset_rad",
        lambda s: 0.015,
        between(*ENCODER_ZEROS),
        reading("encoder_offset", "offset_rad"),
        view="loss",
    ),
)
