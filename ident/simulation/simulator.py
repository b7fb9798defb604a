"""Runs motions on a hidden arm in closed loop, one after the other, on one clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.simulation.hardware import Hardware, build_model
from ident.simulation.laws import change_law, cool_down, make_law, no_contact
from ident.simulation.loop import (
    Laws,
    TickLog,
    check_finite,
    engine,
    fresh_log,
    fresh_state,
    run_loop,
)
from ident.trajectories.reference import TICK_S, ReferenceMotion

# What diverges is found here and reported; MuJoCo would print it on standard error and in a file of
# its own.
mujoco.set_mju_user_warning(lambda message: None)
LARGEST_STEP_S = 5e-4
# The spring between motor and link must turn by less than this angle of its own oscillation in a
# step.
SPRING_PHASE = 0.6
# How much longer the steps of a coarse simulation are.
COARSER = 2.0
# Velocity filter of the controller [rad/s].
FILTER_RAD_S = 900.0
# A softer loop filters more: its filter lies at this multiple of its bandwidth.
FILTER_PER_BANDWIDTH = 11.25
# Speed loops beyond this have no phase left: 42 degrees are lost in the filter, 37 in ticks and
# differences [rad/s].
LARGEST_LOOP_RAD_S = 800.0
# A controller that knows friction knows this share of it, and turns it round over this speed
# [rad/s].
FED_FRICTION = 0.85
FED_SPEED = 0.02
# A real controller stops an arm that lags by less [rad or m].
MOST_LAG = 1.0
# Temperatures in the state: they alone outlast a run.
WARMTH = ("lubricant_rise", "housing_rise")
# Unrecorded: the arm comes from aside to where the run starts, and settles there [s].
APPROACH_S = 0.5
SETTLE_S = 0.4
ASIDE_RAD = 0.03


@dataclass(frozen=True, eq=False)
class Trace:
    """The truth of one run at the controller's ticks."""

    motion: ReferenceMotion  # what was asked for
    start: float  # session clock at its first tick [s]
    log: TickLog  # what happened, K ticks

    @property
    def times(self) -> Float[Array, " K"]:
        """Time of the ticks since the start of the run [s]."""
        return np.arange(len(self.log.angle)) * TICK_S


