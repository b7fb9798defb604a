"""Torque that the plant's laws would add along a recorded motion: known effects on top of real recordings.

The recorded motion is taken as it is: what an effect would have changed in it is left out, so that effects which live
by that (elasticity, play, a sloshing load) are not offered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.effects.added_body import point_mass
from ident.plant.hardware import Hardware
from ident.plant.loop import fresh_state, friction_torque, records
from ident.plant.mjcf import AddedBody
from ident.plant.outside import outside_torque, remembered_torque
from ident.plant.thermal import cool_down, warm_up
from ident.plant.transmission import hose_torque, ripple_torque
from ident.trajectories.reference import TICK_S


@dataclass(frozen=True, eq=False)
class Track:
    """A recorded run at the plant's ticks.

    Attributes:
        start: Session time of the first tick [s].
        q, dq, ddq: Motion, shape (K, n).
        link: Torque through the joints [N m], shape (K, n).
    """

    start: float
    q: Float[Array, "K n"]
    dq: Float[Array, "K n"]
    ddq: Float[Array, "K n"]
    link: Float[Array, "K n"]

    @property
    def ticks(self) -> Float[Array, " K"]:
        """Time since the first tick [s]."""
        return np.arange(len(self.q)) * TICK_S


def law_torque(hardware: Hardware, paths: Sequence[Track]) -> list[Float[Array, "K n"]]:
    """Motor torque that the arm's laws ask for along each path, in order [N m]: friction, teeth, dress pack, bodies."""
    laws = records(hardware.friction), records(hardware.drive), records(hardware.heat), records(hardware.outside)
    state, total, clock = fresh_state(hardware.n), [], None
    for path in paths:
        if clock is not None:
            _rest(hardware, state, max(path.start - clock, 0.0))
        torque = np.zeros_like(path.q)
        _follow(*laws, state, path.q, path.dq, path.ddq, path.link, TICK_S, torque)
        total.append(torque + rigid_change(hardware, path))
        clock = path.start + len(path.q) * TICK_S
    return total


def _rest(hardware: Hardware, state: Array, pause: float) -> None:
    """Cools the joints, and lets their bristles go."""
    rise = np.column_stack([state["lubricant_rise"], state["housing_rise"]])
    cooled = cool_down(hardware.heat, rise, pause)
    state[:] = np.zeros(1, dtype=state.dtype)
    state["lubricant_rise"], state["housing_rise"] = cooled.T


@njit(cache=True)
def _follow(
    friction: Any,
    drive: Any,
    heat: Any,
    outside: Any,
    state: Any,
    q: Array,
    dq: Array,
    ddq: Array,
    link: Array,
    dt: float,
    torque: Array,
) -> None:
    """Adds up the torque of all laws, tick by tick; the state is advanced in place."""
    for k in range(q.shape[0]):
        for j in range(q.shape[1]):
            own = state[j]
            own.motor_angle, own.motor_speed = q[k, j], dq[k, j]
            own.transmitted, own.acceleration = link[k, j], ddq[k, j]
            rubbing = friction_torque(friction[j], own, dt)
            warm_up(heat[j], own, max(rubbing * dq[k, j], 0.0), dt)
            torque[k, j] = rubbing + ripple_torque(drive[j], q[k, j], link[k, j])
            torque[k, j] -= hose_torque(drive[j], q[k, j])
            torque[k, j] -= outside_torque(outside[j], j, q[k], dq[k], k * dt)
            torque[k, j] -= remembered_torque(outside[j], own, q[k, j], dq[k, j], dt)


def rigid_change(hardware: Hardware, path: Track) -> Float[Array, "K n"]:
    """Torque of added bodies and of a turned gravity, above that of the nominal arm [N m]."""
    arm, bodies = hardware.arm, hardware.bodies
    if not bodies.added and np.allclose(bodies.gravity, arm.model.gravity.linear):
        return np.zeros_like(path.q)
    parameters = np.array(arm.inertial_parameters).reshape(arm.n, 10)
    for body in bodies.added:
        parameters[arm.links.index(body.link)] += added_parameters(body)
    real = arm.with_inertial_parameters(parameters.ravel()).with_gravity(np.array(bodies.gravity))
    keep = slice(None, None, 4)  # smooth: every fourth tick is enough
    change = real.inverse_dynamics(path.q[keep], path.dq[keep], path.ddq[keep])
    change = change - arm.inverse_dynamics(path.q[keep], path.dq[keep], path.ddq[keep])
    ticks = path.ticks
    return np.column_stack([np.interp(ticks, ticks[keep], column) for column in change.T])


def added_parameters(body: AddedBody) -> Float[Array, " 10"]:
    """Inertial parameters of a body fixed to a link: mass, first moment, (Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    point: Float[Array, " 10"] = body.mass * point_mass(np.array(body.com))
    point[[4, 6, 9]] += body.mass * body.radius**2
    return point
