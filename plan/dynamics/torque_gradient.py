"""Torque with its exact derivatives by position, speed and acceleration: what gradient planners ask for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.laws.carried import states_of
from plan.dynamics.power import ChainTorque
from plan.dynamics.rigid import rnea

# Step of the central difference by position [rad]: the error of either kind is then some 1e-9 of the torque.
STEP = 1e-5
# The same for friction laws, in their states' own units: these are smooth on scales that are thousands of times it.
LAW_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class TorqueDerivatives:
    """Torque at T states and its partial derivatives; first index the state, second the torque's joint.

    Attributes:
        tau: Torque [N m].
        by_position, by_speed, by_acceleration: Derivatives by the joints' q, dq and ddq.
    """

    tau: Float[Array, "T n"]
    by_position: Float[Array, "T n n"]
    by_speed: Float[Array, "T n n"]
    by_acceleration: Float[Array, "T n n"]


@njit(cache=True, fastmath=True, nogil=True)
def _rigid_partials(chain, q, dq, ddq, step):  # type: ignore[no-untyped-def]
    """Rigid torque and its partials: exact by acceleration (linear) and speed (quadratic), central by position."""
    count, n = q.shape
    tau = np.empty((count, n))
    by_q, by_v, by_a = np.empty((count, n, n)), np.empty((count, n, n)), np.empty((count, n, n))
    work, low, high, x = np.empty((n, 18)), np.empty(n), np.empty(n), np.empty(n)
    for t in range(count):
        rnea(chain, q[t], dq[t], ddq[t], work, tau[t])
        for j in range(n):
            x[:] = ddq[t]
            x[j] += 1.0
            rnea(chain, q[t], dq[t], x, work, high)
            for i in range(n):
                by_a[t, i, j] = high[i] - tau[t, i]
            x[:] = dq[t]
            x[j] += 1.0
            rnea(chain, q[t], x, ddq[t], work, high)
            x[j] -= 2.0
            rnea(chain, q[t], x, ddq[t], work, low)
            for i in range(n):
                by_v[t, i, j] = 0.5 * (high[i] - low[i])
            x[:] = q[t]
            x[j] += step
            rnea(chain, x, dq[t], ddq[t], work, high)
            x[j] -= 2.0 * step
            rnea(chain, x, dq[t], ddq[t], work, low)
            for i in range(n):
                by_q[t, i, j] = (high[i] - low[i]) / (2.0 * step)
    return tau, by_q, by_v, by_a


def rounded(model: ChainTorque, width: float) -> ChainTorque:
    """The same model with the sign of its friction rounded by a width, beyond what the model itself does [rad/s]."""
    losses = model.losses
    return replace(model, losses=replace(losses, transition_speed=losses.transition_speed + width))


def differentiate_torque(
    model: ChainTorque, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> TorqueDerivatives:
    """Torque of a compiled model and its partial derivatives at T states.

    Args:
        model: Rigid body, losses and perhaps a net; a friction that jumps has no slope here, see `rounded`.
        q, dq, ddq: States.
    """
    states = [np.ascontiguousarray(part, dtype=float) for part in (q, dq, ddq)]
    rigid, by_q, by_v, by_a = _rigid_partials(model.chain, *states, STEP)  # type: ignore[call-arg]
    tau, losses, joints = rigid.copy(), model.losses, np.arange(model.n)
    # Sign of the speed, rounded by tanh(v / width), and its slope; where the width is zero, that is not seen.
    width = np.where(losses.transition_speed > 0.0, losses.transition_speed, np.inf)
    slip = np.where(width < np.inf, np.tanh(states[1] / width), np.sign(states[1]))
    slope = np.where(width < np.inf, (1.0 - slip**2) / width, 0.0)
    by_state = by_q, by_v, by_a
    # By what the load of each law's joint changes, before anything else is added to it.
    by_state_of_load = [[part[:, law.joint].copy() for part in by_state] for law in model.named]
    if model.net is not None:
        tau += model.net.add_slopes(states, rigid, by_state)
    for law, slopes_of_load in zip(model.named, by_state_of_load, strict=True):
        j, at, found = law.joint, states_of(law.joint, states[0], states[1], rigid, slip), {}
        for name in ("q", "dq", "slip", "load"):  # moduli have corners: there this is the mean of both sides
            ends = (replace(at, **{name: getattr(at, name) + step}) for step in (LAW_STEP, -LAW_STEP))
            up, down = map(law.torque, ends)
            found[name] = (up - down) / (2.0 * LAW_STEP)
        tau[:, j] += law.torque(at)
        for part, rows in zip(by_state, slopes_of_load, strict=True):
            part[:, j] += found["load"][:, None] * rows
        by_q[:, j, j] += found["q"]
        by_v[:, j, j] += found["dq"] + slope[:, j] * found["slip"]
    tau += losses.motor_inertia * states[2] + losses.viscous * states[1] + losses.coulomb * slip + losses.offset
    by_a[:, joints, joints] += losses.motor_inertia
    by_v[:, joints, joints] += losses.viscous + losses.coulomb * slope
    return TorqueDerivatives(tau, by_q, by_v, by_a)