class Simulator:
    """One hidden arm, ready to run.

    Args:
        hardware: The arm.
        rng: Source of encoder noise, of the friction's change from run to run, and of the approach.
        coarse_step: Step of a coarse simulation [s] (`choose_step`), of first order: four times as
            quick, and good enough to compare two simulations with the same step, whose errors
            cancel.
    """

    def __init__(
        self, hardware: Hardware, rng: np.random.Generator, coarse_step: float | None = None
    ) -> None:
        self.hardware = hardware
        self.rng = rng
        arm = hardware.arm
        drive = hardware.drive
        rotors = np.where(drive.elastic, 0.0, drive.rotor_inertia)
        bodies = hardware.bodies.replace(joint_inertia=rotors)
        self.step = coarse_step or choose_step(hardware)
        first_order = coarse_step is not None or bool(drive.elastic.any())
        self.model = build_model(
            arm.urdf, arm.joint_names, arm.links, bodies, self.step, first_order
        )
        self.data = mujoco.MjData(self.model)
        self.state = fresh_state(arm.n)
        stiffness, damping = controller_gains(hardware)
        sensing = hardware.sensing
        filter_rad_s = FILTER_RAD_S
        resolution = np.array(sensing.count)
        self._loop_noise = sensing.count_noise
        if hardware.loop_noise is not None:
            filter_rad_s = min(FILTER_RAD_S, FILTER_PER_BANDWIDTH * hardware.bandwidth)
            most = hardware.loop_noise * drive.effort_limit / (damping * filter_rad_s)
            resolution = np.minimum(sensing.count, np.sqrt(12.0) * most)
            noise = np.minimum(sensing.count_noise * sensing.count, most)
            self._loop_noise = noise / resolution
        self.control = make_law(
            "control",
            arm.n,
            stiffness=stiffness,
            damping=damping,
            smoothing=-np.expm1(-filter_rad_s * TICK_S),
            limit=drive.effort_limit,
            offset=sensing.encoder_offset,
            resolution=resolution,
        )

    def run(
        self,
        motions: Sequence[ReferenceMotion],
        pauses: Iterable[float],
        progress: Callable[[], None],
        feeds: Sequence[Float[Array, "K n"]] | None = None,
    ) -> list[Trace]:
        """All motions in order.

        Args:
            motions: What to do.
            pauses: Standstill before each run [s].
            progress: Called after each run.
            feeds: Feed-forward torque of each motion [N m], if it is known already
                (`feed_forward`).

        Raises:
            InputError: The simulation left the finite numbers, or the arm its motion: an effect's
                size is beyond what the arm can bear.
        """
        traces = []
        clock = 0.0
        state = self.state
        for number, (motion, pause) in enumerate(zip(motions, pauses, strict=True)):
            clock += pause
            rise = np.column_stack([state[name] for name in WARMTH])
            cooled = cool_down(self.hardware.heat, rise, pause).T
            state[WARMTH[0]], state[WARMTH[1]] = cooled
            feed = feed_forward(self.hardware, motion) if feeds is None else feeds[number]
            traces.append(self._run_one(number, motion, clock, feed))
            clock += motion.duration
            progress()
        return traces

    def _run_one(
        self, number: int, motion: ReferenceMotion, clock: float, feed: Float[Array, "K n"]
    ) -> Trace:
        laws = self._laws(number)
        approach = self._approach(motion.q[0])
        self._place(approach.q[0])
        steps = round(TICK_S / self.step)
        views = (engine(self.model, self.data), laws, self.control, steps, self.state)
        ahead_there = feed_forward(self.hardware, approach)
        way_there = (approach, -approach.duration - TICK_S, ahead_there)
        for piece, start, ahead in (way_there, (motion, 0.0, feed)):
            log = fresh_log(len(piece.q), self.hardware.n)
            noise = self._loop_noise * self.rng.standard_normal(piece.q.shape)
            run_loop(*views, piece.q, piece.dq, ahead, noise, start, log)
            if not check_finite(log, self.data):
                raise InputError(motion.name, "the simulation diverged", "choose a smaller effect")
            if np.abs(log.angle - piece.q).max() > MOST_LAG:
                what = "the arm can't follow its motion"
                raise InputError(motion.name, what, "choose a smaller effect")
        return Trace(motion, clock, log)

    def _laws(self, number: int) -> Laws:
        """The laws of one run: friction changes a little from run to run."""
        h = self.hardware
        spread = np.exp(h.friction_spread * self.rng.standard_normal((2, h.n)))
        if h.friction_path is not None:
            spread = spread * h.friction_path[number % len(h.friction_path)]
        coulomb = h.friction.coulomb * spread[0]
        viscous = h.friction.viscous * spread[1]
        friction = change_law(h.friction, coulomb=coulomb, viscous=viscous)
        contact = h.contact if h.contact_run in (-1, number) else no_contact()
        return Laws(friction, h.drive, h.heat, h.outside, contact)

    def _approach(self, goal: Float[Array, " n"]) -> ReferenceMotion:
        """From a little aside to the start of a run, so that the joints stick as they do on a real
        arm.
        """
        aside = ASIDE_RAD * self.rng.uniform(-1.0, 1.0, self.hardware.n)
        times = np.arange(round((APPROACH_S + SETTLE_S) / TICK_S)) * TICK_S
        s = np.clip(times / APPROACH_S, 0.0, 1.0)
        left = (1.0 - s) ** 3 * (1.0 + 3.0 * s + 6.0 * s**2)
        path = goal + np.outer(left, aside)
        dq = np.gradient(path, TICK_S, axis=0)
        return ReferenceMotion("approach", path, dq, np.gradient(dq, TICK_S, axis=0))

    def _place(self, q: Float[Array, " n"]) -> None:
        """Puts the arm at rest into a pose; temperatures stay."""
        n = self.hardware.n
        state = self.state
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:n] = q - self.hardware.sensing.encoder_offset
        for name in set(state.dtype.names or ()) - set(WARMTH):
            state[name] = 0.0
        state["motor_angle"] = self.data.qpos[:n]
        state["reading"] = q
        state["torque"] = self.hardware.arm.gravity(q[None])[0]
        if self.model.nq > n:  # liquid hangs where its springs bear it
            mujoco.mj_kinematics(self.model, self.data)
            turn = self.data.body("slosh").xmat.reshape(3, 3)
            stiffness = self.model.jnt_stiffness[n:].reshape(3, -1)[:, 0]
            mass = float(self.model.body("slosh").mass[0])
            self.data.qpos[n:] = turn.T @ self.model.opt.gravity * mass / stiffness
        mujoco.mj_forward(self.model, self.data)


