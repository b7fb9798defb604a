"""Laws of gears that give way: an elastic joint, and one with play.

The position is the motor's; the link lags by a deflection δ that follows from the arm's own inverse
dynamics,

    M δ'' + V δ' + P δ + τ_gear(δ, δ') = τ_rigid,

M, V, P the derivatives of the rigid torque by acceleration, velocity and position of the joint.
That is linear in small deflections; of a soft spring the equation is made linear anew about the
deflection found before, until it is that of the link itself, `τ_rigid(q − δ) = τ_gear`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np

from ident.laws.motion import Array, MovingArm, rigid_torque

# An elastic joint is integrated with steps no longer than this [s], and than so much of its own
# swing [rad]; its equation is made linear anew so often at most, until its deflection changes by
# less [rad].
LONGEST_STEP = 0.001
LONGEST_TURN = 0.1
LINEAR_ROUNDS = 20
LINEAR_ENOUGH = 1e-5
# Gear in contact behind its play: stiffness in rated torques a radian, and damping ratio.
CONTACT_STIFFNESS = 150.0
CONTACT_DAMPING_RATIO = 0.3


def elasticity(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Torque that a spring and a damper between motor and link add at all joints, shape (T, n) [N
    m].

    Args:
        m: The run.
        j: Index of the joint.
        p: `stiffness_Nm_rad` and `damping_Nms_rad`.
    """
    stiffness = p["stiffness_Nm_rad"]
    damping = p["damping_Nms_rad"]
    unit = np.eye(m.q.shape[1])[j]
    twist = np.zeros((3, len(m.q)))
    link = m
    for _ in range(LINEAR_ROUNDS):
        slopes = [slope[:, j] for slope in _slopes(link, j)]
        by_position, by_velocity, inertia = slopes
        load = link.rigid[:, j] + _linear(slopes, twist)
        before = twist
        twist = _deflect(m, j, load, slopes, (stiffness, damping, 0.0))
        pull = (by_position + stiffness) * twist[0]
        drag = (by_velocity + damping) * twist[1]
        twist[2] = (load - pull - drag) / inertia
        q = m.q - twist[0][:, None] * unit
        dq = m.dq - twist[1][:, None] * unit
        ddq = m.ddq - twist[2][:, None] * unit
        link = MovingArm(m.arm, m.losses, q, dq, ddq, m.interval)
        if np.abs(twist[0] - before[0]).max() < LINEAR_ENOUGH:
            break
    return link.rigid - m.rigid


def _linear(slopes: Sequence[Array], deflection: Array) -> Array:
    """Torque of a deflection, its rate and its acceleration, to first order [N m]."""
    by_position, by_velocity, inertia = slopes
    twist, rate, acceleration = deflection
    return by_position * twist + by_velocity * rate + inertia * acceleration


