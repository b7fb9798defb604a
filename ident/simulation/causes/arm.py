"""Causes that act on the links (bodies, gravity, pushes), and sensors that read something else than what is."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.simulation.causes.base import Circumstances, Parameters, acts_as
from ident.simulation.hardware import AddedBody, Hardware
from ident.simulation.laws import Contact


def vector(name: str, values: Float[Array, " 3"], unit: str) -> Parameters:
    """A parameter for each axis."""
    return {f"{name}_{axis}_{unit}": float(value) for axis, value in zip("xyz", values, strict=True)}


def tilted(gravity: Float[Array, " 3"], axis: Float[Array, " 3"], angle: float) -> Float[Array, " 3"]:
    """Gravity, turned about an axis of the base (Rodrigues)."""
    turned = gravity * np.cos(angle) + np.cross(axis, gravity) * np.sin(angle)
    return turned + axis * (axis @ gravity) * (1.0 - np.cos(angle))


def _carrying(hardware: Hardware, joint: int, mass: float, place: Array, radius: float) -> Hardware:
    """The hardware with a body at the link that a joint moves."""
    body = AddedBody(hardware.arm.links[joint], mass, place, radius)
    return hardware.replace(bodies=hardware.bodies.replace(added=(*hardware.bodies.added, body)))


@acts_as("payload")
def _payload(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A box at the flange that nobody mentioned."""
    com = 0.06 * scene.reach * scene.rng.uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 1.2])
    hardware = _carrying(scene.hardware, -1, size, com, 0.03 * scene.reach)
    return hardware, {"mass_kg": size, **vector("com", com, "m")}


@acts_as("link_inertial_error")
def _link_inertia(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Something is mounted on the link, or missing from it: mass, first and second moments change together."""
    nominal = scene.hardware.arm.model.inertias[scene.joint + 1]
    mass = float(size * nominal.mass)
    place = np.array(nominal.lever) + 0.08 * scene.reach * scene.rng.uniform(-1.0, 1.0, 3)
    # Taken away where it is: off-centre gaps could leave a link that no body can have.
    place = place if size > 0.0 else np.array(nominal.lever) * scene.rng.uniform(0.9, 1.1)
    hardware = _carrying(scene.hardware, scene.joint, mass, place, 0.02 * scene.reach * (size > 0.0))
    return hardware, {"mass_change_kg": mass, **vector("moment_change", mass * place, "kgm")}


@acts_as("gravity_misalignment")
def _tilt(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The base stands askew: gravity turns about a horizontal axis of the base."""
    bodies = scene.hardware.bodies
    heading = float(scene.rng.uniform(-np.pi, np.pi))
    tilt = size * np.array([np.cos(heading), np.sin(heading)])
    axis = np.array([tilt[0], tilt[1], 0.0]) / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    bodies = bodies.replace(gravity=tilted(np.array(bodies.gravity), axis, size))
    true: Parameters = {"tilt_x_rad": float(tilt[0]), "tilt_y_rad": float(tilt[1]), "tilt_rad": size}
    return scene.hardware.replace(bodies=bodies), true


@acts_as("external_contact")
def _contact(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Somebody pushes against a link for a while, in one run."""
    h, rng = scene.hardware, scene.rng
    run = int(rng.integers(len(scene.motions)))
    duration = scene.motions[run].duration
    length = min(float(rng.uniform(0.5, 1.5)), 0.4 * duration)
    start = float(rng.uniform(0.2 * duration, 0.75 * duration - length))
    direction = rng.standard_normal(3)
    force = size * direction / np.linalg.norm(direction)
    point = 1.5 * np.array(h.arm.model.inertias[scene.joint + 1].lever)
    push = Contact(scene.joint + 1, start, start + length, force, point)
    truth = {"run": run + 1, "start_s": start, "end_s": start + length, "force_N": size}
    return h.replace(contact=push, contact_run=run), {**truth, "link": h.arm.links[scene.joint]}


@acts_as("torque_offset")
def _offset(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """An offset that drifts by about a tenth of itself in a minute, and wanders a little."""
    drift = float(size * scene.rng.uniform(-0.1, 0.1) / 60.0)
    sensing = scene.hardware.sensing.set(scene.joint, offset=size, drift=drift, wander=0.03 * abs(size))
    return scene.hardware.replace(sensing=sensing), {"offset_Nm": size, "drift_Nm_s": drift}


@acts_as("torque_delay")
def _delay(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    return scene.hardware.replace(sensing=scene.hardware.sensing.replace(delay=size)), {"delay_s": size}
