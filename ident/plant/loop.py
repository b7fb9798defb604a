"""The closed loop, compiled: controller, friction, drives, heat and MuJoCo's step, tick after tick."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import njit

from ident.arrays import Array
from ident.plant.contact import Contact, push
from ident.plant.friction import FrictionLaw, bristle, sliding_level, viscous_drag
from ident.plant.native import call_step, step_address
from ident.plant.outside import OutsideLaw, outside_torque
from ident.plant.thermal import HeatLaw, warm_up
from ident.plant.transmission import DriveLaw, hose_torque, ripple_torque, spring_torque


class Engine(NamedTuple):
    """MuJoCo's model and data, as addresses and views."""

    function: int
    model: int
    data: int
    dt: float
    qpos: Array
    qvel: Array
    qacc: Array
    qfrc: Array
    xfrc: Array
    xpos: Array
    xmat: Array
    xipos: Array


class Laws(NamedTuple):
    """All that acts on the joints."""

    friction: FrictionLaw
    drive: DriveLaw
    heat: HeatLaw
    outside: OutsideLaw
    contact: Contact


class Control(NamedTuple):
    """Joint controller: feed-forward plus PD on the motor encoders.

    Attributes:
        stiffness, damping: Gains [N m/rad], [N m s/rad], shape (n,).
        limit: Torque limit [N m], shape (n,).
        smoothing: Share of a new velocity estimate that the filter takes at each tick.
        resolution: Of the encoders at the joint [rad], shape (n,).
        offset: What the encoders read at zero [rad], shape (n,).
        substeps: Steps of the simulation in a tick.
    """

    stiffness: Array
    damping: Array
    limit: Array
    smoothing: float
    resolution: Array
    offset: Array
    substeps: int


class State(NamedTuple):
    """What the plant remembers beside MuJoCo's state; arrays of shape (n,), heat (n, 2), scratch (3, n)."""

    bent: Array
    bent_soft: Array
    bent_coupled: Array
    motor_angle: Array
    motor_speed: Array
    transmitted: Array
    acceleration: Array
    heat: Array
    reading: Array
    speed_estimate: Array
    torque: Array
    scratch: Array


class Log(NamedTuple):
    """What is recorded at each of K ticks; arrays of shape (K, n)."""

    angle: Array
    speed: Array
    speed_estimate: Array
    torque: Array
    link_angle: Array
    temperature: Array


def engine(model: Any, data: Any) -> Engine:
    """Addresses and views of a MuJoCo model and its data, which must outlive it."""
    return Engine(
        step_address(),
        model._address,
        data._address,
        float(model.opt.timestep),
        data.qpos,
        data.qvel,
        data.qacc,
        data.qfrc_applied,
        data.xfrc_applied,
        data.xpos,
        data.xmat,
        data.xipos,
    )


def fresh_state(n: int) -> State:
    """Bristles straight, everything at rest and at ambient temperature."""
    shapes = {"heat": (n, 2), "scratch": (3, n)}
    return State(**{name: np.zeros(shapes.get(name, (n,))) for name in State._fields})


def fresh_log(ticks: int, n: int) -> Log:
    return Log(*(np.zeros((ticks, n)) for _ in Log._fields))


@njit(cache=True)
def friction_torque(law: FrictionLaw, state: State, speed: Array, j: int, angle: float, dt: float) -> float:
    """Torque of all friction in joint j's drive, against its motion [N m]; bends the bristles."""
    v, warm = speed[j], state.heat[j, 0]
    level = sliding_level(law, j, v, angle, state.transmitted[j], state.acceleration[j], warm)
    state.bent[j], torque = bristle(state.bent[j], v, level, law.bristle_stiffness[j], law.bristle_damping[j], dt)
    if law.soft[j] != 0.0:
        state.bent_soft[j], more = bristle(state.bent_soft[j], v, law.soft[j], law.soft_stiffness[j], 0.0, dt)
        torque += more
    return torque + viscous_drag(law, j, v, warm)


@njit(cache=True)
def coupled_torque(law: FrictionLaw, state: State, speed: Array, j: int, dt: float) -> float:
    """Friction in the motion of a motor that two joints turn [N m]."""
    both = speed[j] + law.couple_ratio[j] * speed[law.couple_to[j]]
    level = max(law.couple_coulomb[j], 1e-6)
    stiffness = law.bristle_stiffness[j] * min(level / law.coulomb[j], 1.0)
    damping = 0.5 * law.bristle_damping[j]
    state.bent_coupled[j], torque = bristle(state.bent_coupled[j], both, level, stiffness, damping, dt)
    return torque + law.couple_viscous[j] * both


@njit(cache=True)
def motor_motion(engine: Engine, laws: Laws, state: State) -> None:
    """Takes over the motors' angle and speed from the links where the two are one body."""
    for j in range(len(state.torque)):
        if not laws.drive.elastic[j]:
            state.motor_angle[j] = engine.qpos[j]
            state.motor_speed[j] = engine.qvel[j]


