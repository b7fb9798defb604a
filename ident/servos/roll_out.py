"""A servo as a law that rolls out: from the goals alone to where the joint will be.

    J q̈ = T − B q̇ − friction − g(q)
    T = limit · sat((K (u(t − d) ∓ half the dead band − q) − E q̇) / limit)
    |friction| ≤ F + L |transmitted|
    transmitted = (J_load T + J_rotor g) / J,   J = J_load + J_rotor

K is the stiffness at a session's gain, E what the motor's own voltage takes off with speed, limit
the torque of a standing servo at full duty; where a joint is let go T is zero. g is exact along the
joint's own angle, A cos q + B sin q, with all other joints where they were measured. Gears are
pressed by what passes through them, T − J_rotor q̈: all of T where it holds a load, and of a load
that falls only what its rotor's inertia takes. Friction grows with that, and is larger by a share
until motion sets in. Dry friction holds what it can: a step of the simulation takes speed off until
none is left.

All parameters are found together by the mean absolute error of free roll-outs, which start where
the joint was and see nothing but goals.

Source: Duclusaud, Passault, Padois and Ly 2025 (extended friction models for servo actuators).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ident.arrays import Array, Bool, Float
from ident.compiled import compiled

# Longest step of a simulation [s].
STEP_S = 0.001
# Names and first guesses of what all sessions share, and how far each may go from it, as a factor
# either way.
SHARED = {
    "inertia_kgm2": 2e-3,
    "viscous_Nms_rad": 4e-3,
    "back_emf_Nms_rad": 4e-2,
    "friction_Nm": 2e-2,
    "load_friction": 2e-1,
    "limit_Nm": 1.0,
    "delay_s": 1e-2,
    "dead_band_rad": 5e-3,
    "static_share": 0.2,
    "stribeck_rad_s": 0.1,
}
# Evaluations of a search, and how many searches begin where the last one ended.
EVALUATIONS = 1500
ROUNDS = 3
# What a parameter e times its first guess costs [rad]: settles what recordings can't part, as
# damping by the motor's voltage and by grease.
PRIOR = 1e-4
# Stiffness that each session is first tried with [N m/rad]: hobby servos at low and high gains.
STIFFNESSES = (0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6, 51.2)


@dataclass(frozen=True, eq=False)
class Drive:
    """One run of one joint: what it was told, what it carried, where it was."""

    name: str
    session: int  # number of the session, of which each has a stiffness of its own
    time: Float[Array, " T"]  # [s]
    goal: Float[Array, " T"]  # [rad]
    position: Float[Array, " T"]  # measured [rad]
    driven: Bool[Array, " T"]  # whether the motor holds it
    inertia: float  # of what it carries, without its rotor [kg m²]
    cosine: Float[Array, " T"]  # gravity's torque is cosine · cos q + sine · sin q [N m]
    sine: Float[Array, " T"]


@dataclass(frozen=True)
class ServoModel:
    """A servo's parameters."""

    shared: dict[str, float]  # as `SHARED`
    stiffness: tuple[float, ...]  # of each session [N m/rad]
    offset: float  # of its zero [rad]

    def roll_out(self, drive: Drive) -> Float[Array, " T"]:
        """Where the joint goes, from where it was, by goals alone [rad]."""
        out = np.empty(len(drive.time))
        numbers = np.array([self.shared[name] for name in SHARED])
        _simulate(
            drive.time,
            drive.goal,
            drive.driven,
            drive.cosine,
            drive.sine,
            drive.inertia,
            float(drive.position[0]),
            self.stiffness[drive.session],
            self.offset,
            numbers,
            STEP_S,
            out,
        )
        return out

    def error(self, drives: Sequence[Drive]) -> float:
        """Mean absolute error of free roll-outs, run by run alike [rad]."""
        errors = [float(np.mean(np.abs(self.roll_out(drive) - drive.position))) for drive in drives]
        return float(np.mean(errors))


@compiled(error_model="numpy", nogil=True)
def _simulate(
    time: Array,
    goal: Array,
    driven: Array,
    cosine: Array,
    sine: Array,
    inertia: float,
    start: float,
    stiffness: float,
    offset: float,
    numbers: Array,
    longest: float,
    out: Array,
) -> None:
    """Semi-implicit steps; goals are held until the next one, and act a delay later."""
    whole = inertia + numbers[0]
    viscous, back, dry, by_load, limit, delay, band, static, knee = numbers[1:]
    q = start
    v = 0.0
    out[0] = q
    told = 0
    for t in range(1, len(time)):
        span = time[t] - time[t - 1]
        steps = max(1, int(np.ceil(span / longest)))
        h = span / steps
        for s in range(steps):
            now = time[t - 1] + s * h - delay
            while told + 1 < len(time) and time[told + 1] <= now:
                told += 1
            torque = 0.0
            if driven[told]:
                away = goal[told] + offset - q
                if away > band:
                    away -= band
                elif away < -band:
                    away += band
                else:
                    away = 0.0
                duty = min(max(stiffness * away, -limit), limit)
                torque = duty - back * v
            weight = cosine[t] * np.cos(q) + sine[t] * np.sin(q)
            push = torque - weight
            free = v + h * push / whole
            free /= 1.0 + h * viscous / whole
            more = 1.0 + static * np.exp(-((v / knee) ** 2))
            transmitted = (inertia * torque + numbers[0] * weight) / whole
            held = h * more * (dry + by_load * abs(transmitted)) / whole
            if free > held:
                v = free - held
            elif free < -held:
                v = free + held
            else:
                v = 0.0
            q += h * v
        out[t] = q


def guess_stiffness(drives: Sequence[Drive]) -> list[float]:
    """For each session the stiffness with which its roll-outs are best, all else first guesses."""
    sessions = 1 + max(drive.session for drive in drives)
    shared = dict(SHARED)
    best = [STIFFNESSES[0]] * sessions
    least = [np.inf] * sessions
    for stiffness in STIFFNESSES:
        model = ServoModel(shared, (stiffness,) * sessions, 0.0)
        for session in range(sessions):
            error = model.error([drive for drive in drives if drive.session == session])
            if error < least[session]:
                least[session] = error
                best[session] = stiffness
    return best


def fit_servo(
    drives: Sequence[Drive], guesses: Sequence[float] = (), rounds: int = ROUNDS
) -> ServoModel:
    """The parameters whose free roll-outs are nearest to the measured positions.

    Args:
        drives: Runs of one joint.
        guesses: Stiffness of each session to begin with [N m/rad].
        rounds: How many searches begin where the last one ended.
    """
    first = list(guesses) or guess_stiffness(drives)
    start = np.log([*SHARED.values(), *first])

    def model(x: Array) -> ServoModel:
        numbers = np.exp(np.clip(x[:-1], -20.0, 8.0))
        shared = dict(zip(SHARED, map(float, numbers), strict=False))
        return ServoModel(shared, tuple(map(float, numbers[len(SHARED) :])), float(x[-1]))

    def error(x: Array) -> float:
        stray = PRIOR * float(np.mean((x[:-1] - start) ** 2))
        cost = model(x).error(drives) + stray
        return cost if np.isfinite(cost) else 1e6

    best = np.append(start, 0.0)
    for _ in range(rounds):
        steps = np.diag(np.append(np.full(len(start), 0.5), 0.02))
        simplex = np.stack([best, *(best + step for step in steps)])
        options = {
            "maxfev": EVALUATIONS,
            "initial_simplex": simplex,
            "xatol": 1e-3,
            "fatol": 1e-6,
            "adaptive": True,
        }
        best = minimize(error, best, method="Nelder-Mead", options=options).x
    return model(best)
