"""The closed loop, compiled: controller, friction, drives, heat and MuJoCo's step, tick after tick.

MuJoCo's step is a C call from the compiled loop: a Python call a step would cost more than the
dynamics.
"""

from __future__ import annotations

import ctypes
from collections import namedtuple
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ident.arrays import Array
from ident.compiled import compiled
from ident.simulation.laws import (
    COLUMNS,
    Contact,
    bristle,
    hose_torque,
    outside_torque,
    push,
    remembered_torque,
    ripple_torque,
    sliding_level,
    spring_torque,
    viscous_drag,
    warm_up,
)

STATE = np.dtype([(name, float) for name in COLUMNS["state"]])
"""What the plant remembers of each joint, beside MuJoCo's state."""


@cache
def step_address() -> int:
    """Address of `mj_step(const mjModel*, mjData*)` in the library that the mujoco package has
    loaded.
    """
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    library = next(path for name in names for path in sorted(folder.glob(name)))
    address = ctypes.cast(ctypes.CDLL(str(library)).mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


@intrinsic
def call_step(_context: Any, function: Any, model: Any, data: Any) -> Any:
    """Calls the function at an address with two pointers.

    Addresses are arguments, not constants, so that compiled code may be cached from process to
    process.
    """
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        target = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(argument, pointer) for argument in arguments[1:]])
        return context.get_dummy_value()

    return signature, generate


Engine = namedtuple(
    "Engine", "function model data dt qpos qvel qacc qfrc_applied xfrc_applied xpos xmat xipos"
)
"""MuJoCo's model and data, as addresses and views."""


class Laws(NamedTuple):
    """All that acts on the joints: tables with one record a joint, and the push from outside."""

    friction: Array
    drive: Array
    heat: Array
    outside: Array
    contact: Contact


class TickLog(NamedTuple):
    """What is recorded at each of K ticks; arrays of shape (K, n)."""

    angle: Array
    speed: Array
    speed_estimate: Array
    torque: Array
    link_angle: Array
    temperature: Array


def engine(model: mujoco.MjModel, data: mujoco.MjData) -> Engine:
    """Addresses and views of a MuJoCo model and its data, which must outlive it."""
    addresses = step_address(), model._address, data._address
    return Engine(
        *addresses, float(model.opt.timestep), *(getattr(data, name) for name in Engine._fields[4:])
    )


def fresh_state(n: int) -> Array:
    """Bristles straight, everything at rest and at ambient temperature."""
    return np.zeros(n, dtype=STATE)


def fresh_log(ticks: int, n: int) -> TickLog:
    """An empty log of so many ticks and joints."""
    return TickLog(*(np.zeros((ticks, n)) for _ in TickLog._fields))


@compiled()
def friction_torque(joint: np.record, state: np.record, dt: float) -> float:
    """Torque of all friction in a joint's drive, against its motion [N m]; bends the bristles."""
    v = state.motor_speed
    warm = state.lubricant_rise
    level = sliding_level(joint, v, state.motor_angle, state.transmitted, state.acceleration, warm)
    state.bent, torque = bristle(
        state.bent, v, level, joint.bristle_stiffness, joint.bristle_damping, dt
    )
    if joint.soft != 0.0:
        state.bent_soft, more = bristle(
            state.bent_soft, v, joint.soft, joint.soft_stiffness, 0.0, dt
        )
        torque += more
    return torque + viscous_drag(joint, v, warm)


@compiled()
def coupled_torque(joint: np.record, state: np.record, other_speed: float, dt: float) -> float:
    """Friction in the motion of a motor that two joints turn [N m]."""
    both = state.motor_speed + joint.couple_ratio * other_speed
    level = max(joint.couple_coulomb, 1e-6)
    stiffness = joint.bristle_stiffness * min(level / max(joint.coulomb, 1e-9), 1.0)
    damping = 0.5 * joint.bristle_damping
    state.bent_coupled, torque = bristle(state.bent_coupled, both, level, stiffness, damping, dt)
    return torque + joint.couple_viscous * both


@compiled()
def motor_motion(engine: Engine, drive: Array, state: Array) -> None:
    """Writes the links' angle [rad] and speed [rad/s] into the motors' state.

    Where motor and link are one body; elastic joints keep their own.

    Args:
        engine: Where the links are.
        drive: Laws of each joint's drive.
        state: Each joint's, which is written.
    """
    for j in range(len(state)):
        if not drive[j].elastic:
            state[j].motor_angle = engine.qpos[j]
            state[j].motor_speed = engine.qvel[j]


