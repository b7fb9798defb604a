"""Laws of gears that give way: an elastic joint, and one with play.

The position is the motor's; the link lags by a deflection δ that follows from the arm's own inverse dynamics.
"""

from __future__ import annotations

from math import ceil, copysign

import numpy as np

from ident.export.standalone.chain import Array, rigid_torque
from ident.export.standalone.motion import MovingArm

# The elastic joint is integrated with steps no longer than this [s].
LONGEST_STEP = 0.002
# Gear in contact behind its play: stiffness in rated torques a radian, and damping ratio.
CONTACT_STIFFNESS, CONTACT_DAMPING_RATIO = 150.0, 0.3


def elasticity(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    twist, rate = _deflect(m, j, p["stiffness_Nm_rad"], p["damping_Nms_rad"], 0.0)
    return _felt(m, j, twist, rate)


def backlash(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """With and without the play, behind it the gear in contact."""
    stiffness = CONTACT_STIFFNESS * float(m.arm.rated[j])
    damping = 2.0 * CONTACT_DAMPING_RATIO * np.sqrt(stiffness * np.mean(_slopes(m, j)[2][:, j]))
    loose, tight = (_deflect(m, j, stiffness, float(damping), half) for half in (0.5 * p["gap_rad"], 0.0))
    return _felt(m, j, loose[0] - tight[0], loose[1] - tight[1])


def _slopes(m: MovingArm, j: int, step: float = 1e-5) -> tuple[Array, Array, Array]:
    """Derivatives of all joints' rigid torque by q, dq and ddq of one joint, each (T, n)."""
    unit = np.eye(m.q.shape[1])[j]
    up, down = (rigid_torque(m.arm, m.q + sign * step * unit, m.dq, m.ddq) for sign in (1.0, -1.0))
    fast, slow = (rigid_torque(m.arm, m.q, m.dq + sign * step * unit, m.ddq) for sign in (1.0, -1.0))
    inertia = rigid_torque(m.arm, m.q, m.dq, m.ddq + unit) - m.rigid
    return (up - down) / (2.0 * step), (fast - slow) / (2.0 * step), inertia


def _felt(m: MovingArm, j: int, twist: Array, rate: Array) -> Array:
    """What all joints feel of a deflection of one, −(M δ'' + V δ' + P δ)."""
    position, velocity, inertia = _slopes(m, j)
    change = np.gradient(rate, m.interval)
    return -(inertia * change[:, None] + velocity * rate[:, None] + position * twist[:, None])


def _deflect(m: MovingArm, j: int, stiffness: float, damping: float, half: float) -> tuple[Array, Array]:
    """Deflection δ of an elastic joint with play and its rate, by Newmark's method [rad, rad/s].

    M δ'' + V δ' + P δ + τ_gear(δ, δ') = τ_rigid; the gear pushes beyond ±half only.
    """
    interval = m.sampled("an elastic joint")
    steps = max(1, ceil(interval / LONGEST_STEP))
    position, velocity, inertia = (part[:, j] for part in _slopes(m, j))
    rows = np.stack([m.rigid[:, j], inertia, velocity, position], axis=1)
    at = np.linspace(0.0, len(rows) - 1, (len(rows) - 1) * steps + 1)
    fine = np.stack([np.interp(at, np.arange(len(rows)), column) for column in rows.T], axis=1).tolist()
    load, _, _, pull = fine[0]
    x = load / (stiffness + pull) + (copysign(half, load) if load else 0.0)
    v, a = (rows[1, 0] - rows[0, 0]) / (interval * stiffness), 0.0
    found = [(x, v)]
    for row in fine[1:]:
        x, v, a = _newmark(row, x, v, a, stiffness, damping, half, interval / steps)
        found.append((x, v))
    kept = np.array(found)[::steps]
    return kept[:, 0], kept[:, 1]


def _newmark(
    row: list[float], x: float, v: float, a: float, stiffness: float, damping: float, half: float, h: float
) -> tuple[float, float, float]:
    """One step; which flank bears is found by trial."""
    gamma, beta = 0.6, 0.3025
    force, mass, drag, pull = row
    x_ahead, v_ahead = x + h * v + h * h * (0.5 - beta) * a, v + h * (1.0 - gamma) * a
    side = 0.0 if abs(x_ahead) < half else copysign(1.0, x_ahead)
    for _ in range(4):
        touch = 1.0 if side != 0.0 or half == 0.0 else 0.0
        k, d = touch * stiffness + pull, touch * damping + drag
        push = force + touch * stiffness * side * half
        a = (push - k * x_ahead - d * v_ahead) / (mass + gamma * h * d + beta * h * h * k)
        x = x_ahead + beta * h * h * a
        found = 0.0 if abs(x) < half else copysign(1.0, x)
        if found == side or half == 0.0:
            break
        side = found
    return x, v_ahead + gamma * h * a, a
