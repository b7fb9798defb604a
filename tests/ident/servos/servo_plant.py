"""A hobby servo stepped through time, by other code than the estimator's: proportional controller, friction that holds.

Semi-implicit Euler at 10 kHz; dry friction sticks where it can bear what pulls (Karnopp 1985), so that the dead band
comes from it by itself. Goals are held from sample to sample and act late by whole steps; the log rounds to counts.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel

STEP = 1e-4
COUNT = 2.0 * np.pi / 4096.0
MASS, LEVER, GRAVITY = 0.3, 0.25, 9.81


@dataclass(frozen=True)
class Servo:
    """What a servo really is."""

    gain: float = 8.0  # [N m/rad]
    inertia: float = 0.03  # [kg m²]
    damping: float = 0.6  # [N m s/rad]
    friction: float = 0.12  # [N m]
    delay: float = 0.024  # [s]
    zero: float = 0.01  # [rad]
    load: float = MASS * GRAVITY * LEVER  # [N m]
    noise: float = 0.0  # of its sensor [rad]


def one_link(axis: str = "0 1 0") -> ArmModel:
    """A mass at the end of a lever that turns about an axis."""
    return ArmModel.from_urdf(
        f"""<robot name="lever"><link name="base"/><link name="lever"><inertial><origin xyz="{LEVER} 0 0"/>
        <mass value="{MASS}"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial></link>
        <joint name="shoulder" type="revolute"><parent link="base"/><child link="lever"/><axis xyz="{axis}"/>
        <limit lower="-2" upper="2" effort="5" velocity="6"/></joint></robot>"""
    )


@njit(cache=True)
def _run(goal: np.ndarray, hold: int, late: int, figures: np.ndarray, steps: int) -> np.ndarray:
    gain, inertia, damping, friction, zero, load = figures
    angle, speed = goal[0], 0.0
    out = np.empty(steps)
    for k in range(steps):
        out[k] = angle
        asked = goal[min(max(k - late, 0) // hold, len(goal) - 1)]
        # Lifting the mass against the turn about +y takes -m g l cos(q).
        pull = gain * (asked - zero - angle) + load * np.cos(angle) - damping * speed
        if abs(speed) < 1e-4 and abs(pull) <= friction:
            speed = 0.0
            continue
        way = np.sign(speed) if abs(speed) >= 1e-4 else np.sign(pull)
        new = speed + STEP / inertia * (pull - friction * way)
        # Friction stops, it does not turn round.
        speed = 0.0 if speed * new < 0.0 and abs(pull) <= friction else new
        angle += STEP * speed
    return out


def record(
    servo: Servo, seed: int, seconds: float = 20.0, rate: float = 50.0, quick: bool = True, ramped: bool = False
) -> Recording:
    """One run: goals as a hand would lead them, or in ramps of one speed, and the positions that came."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    goal = (in_ramps(rng) if ramped else hand_led(rng, quick))(time)
    hold = round(1.0 / rate / STEP)
    steps = len(time) * hold
    figures = np.array([servo.gain, servo.inertia, servo.damping, servo.friction, servo.zero, servo.load])
    angle = _run(goal, hold, round(servo.delay / STEP), figures, steps)[::hold]
    measured = np.round((angle + servo.noise * rng.standard_normal(len(angle))) / COUNT) * COUNT
    empty = np.zeros((len(time), 1))
    return Recording(f"run_{seed}", ("shoulder",), time, measured[:, None], empty, position_command=goal[:, None])


def hand_led(rng: np.random.Generator, quick: bool) -> Callable[[np.ndarray], np.ndarray]:
    """A few swings of unlike length and reach, the longest about a radian; or that one alone."""
    hertz = rng.uniform([0.08, 0.2, 0.5, 1.0], [0.12, 0.35, 0.8, 1.6])
    reach = rng.uniform([0.6, 0.2, 0.05, 0.02], [0.9, 0.4, 0.12, 0.05]) * (1.0 if quick else np.eye(4)[0])
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    return lambda t: np.sin(2.0 * np.pi * np.outer(t, hertz) + phase) @ reach


def in_ramps(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Ramps of one speed from place to place, each held for a while, as a program of moves."""
    places = rng.uniform(-0.7, 0.7, 200)
    holds = rng.uniform(0.3, 0.9, 200)
    ramps = np.abs(np.diff(places, prepend=places[0])) / 1.2
    ends = np.cumsum(ramps + holds)
    stamps = np.column_stack([ends - holds, ends]).ravel()
    return lambda t: np.interp(t, stamps, np.repeat(places, 2))
