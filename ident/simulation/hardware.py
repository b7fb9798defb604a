"""The arm as it really is: hidden inertias, friction, drives and sensors, drawn for one individual arm.

Decoys are differences from the data sheet that are no effect of the catalogue and must not be named as one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.robot.traits import rated_torque
from ident.simulation.laws import (
    Contact,
    Law,
    change_law,
    heat_law,
    make_law,
    no_contact,
    plain_friction,
    rigid_drive,
    scale_friction,
)
from ident.simulation.mjcf import Bodies, nominal_bodies
from ident.simulation.outside import OUTSIDE
from ident.simulation.sensing import Sensing


@dataclass(frozen=True, eq=False)
class Hardware:
    """One individual arm with all that the URDF does not say."""

    arm: ArmModel  # the nominal model, known to everybody
    bodies: Bodies  # its real links
    friction: Law  # its laws
    drive: Law
    heat: Law
    outside: Law
    contact: Contact
    sensing: Sensing  # its sensors
    bandwidth: float = 80.0  # of its controller, against the nominal inertia [rad/s]
    damping_ratio: float = 0.8
    friction_spread: float = 0.01  # relative change of the friction from run to run
    contact_run: int = -1  # number of the run in which the contact happens; -1 for all
    friction_path: Array | None = None  # factors on dry and viscous friction of each run, (R, 2, n); else the spread
    feed_forward: str = "rigid"  # what its controller adds: gravity (`none`), the `rigid` model, or that and `friction`
    loop_noise: float | None = None  # share of rated torque that encoder noise becomes in the loop at most

    @property
    def n(self) -> int:
        return self.arm.n

    def replace(self, **changes: Any) -> Hardware:
        return replace(self, **changes)

    def with_laws(self, part: str, joint: int | None = None, **values: Any) -> Hardware:
        """A copy with entries of one law changed: at one joint, or as a whole where joint is None.

        Args:
            part: `friction`, `drive`, `heat` or `outside`.
            joint: Index of the joint.
            **values: New values by the law's column.
        """
        return self.replace(**{part: change_law(getattr(self, part), joint, **values)})


def draw_hardware(arm: ArmModel, rng: np.random.Generator, inertia_error: float = 0.03) -> Hardware:
    """Draws an individual arm: no effect of the catalogue, but nothing exactly as in the data sheet.

    Friction and rotor scale with the rated torque, as gear size does: for 157 N m about 12 N m dry and
    10 N m s/rad viscous with 1 kg m² of rotor, for 43 N m about 2.6 N m, 1.7 N m s/rad and 0.13 kg m².
    Measured on a UR10e of like size: 20 and 2.7 N m dry, 27 and 3.4 N m s/rad viscous.

    Args:
        arm: The nominal model.
        rng: Source of chance.
        inertia_error: Standard deviation of the relative error of masses and inertias.
    """
    n, scale = arm.n, rated_torque(arm)
    relative = scale / 157.0
    own = rng.standard_normal((3, n))
    coulomb = 12.0 * relative**1.15 * np.exp(0.25 * own[0])
    viscous = 10.0 * relative**1.35 * np.exp(0.25 * own[1])
    rotor = 1.0 * relative**1.55 * np.exp(0.15 * own[2])
    size = np.linalg.norm([arm.model.inertias[i].lever for i in range(1, n + 1)], axis=1)
    bodies = nominal_bodies(n).replace(
        mass_scale=1.0 + inertia_error * rng.standard_normal(n),
        inertia_scale=1.0 + inertia_error * rng.standard_normal(n),
        com_shift=inertia_error * size[:, None] * rng.standard_normal((n, 3)),
        gravity=np.array(arm.model.gravity.linear),
    )
    rated_loss = coulomb * 0.6 + viscous * 0.6**2
    # Gear ratios: 100 at the strong joints, 80 at the weak ones, as strain-wave gears of these sizes have.
    ratio = np.where(scale > 0.5 * scale.max(), 100.0, 80.0)
    drive = change_law(rigid_drive(rotor, scale), ripple_order=2.0 * ratio)
    return Hardware(
        arm=arm,
        bodies=bodies,
        friction=plain_friction(coulomb, viscous, rotor),
        drive=drive,
        heat=heat_law(rated_loss),
        outside=make_law(OUTSIDE, n),
        contact=no_contact(),
        sensing=Sensing.typical(scale, ratio),
    )


def _inertia(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Masses and inertias of all links off by up to ten per cent, up or down alike."""
    n, bodies = hardware.n, hardware.bodies
    scales = 1.0 + rng.uniform(-0.1, 0.1, (2, n))
    mass, inertia = bodies.mass_scale * scales[0], bodies.inertia_scale * scales[1]
    return hardware.replace(bodies=bodies.replace(mass_scale=mass, inertia_scale=inertia))


def _geometry(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Joint frames up to a millimetre from where the URDF puts them."""
    shift = hardware.bodies.geometry_shift + rng.uniform(-1e-3, 1e-3, (hardware.n, 3))
    return hardware.replace(bodies=hardware.bodies.replace(geometry_shift=shift))


def _friction(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Friction half or twice of what an arm of this size has: start values from a data sheet are wrong."""
    factor = np.exp(rng.uniform(-np.log(2.0), np.log(2.0), (2, hardware.n)))
    return hardware.replace(friction=scale_friction(hardware.friction, *factor))


def _controller(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """A controller of half to one and a half times the bandwidth, with another damping."""
    return hardware.replace(
        bandwidth=hardware.bandwidth * float(rng.uniform(0.5, 1.5)),
        damping_ratio=float(rng.uniform(0.6, 1.1)),
    )


DECOYS: dict[str, Callable[[Hardware, np.random.Generator], Hardware]] = {
    "inertia": _inertia,
    "geometry": _geometry,
    "friction": _friction,
    "controller": _controller,
}


def add_decoy(hardware: Hardware, name: str, rng: np.random.Generator) -> Hardware:
    """The hardware with a decoy.

    Raises:
        InputError: No such decoy.
    """
    if name not in DECOYS:
        raise InputError("--decoy", f"unknown decoy {name!r}", f"choose from: {', '.join(DECOYS)}")
    return DECOYS[name](hardware, rng)