def backlash(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Torque that play in a gear adds at all joints, shape (T, n) [N m].

    The gear is deflected with and without the play; behind it is the gear in contact, its stiffness
    and damping, where they are known.

    Args:
        m: The run.
        j: Index of the joint.
        p: `gap_rad` (full width), and where they are known `stiffness_Nm_rad`, `damping_Nms_rad`.
    """
    slopes = _slopes(m, j)
    stiffness = p.get("stiffness_Nm_rad", CONTACT_STIFFNESS * float(m.arm.rated[j]))
    of_joint = [slope[:, j] for slope in slopes]
    damping = p.get("damping_Nms_rad")
    if not damping:
        critical = float(np.sqrt(stiffness * np.mean(of_joint[2])))
        damping = 2.0 * CONTACT_DAMPING_RATIO * critical
    load = m.rigid[:, j]
    loose = _deflect(m, j, load, of_joint, (stiffness, damping, 0.5 * p["gap_rad"]))
    tight = _deflect(m, j, load, of_joint, (stiffness, damping, 0.0))
    play = loose - tight
    return -_linear(slopes, play[:, :, None])


def _slopes(m: MovingArm, j: int, step: float = 1e-5) -> tuple[Array, Array, Array]:
    """Derivatives of all joints' rigid torque by q, dq and ddq of one joint, each (T, n)."""
    unit = np.eye(m.q.shape[1])[j]
    ahead = rigid_torque(m.arm, m.q + step * unit, m.dq, m.ddq)
    behind = rigid_torque(m.arm, m.q - step * unit, m.dq, m.ddq)
    fast = rigid_torque(m.arm, m.q, m.dq + step * unit, m.ddq)
    slow = rigid_torque(m.arm, m.q, m.dq - step * unit, m.ddq)
    by_position = (ahead - behind) / (2.0 * step)
    by_velocity = (fast - slow) / (2.0 * step)
    inertia = rigid_torque(m.arm, m.q, m.dq, m.ddq + unit) - m.rigid
    return by_position, by_velocity, inertia


def _deflect(
    m: MovingArm, j: int, load: Array, slopes: list[Array], gear: tuple[float, float, float]
) -> Array:
    """Deflection of an elastic joint with play under a load, its rate, at first the load's, and its
    acceleration.
    """
    interval = m.sampled("an elastic joint")
    stiffness = gear[0]
    by_position, by_velocity, inertia = slopes
    swing = float(np.sqrt(stiffness / np.mean(inertia)))
    step = min(LONGEST_STEP, LONGEST_TURN / swing)
    gained = float(m.rigid[1, j] - m.rigid[0, j])
    twist = [0.0] * len(load)
    rate = [gained / (interval * stiffness)] * len(load)
    signals = [signal.tolist() for signal in (load, inertia, by_velocity, by_position)]
    integrate_twist(signals, gear, interval, max(1, ceil(interval / step)), [twist, rate])
    return np.array([twist, rate, np.gradient(rate, interval)])


def integrate_twist(signals, gear, interval, steps, deflection):  # type: ignore[no-untyped-def]
    """Newmark's method, in balance at first; the gear pushes only beyond ±half, and damps only
    there.

    Signals are the load, then M, V and P; the gear is its stiffness, its damping and half its play;
    `deflection` takes the deflection and its rate, which holds the first. All are sequences of
    numbers; the diagnosis compiles this.
    """
    load = signals[0]
    inertia = signals[1]
    velocity = signals[2]
    position = signals[3]
    stiffness = gear[0]
    damping = gear[1]
    half = gear[2]
    twist = deflection[0]
    rate = deflection[1]
    gamma = 0.5
    beta = 0.25
    h = interval / steps
    x = load[0] / (stiffness + position[0]) + half * ((load[0] > 0.0) - (load[0] < 0.0))
    v = rate[0]
    twist[0] = x
    a = -(damping + velocity[0]) * v / inertia[0]
    for k in range(1, len(load)):
        for step in range(1, steps + 1):
            w = step / steps
            force = load[k - 1] + w * (load[k] - load[k - 1])
            mass = inertia[k - 1] + w * (inertia[k] - inertia[k - 1])
            drag = velocity[k - 1] + w * (velocity[k] - velocity[k - 1])
            pull = position[k - 1] + w * (position[k] - position[k - 1])
            x_ahead = x + h * v + h * h * (0.5 - beta) * a
            v_ahead = v + h * (1.0 - gamma) * a
            side = 0.0 if abs(x_ahead) < half else (1.0 if x_ahead > 0.0 else -1.0)
            for _ in range(4):
                touch = 1.0 if (side != 0.0 or half == 0.0) else 0.0
                k_all = touch * stiffness + pull
                d_all = touch * damping + drag
                pushed = force + touch * stiffness * side * half
                effective = mass + gamma * h * d_all + beta * h * h * k_all
                a = (pushed - k_all * x_ahead - d_all * v_ahead) / effective
                x = x_ahead + beta * h * h * a
                flank = 0.0 if abs(x) < half else (1.0 if x > 0.0 else -1.0)
                if flank == side or half == 0.0:
                    break
                side = flank
            v = v_ahead + gamma * h * a
        twist[k] = x
        rate[k] = v
