"""Laws with a memory against their equations, solved in another way over random figures."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array
from ident.export.python import describe_arm
from ident.laws.acting import Effect, acting_torque, read_log
from ident.laws.elastic import CONTACT_DAMPING_RATIO, CONTACT_STIFFNESS
from ident.laws.motion import Losses, MovingArm
from ident.robot.arm import ArmModel

N, J, V0 = 6, 2, 0.01
VISCOUS, COULOMB = np.arange(1.0, 7.0), np.arange(2.0, 8.0)


def test_gears_give_way_as_their_equation_says() -> None:
    """Law: over 50 springs and plays a module's torque is that of M δ'' + V δ' + P δ + τ_gear = τ, solved otherwise.

    Runge and Kutta's method at a tenth of the sampling interval, all gears side by side.
    """
    arm, rng, interval, finer = ArmModel.load("tm5-900"), np.random.default_rng(4), 0.002, 8
    time = np.arange(1000)[:, None] * interval
    size, pulse = rng.uniform(0.05, 0.4, N), rng.uniform(3.0, 12.0, N)
    q, dq, ddq = (
        size * np.sin(pulse * time),
        size * pulse * np.cos(pulse * time),
        -size * pulse**2 * np.sin(pulse * time),
    )
    losses = Losses(np.zeros(N), VISCOUS, COULOMB, np.full(N, V0), np.zeros(N))
    motion = MovingArm(describe_arm(arm), losses, q, dq, ddq, interval)
    position, velocity, inertia = arm.derivatives(q, dq, ddq)
    load, p, v, m = motion.rigid[:, J], position[:, J, J], velocity[:, J, J], inertia[:, J, J]
    stiff = np.concatenate(
        [np.exp(rng.uniform(np.log(3e3), np.log(3e4), 25)), np.full(25, CONTACT_STIFFNESS * arm.effort_limit[J])]
    )
    damping = np.concatenate(
        [rng.uniform(20.0, 80.0, 25), np.full(25, 2.0 * CONTACT_DAMPING_RATIO * np.sqrt(stiff[-1] * m.mean()))]
    )
    half = np.concatenate([np.zeros(25), rng.uniform(2e-4, 2e-3, 25)])

    def solve(gap: Array) -> Array:
        def change(at: float, x: Array, rate: Array) -> Array:
            k = min(int(at), len(load) - 2)
            here = [one[k] + (at - k) * (one[k + 1] - one[k]) for one in (load, p, v, m)]
            beyond = np.sign(x) * np.maximum(np.abs(x) - gap, 0.0)
            gear = stiff * beyond + damping * rate * ((np.abs(x) > gap) | (gap == 0.0))
            return (here[0] - here[1] * x - here[2] * rate - gear) / here[3]

        h, states = 1.0 / finer, []
        x, rate = load[0] / (stiff + p[0]) + gap * np.sign(load[0]), (load[1] - load[0]) / (interval * stiff)
        s = interval
        for step in range(finer * (len(load) - 1) + 1):
            if step % finer == 0:
                states.append((x, rate))
            t, d = step * h, h * s
            a1 = change(t, x, rate)
            a2 = change(t + h / 2, x + d / 2 * rate, rate + d / 2 * a1)
            a3 = change(t + h / 2, x + d / 2 * (rate + d / 2 * a1), rate + d / 2 * a2)
            a4 = change(t + h, x + d * (rate + d / 2 * a2), rate + d * a3)
            x, rate = x + d * (rate + d / 6 * (a1 + a2 + a3)), rate + d / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return np.moveaxis(np.array(states), 0, 1)  # (2, T, gears)

    loose, tight = solve(half), solve(np.zeros(50))
    x = np.concatenate([loose[0][:, :25], (loose[0] - tight[0])[:, 25:]], axis=1)
    rate = np.concatenate([loose[1][:, :25], (loose[1] - tight[1])[:, 25:]], axis=1)
    felt = -(m[:, None] * np.gradient(rate, interval, axis=0) + v[:, None] * rate + p[:, None] * x)
    springs = zip(stiff[:25], damping[:25], strict=True)
    laws: list[Effect] = [
        *(("joint_elasticity", J, {"stiffness_Nm_rad": k, "damping_Nms_rad": d}) for k, d in springs),
        *(("backlash", J, {"gap_rad": 2.0 * gap}) for gap in half[25:]),
    ]
    found = np.stack([acting_torque([law], motion)[:, J] for law in laws], axis=1)
    off = np.linalg.norm(found - felt, axis=0) / np.linalg.norm(felt, axis=0)
    assert off[:25].max() < 0.01
    assert off[25:].max() < 0.08  # a knock is over within samples


def test_a_late_log_is_the_signal_moved() -> None:
    """Law: over 50 delays a log of torque below a tenth of the rate is the signal itself at an earlier time."""
    rng, interval = np.random.default_rng(6), 0.004
    time, pulse, phase = np.arange(500) * interval, rng.uniform(1.0, 60.0, 8), rng.uniform(0.0, 6.0, 8)
    for delay in rng.uniform(5e-4, 0.04, 50):
        torque, wanted = (np.sin(pulse * (time - late)[:, None] + phase).sum(axis=1) for late in (0.0, delay))
        found = read_log([("torque_delay", -1, {"delay_s": delay})], torque[:, None], interval)[20:-20, 0]
        assert np.linalg.norm(found - wanted[20:-20]) < 0.01 * np.linalg.norm((wanted - torque)[20:-20])