@njit(cache=True)
def advance(engine: Engine, laws: Laws, state: State, elapsed: float) -> None:
    """One step of the plant under the motor torques in `state.torque`."""
    n, dt, drive = len(state.torque), engine.dt, laws.drive
    motor, link, spring, elastic = state.scratch[0], state.scratch[1], state.scratch[2], drive.elastic
    motor_motion(engine, laws, state)
    motor[:] = state.torque
    for j in range(n):
        rubbing = friction_torque(laws.friction, state, state.motor_speed, j, state.motor_angle[j], dt)
        motor[j] -= rubbing + ripple_torque(drive, j, state.motor_angle[j], state.transmitted[j])
        link[j] = hose_torque(drive, j, engine.qpos[j])
        link[j] += outside_torque(laws.outside, j, engine.qpos, engine.qvel, elapsed)
        loss = max(rubbing * state.motor_speed[j], 0.0) + laws.heat.copper[j] * state.torque[j] ** 2
        warm_up(laws.heat, state.heat, j, loss, dt)
    for j in range(n):
        if laws.friction.couple_to[j] >= 0:
            shared = coupled_torque(laws.friction, state, state.motor_speed, j, dt)
            motor[j] -= shared
            motor[laws.friction.couple_to[j]] -= laws.friction.couple_ratio[j] * shared
    for j in range(n):
        if elastic[j]:
            twist = state.motor_angle[j] - engine.qpos[j]
            spring[j] = spring_torque(drive, j, twist, state.motor_speed[j] - engine.qvel[j])
            engine.qfrc[j] = spring[j] + link[j]
        else:
            engine.qfrc[j] = motor[j] + link[j]
    if laws.contact.body > 0:
        push(laws.contact, elapsed, engine.xpos, engine.xmat, engine.xipos, engine.xfrc)
    call_step(engine.function, engine.model, engine.data)  # type: ignore[call-arg]
    for j in range(n):
        if elastic[j]:
            before = state.motor_speed[j]
            state.motor_speed[j] += dt * (motor[j] - spring[j]) / drive.rotor_inertia[j]
            state.motor_angle[j] += dt * state.motor_speed[j]
            rate, carried = (state.motor_speed[j] - before) / dt, spring[j]
        else:
            rate = engine.qacc[j]
            carried = motor[j] - drive.rotor_inertia[j] * rate
        # The mesh and the balls feel load and acceleration over a few milliseconds, not step by step.
        state.transmitted[j] += min(dt / 2e-3, 1.0) * (carried - state.transmitted[j])
        state.acceleration[j] += min(dt / 5e-3, 1.0) * (rate - state.acceleration[j])


@njit(cache=True)
def command(control: Control, state: State, q: Array, dq: Array, feed: Array, noise: Array, tick: float) -> None:
    """Reads the encoders and sets the motor torques [N m]."""
    for j in range(len(state.torque)):
        count = control.resolution[j]
        reading = np.round((state.motor_angle[j] + control.offset[j]) / count + noise[j]) * count
        rate = (reading - state.reading[j]) / tick
        state.reading[j] = reading
        state.speed_estimate[j] += control.smoothing * (rate - state.speed_estimate[j])
        torque = feed[j] + control.stiffness[j] * (q[j] - reading)
        torque += control.damping[j] * (dq[j] - state.speed_estimate[j])
        state.torque[j] = min(max(torque, -control.limit[j]), control.limit[j])


@njit(cache=True)
def run_loop(
    engine: Engine,
    laws: Laws,
    control: Control,
    state: State,
    q: Array,
    dq: Array,
    feed: Array,
    noise: Array,
    start: float,
    log: Log,
) -> None:
    """Follows a reference from tick to tick.

    Args:
        engine, laws, control: The plant and its controller.
        state: Advanced in place.
        q, dq, feed: Reference position, velocity and feed-forward torque at K ticks, shape (K, n).
        noise: Encoder noise in counts, shape (K, n).
        start: Time of the first tick since the run began [s]; negative while the arm settles.
        log: Filled in place.
    """
    tick = engine.dt * control.substeps
    n = q.shape[1]
    for k in range(q.shape[0]):
        motor_motion(engine, laws, state)
        if k == 0:
            for j in range(n):
                state.reading[j] = state.motor_angle[j] + control.offset[j]
        before = state.torque.copy()
        command(control, state, q[k], dq[k], feed[k], noise[k], tick)
        for j in range(n):
            log.angle[k, j] = state.motor_angle[j]
            log.speed[k, j] = state.motor_speed[j]
            log.speed_estimate[k, j] = state.speed_estimate[j]
            # The drive reports the mean of the current before and after the instant: no delay of its own.
            log.torque[k, j] = state.torque[j] if k == 0 else 0.5 * (before[j] + state.torque[j])
            log.link_angle[k, j] = engine.qpos[j]
            log.temperature[k, j] = state.heat[j, 1]
        for i in range(control.substeps):
            advance(engine, laws, state, start + k * tick + i * engine.dt)


def check_finite(log: Log, data: Any) -> bool:
    """Whether the simulation stayed finite."""
    warned = data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number > 0
    return not warned and bool(np.isfinite(log.angle).all() and np.isfinite(log.torque).all())