@compiled()
def apply_torques(engine: Engine, laws: Laws, state: Array, elapsed: float) -> None:
    """Works out all torques of a step and hands MuJoCo those on the links."""
    n = len(state)
    dt = engine.dt
    for j in range(n):
        joint_state = state[j]
        drive = laws.drive[j]
        rubbing = friction_torque(laws.friction[j], joint_state, dt)
        joint_state.net = (
            joint_state.torque
            - rubbing
            - ripple_torque(drive, joint_state.motor_angle, joint_state.transmitted)
        )
        joint_state.link = hose_torque(drive, engine.qpos[j])
        joint_state.link += outside_torque(laws.outside[j], j, engine.qpos, engine.qvel, elapsed)
        joint_state.link += remembered_torque(
            laws.outside[j], joint_state, engine.qpos[j], engine.qvel[j], dt
        )
        loss = (
            max(rubbing * joint_state.motor_speed, 0.0)
            + laws.heat[j].copper * joint_state.torque**2
        )
        warm_up(laws.heat[j], joint_state, loss, dt)
    for j in range(n):
        joint = laws.friction[j]
        if joint.couple_to >= 0:
            shared = coupled_torque(joint, state[j], state[joint.couple_to].motor_speed, dt)
            state[j].net -= shared
            state[joint.couple_to].net -= joint.couple_ratio * shared
    for j in range(n):
        joint_state = state[j]
        drive = laws.drive[j]
        if drive.elastic:
            twist = joint_state.motor_angle - engine.qpos[j]
            joint_state.spring = spring_torque(
                drive, twist, joint_state.motor_speed - engine.qvel[j]
            )
            engine.qfrc_applied[j] = joint_state.spring + joint_state.link
        else:
            engine.qfrc_applied[j] = joint_state.net + joint_state.link


@compiled()
def turn_motors(engine: Engine, drives: Array, state: Array) -> None:
    """After a step: moves the motors that are bodies of their own, and notes what mesh and bearings
    feel.
    """
    dt = engine.dt
    for j in range(len(state)):
        joint_state = state[j]
        drive = drives[j]
        if drive.elastic:
            rate = (joint_state.net - joint_state.spring) / drive.rotor_inertia
            carried = joint_state.spring
            joint_state.motor_speed += dt * rate
            joint_state.motor_angle += dt * joint_state.motor_speed
        else:
            rate = engine.qacc[j]
            carried = joint_state.net - drive.rotor_inertia * rate
        # The mesh and the balls feel load and acceleration over a few milliseconds, not step by
        # step.
        joint_state.transmitted += min(dt / 2e-3, 1.0) * (carried - joint_state.transmitted)
        joint_state.acceleration += min(dt / 5e-3, 1.0) * (rate - joint_state.acceleration)


@compiled()
def advance(engine: Engine, laws: Laws, state: Array, elapsed: float) -> None:
    """One step of the plant under the motor torques in the state."""
    motor_motion(engine, laws.drive, state)
    apply_torques(engine, laws, state, elapsed)
    if laws.contact.body > 0:
        push(laws.contact, elapsed, engine.xpos, engine.xmat, engine.xipos, engine.xfrc_applied)
    call_step(engine.function, engine.model, engine.data)  # type: ignore[call-arg]
    turn_motors(engine, laws.drive, state)


@compiled()
def command(
    control: Array, state: Array, q: Array, dq: Array, feed: Array, noise: Array, tick: float
) -> None:
    """Reads the encoders and sets the motor torques [N m]."""
    for j in range(len(state)):
        joint = control[j]
        joint_state = state[j]
        count = joint.resolution
        angle = joint_state.motor_angle + joint.offset
        reading = np.round(angle / count + noise[j]) * count
        rate = (reading - joint_state.reading) / tick
        joint_state.reading = reading
        joint_state.speed_estimate += joint.smoothing * (rate - joint_state.speed_estimate)
        torque = (
            feed[j]
            + joint.stiffness * (q[j] - reading)
            + joint.damping * (dq[j] - joint_state.speed_estimate)
        )
        joint_state.before = joint_state.torque
        joint_state.torque = min(max(torque, -joint.limit), joint.limit)


@compiled()
def note(log: TickLog, k: int, engine: Engine, state: Array) -> None:
    """Writes one tick of the log."""
    for j in range(len(state)):
        log.angle[k, j] = state[j].motor_angle
        log.speed[k, j] = state[j].motor_speed
        log.speed_estimate[k, j] = state[j].speed_estimate
        # The drive reports the mean of the current before and after the instant: no delay of its
        # own.
        log.torque[k, j] = 0.5 * (state[j].before + state[j].torque)
        log.link_angle[k, j] = engine.qpos[j]
        log.temperature[k, j] = state[j].housing_rise


@compiled()
def run_loop(
    engine: Engine,
    laws: Laws,
    control: Array,
    substeps: int,
    state: Array,
    q: Array,
    dq: Array,
    feed: Array,
    noise: Array,
    start: float,
    log: TickLog,
) -> None:
    """Follows a reference from tick to tick.

    Args:
        engine, laws: The plant.
        control: The controllers, records of `control` in `laws.toml`.
        substeps: Steps of the simulation in a tick.
        state: Advanced in place.
        q, dq, feed: Reference position, velocity and feed-forward torque at K ticks, shape (K, n).
        noise: Encoder noise in counts, shape (K, n).
        start: Time of the first tick since the run began [s]; negative while the arm settles.
        log: Filled in place.
    """
    tick = engine.dt * substeps
    for k in range(q.shape[0]):
        motor_motion(engine, laws.drive, state)
        command(control, state, q[k], dq[k], feed[k], noise[k], tick)
        note(log, k, engine, state)
        for i in range(substeps):
            advance(engine, laws, state, start + k * tick + i * engine.dt)


def check_finite(log: TickLog, data: mujoco.MjData) -> bool:
    """Whether the simulation stayed finite."""
    warned = data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number > 0
    if warned:
        return False
    return bool(np.isfinite(log.angle).all() and np.isfinite(log.torque).all())
