"""The arm as it really is: hidden inertias, friction, drives and sensors, drawn for one individual arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.robot.arm import ArmModel
from ident.robot.traits import rated_torque
from ident.simulation.contact import Contact, no_contact
from ident.simulation.friction import plain_friction
from ident.simulation.laws import Law, change_law, make_law
from ident.simulation.mjcf import Bodies, nominal_bodies
from ident.simulation.outside import OUTSIDE
from ident.simulation.sensing import Sensing
from ident.simulation.thermal import heat_law
from ident.simulation.transmission import rigid_drive


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
