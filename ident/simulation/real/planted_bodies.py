"""Bodies, gravity and pushes that are planted."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ident.simulation.causes.mechanisms import length_of, tilted, vector
from ident.simulation.real.moved_arm import MovedArm, model_of, rigid_torque
from ident.simulation.real.planting import Draw, Parameters, PlantedChange
from ident.simulation.real.sources import with_body

# Time over which a push sets in, and ends [s].
RAMP = 0.1


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
    tilt_x, tilt_y, _ = (-size * axis).tolist()
    truth: Parameters = {"tilt_x_rad": tilt_x, "tilt_y_rad": tilt_y}
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
    centre = np.array(arm.model.inertias[j + 1].lever)
    point = pin.SE3(np.eye(3), 1.5 * centre)
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