def feed_forward(hardware: Hardware, motion: ReferenceMotion) -> Float[Array, "K n"]:
    """What the controller expects a motion to take [N m], of the nominal arm.

    Without a model it is gravity alone, which the integrator of such a loop holds.
    """
    arm = hardware.arm
    if hardware.feed_forward == "none":
        return arm.gravity(motion.q)
    torque = arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    if hardware.feed_forward == "friction":
        law = hardware.friction
        dry = law.coulomb * np.tanh(motion.dq / FED_SPEED)
        torque = torque + FED_FRICTION * (dry + law.viscous * motion.dq)
    return torque


def choose_step(hardware: Hardware, coarse: bool = False) -> float:
    """Step of the simulation [s]: half a tick (a tick if coarse), or a power of two less that
    resolves the springs.
    """
    longer = COARSER if coarse else 1.0
    step = LARGEST_STEP_S * longer
    drive = hardware.drive
    if not drive.elastic.any():
        return step
    step /= 2.0
    link = least_link_inertia(hardware)
    reduced = 1.0 / (1.0 / link + 1.0 / drive.rotor_inertia)
    fastest = np.sqrt(drive.stiffness / reduced)[drive.elastic].max()
    while fastest * step > SPRING_PHASE * longer and step > 1e-5:
        step /= 2.0
    return step


def least_link_inertia(hardware: Hardware) -> Float[Array, " n"]:
    """Least inertia that each joint's spring can see: the link's with all others free, over some
    poses [kg m²].
    """
    arm = hardware.arm
    drawn = np.random.default_rng(0).uniform(-1.5, 1.5, (12, arm.n))
    poses = np.clip(drawn, arm.lower, arm.upper)
    rotors = np.diag(np.where(hardware.drive.elastic, 0.0, hardware.drive.rotor_inertia))
    free = []
    for pose in poses:
        mobility = np.linalg.inv(mass_matrix(hardware, pose) + rotors)
        free.append(1.0 / np.diag(mobility))
    return np.asarray(np.min(free, axis=0))


def middling_inertia(hardware: Hardware) -> Float[Array, " n"]:
    """Inertia that each joint moves at a middling pose, its rotor included [kg m²]."""
    pose = np.clip(np.full(hardware.n, 0.6), hardware.arm.lower, hardware.arm.upper)
    return np.asarray(np.diag(mass_matrix(hardware, pose)) + hardware.drive.rotor_inertia)


def mass_matrix(hardware: Hardware, q: Float[Array, " n"]) -> Float[Array, "n n"]:
    """Joint-space inertia of the nominal links at a pose, without rotors [kg m²]."""
    arm = hardware.arm
    unit = np.eye(hardware.n)
    pose = np.repeat(q[None], arm.n, axis=0)
    columns = arm.inverse_dynamics(pose, np.zeros_like(unit), unit) - arm.gravity(pose)
    return 0.5 * (columns + columns.T)


def controller_gains(hardware: Hardware) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Stiffness [N m/rad] and damping [N m s/rad] for the controller's bandwidth at a middling
    pose.

    Softer where the lightest that the motor ever feels (its rotor alone behind a spring, the link
    with all others free else) would be driven faster than the loop's filter and ticks can follow.
    """
    inertia = middling_inertia(hardware)
    w = hardware.bandwidth
    drive = hardware.drive
    damping = 2.0 * hardware.damping_ratio * w * inertia
    lightest = np.where(drive.elastic, drive.rotor_inertia, least_link_inertia(hardware))
    softer = np.minimum(1.0, LARGEST_LOOP_RAD_S * lightest / damping)
    return softer**2 * w**2 * inertia, softer * damping
