"""Models that a simulator holds: the laws themselves, and written files as their simulators read them back.

All of them predict a torque log, files also the motion under a logged torque: a file is judged by what is in it and not
by what was meant. Without recordings, every file must differ from the tuned arm by exactly what its effects say.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol
from warnings import catch_warnings

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.export.bodies import random_states
from ident.export.identified import IdentifiedArm, in_module
from ident.export.mjcf import SPRING_SUFFIX, write_mjcf
from ident.export.urdf_file import write_urdf
from ident.files import run_python
from ident.laws.acting import Effect, acting_torque, read_log, shifted
from ident.laws.motion import Arm, Losses, MovingArm
from ident.model.carried import describe_arm
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel

# What diverges is found here and reported; MuJoCo would append it to a file in the folder where the user is.
mujoco.set_mju_user_warning(lambda message: None)
FILE_OF = {"urdf": "robot.urdf", "mjcf": "robot.xml"}
# Step of the rollouts with Pinocchio: dry friction near rest is stiff [s].
ROLLOUT_STEP = 2.5e-4
# What a motion is off by that grows without bound [rad].
LOST = 2.0 * np.pi
# The deflection of an elastic joint is integrated with steps no longer than this [s], and than so much of its swing.
SPRING_STEP = 1e-3
SPRING_TURN = 0.1
# Newton's steps to their balance at the start, and by how much a spring is bent for its slope [rad].
BALANCE_STEPS = 4
BALANCE_SLOPE = 1e-6


class SimulatorModel(Protocol):
    """What a controller is designed with, and what a log is compared with."""

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m]."""

    def read_log(self, torque: Float[Array, "T n"], interval: float) -> Float[Array, "T n"]:
        """What the log says of it [N m]."""


@dataclass(frozen=True, eq=False)
class LawModel:
    """Rigid body, losses, and laws of identified effects: what a patch holds."""

    arm: Arm  # the chain, its links tuned
    losses: Losses  # rotor inertia and friction
    effects: tuple[Effect, ...] = ()  # those without a law in torque are left out
    warmth: Any = (
        0.5  # of a run's joints, as `MovingArm` takes it; half warm where nobody has followed it
    )

    @classmethod
    def of(cls, identified: IdentifiedArm, payload: Payload | None = None) -> LawModel:
        """All of an identified arm that has a law, with a known payload."""
        arm = describe_arm(identified.tuned.with_payload(payload))
        return cls(arm, identified.losses, tuple(in_module(identified.changes)))

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m].

        Args:
            q, dq, ddq: Its states, evenly sampled, shape (T, n) [rad, rad/s, rad/s²].
            interval: Time between them [s].
        """
        states = MovingArm(self.arm, self.losses, q, dq, ddq, interval, warmth=self.warmth)
        plain = states.rigid + self.losses.torque(dq, ddq, states.direction)
        return np.asarray(plain + acting_torque(self.effects, states))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        """What a log says of such a torque, its sensors' errors included [N m]."""
        return read_log(self.effects, torque, interval)


def log_error(model: SimulatorModel, motion: Motion) -> Float[Array, "t n"]:
    """What a model leaves of a run's log through the run's own filter; zero where a joint doesn't slide [N m]."""
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    left = motion.tau_filtered - motion.filtered(model.read_log(torque, motion.interval))
    return np.where(motion.settled, left, 0.0)


class LoadedModel(SimulatorModel, ABC):
    """A patched file in its simulator; its log is read as far as the file says."""

    form: str
    module: ModuleType | None = None
    """A written module that stands in for what the file lacks: of a URDF also what the log reads."""

    @abstractmethod
    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """`joint_torque` of the file alone."""

    @abstractmethod
    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """States after w stretches of time under what a log says of the torque.

        Args:
            states: Positions and velocities at their starts, shape (2, w, n).
            twists: What the springs' deflections and their rates are there (`deflections`), shape (w, 2, s).
            drive: Logged torque, already earlier by the log's delay, shape (w, T, n) [N m].
            extra: Joint torque added to it, of the same shape [N m].
            interval: Sampling interval of both [s].
        """

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        own = self.own_torque(q, dq, ddq, interval)
        return own if self.module is None else own + self.missing(q, dq, ddq, interval)

    def deflections(
        self, q: Array, dq: Array, ddq: Array, interval: float
    ) -> Float[Array, "T 3 s"]:
        """Deflection, rate and acceleration of the model's s springs along a motion, of which no log tells."""
        return np.zeros((len(q), 3, 0))

    def missing(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Joint torque along a run that is added to the file's own [N m]."""
        if self.module is None:
            return np.zeros_like(q)
        return np.asarray(self.module.missing_torque(self.form, q, dq, ddq, interval), dtype=float)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        """What `roll_out` takes for a log: earlier by its lateness, as far as the file says [N m]."""
        return log


class LoadedUrdf(LoadedModel):
    """A URDF in Pinocchio. Rotor inertia, and how friction turns round, stand in the parameter file instead."""

    form = "urdf"

    def __init__(self, arm: ArmModel, losses: Losses, payload: Payload | None) -> None:
        """An arm with losses, of which the rotor inertia stands in no URDF."""
        self.losses = losses
        self.arm = arm.with_payload(payload).with_rotors(losses.motor_inertia)

    @classmethod
    def read(
        cls,
        path: Path,
        locked: tuple[str, ...],
        losses: Losses,
        payload: Payload | None,
    ) -> LoadedUrdf:
        """A file: damping and dry friction are what it says, whatever `losses` hold."""
        arm = ArmModel.from_urdf(path.read_text(encoding="utf-8"), path)
        arm = arm.locked([name for name in locked if name in arm.joint_names])
        stated = replace(losses, viscous=arm.model.damping, coulomb=arm.model.friction)
        return cls(arm, stated, payload)

    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        slip = (
            np.tanh(dq / self.losses.transition)
            if interval <= 0.0
            else self.losses.direction(q, dq)
        )
        return self.arm.inverse_dynamics(q, dq, ddq) + self._friction(dq, slip)

    def _friction(self, dq: Array, slip: Array) -> Array:
        return np.asarray(self.losses.viscous * dq + self.losses.coulomb * slip)

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        return (
            torque
            if self.module is None
            else np.asarray(self.module.log_of_torque(torque, interval), dtype=float)
        )

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        return (
            log
            if self.module is None
            else np.asarray(self.module.torque_of_log(log, interval), dtype=float)
        )

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """Euler's method, velocity first, friction by its slope ahead; what slides at the start has slid before.

        Else friction of a light link would swing up. Its inertia is that of the start: no more hangs on it than how
        steps end, not where they lead.
        """
        q, dq = np.array(states)
        slip = np.tanh(dq / self.losses.transition)
        stops = self.losses.range > 0.0
        reach = np.where(stops, self.losses.range, 1.0)
        inertia = self.arm.derivatives(q, 0.0 * q, 0.0 * q)[2]
        for torque in _at_steps(drive + extra, interval, ROLLOUT_STEP):
            change = self.arm.forward_dynamics(q, dq, torque - self._friction(dq, slip))
            turns = np.where(stops, ROLLOUT_STEP / reach, 1.0 / self.losses.transition) * (
                1.0 - slip**2
            )
            drag = (self.losses.viscous + self.losses.coulomb * turns)[:, :, None] * np.eye(
                q.shape[1]
            )
            change = np.linalg.solve(inertia + ROLLOUT_STEP * drag, inertia @ change[:, :, None])[
                :, :, 0
            ]
            dq = dq + ROLLOUT_STEP * change
            q = q + ROLLOUT_STEP * dq
            held = np.clip(slip + ROLLOUT_STEP * dq / reach, -1.0, 1.0)
            slip = np.where(stops, held, np.tanh(dq / self.losses.transition))
        lost = ~(np.abs(q - states[0]) < LOST).all(axis=1, keepdims=True)
        return np.where(lost, np.stack([states[0] + LOST, states[1]]), np.stack([q, dq]))


class LoadedMjcf(LoadedModel):
    """An MJCF in MuJoCo, without its joint limits, which a log may touch."""

    form = "mjcf"

    def __init__(self, path: Path, joints: tuple[str, ...], payload: Payload | None = None) -> None:
        mujoco.set_mju_user_warning(
            lambda _: None
        )  # else on the terminal and in a file where the user works
        spec = mujoco.MjSpec.from_file(str(path))
        if payload is not None and payload.mass_kg > 0.0:
            body = spec.joint(joints[-1]).parent.add_body(name="known_payload", pos=payload.com_m)
            body.mass = payload.mass_kg
            body.inertia = np.full(3, 1e-6 * payload.mass_kg)
            body.ipos = np.zeros(3)
            body.explicitinertial = True
        with catch_warnings(action="ignore"):  # of links without inertia, as a URDF may have them
            self.model = spec.compile()
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.data = mujoco.MjData(self.model)
        named = {self.model.joint(i).name: i for i in range(self.model.njnt)}
        self.main = np.array([self.model.jnt_dofadr[named[name]] for name in joints])
        springs = [named[name + SPRING_SUFFIX] for name in joints if name + SPRING_SUFFIX in named]
        self.springs, self.stiffness = (
            self.model.jnt_dofadr[springs],
            self.model.jnt_stiffness[springs],
        )
        motors = [self.model.actuator(name).id for name in joints]
        self.motors = np.array(motors)
        self.gear, self.bias = (
            self.model.actuator_gear[motors, 0],
            self.model.actuator_biasprm[motors, 0],
        )
        sensors = [self.model.sensor(f"{name}_log").id for name in joints]
        self.cutoff = np.where(
            self.model.sensor_cutoff[sensors] > 0.0, self.model.sensor_cutoff[sensors], np.inf
        )
        self.delay = float(self.model.sensor_delay[sensors[0]])

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        return shifted(log, -self.delay, interval)

    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        out = np.empty_like(q)
        twists = self.deflections(q, dq, ddq, interval)
        for k, state in enumerate(zip(q, dq, ddq, strict=True)):
            self._place(np.array(state), *twists[k])
            mujoco.mj_inverse(self.model, self.data)
            out[k] = self.data.qfrc_inverse[self.main]
        return out

    def deflections(
        self, q: Array, dq: Array, ddq: Array, interval: float
    ) -> Float[Array, "T 3 s"]:
        """From balance under the load, in small steps, the joints' motion on straight lines between samples."""
        found = np.zeros((len(q), 3, len(self.springs)))
        if len(self.springs) == 0 or interval <= 0.0:
            return found
        states = np.stack([q, dq, ddq], axis=1)
        found[0] = self._at_start(states, interval)
        x, v, _ = found[0]
        with_one, left = (self._on_springs(states[0], x, v, own) for own in (1.0, 0.0))
        swing = float(np.sqrt(np.max(self.stiffness / (with_one - left))))
        steps = max(1, int(np.ceil(interval / min(SPRING_STEP, SPRING_TURN / swing))))
        for k in range(1, len(q)):
            x, v, change = found[k - 1]
            for step in range(1, steps + 1):
                v = v + interval / steps * change
                x = x + interval / steps * v
                state = states[k - 1] + step / steps * (states[k] - states[k - 1])
                change = self._acceleration(state, x, v)
            found[k] = x, v, change
        # Between straight lines a spring jerks at each sample; what it does on the whole is in its rates.
        found[:, 2] = np.gradient(found[:, 1], interval, axis=0)
        return found

    def _at_start(self, states: Float[Array, "T 3 n"], interval: float) -> Float[Array, "3 s"]:
        """Springs in balance under the load, that give way as it grows: nothing swings."""
        none = np.zeros(len(self.springs))
        loads = [-self._on_springs(states[k], none, none) for k in (0, 1)]
        x = loads[0] / self.stiffness
        rate = (loads[1] - loads[0]) / (self.stiffness * interval)
        for _ in range(BALANCE_STEPS):  # the load changes with the deflection
            left, ahead = (
                self._on_springs(states[0], x + step, none) for step in (0.0, BALANCE_SLOPE)
            )
            x = x - BALANCE_SLOPE * left / (ahead - left)
        return np.stack([x, rate, self._acceleration(states[0], x, rate)])

    def _acceleration(self, state: Float[Array, "3 n"], x: Array, v: Array) -> Float[Array, " s"]:
        """By what two inverse dynamics leave on the springs; each spring feels its own acceleration only."""
        left, with_one = (self._on_springs(state, x, v, own) for own in (0.0, 1.0))
        return -left / (with_one - left)

    def _place(self, state: Array, twist: Array, rate: Array, change: Array | float = 0.0) -> None:
        targets = self.data.qpos, self.data.qvel, self.data.qacc
        for target, values, behind in zip(targets, state, (twist, rate, change), strict=True):
            target[self.main] = values
            target[self.springs] = behind

    def _on_springs(
        self, state: Float[Array, "3 n"], x: Array, v: Array, change: float = 0.0
    ) -> Float[Array, " s"]:
        """Torque that inverse dynamics leave on the springs [N m]."""
        self._place(state, x, v, change)
        mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse[self.springs])

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        log = shifted(torque / self.gear - self.bias, self.delay, interval)
        return np.clip(log, -self.cutoff, self.cutoff)

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """MuJoCo's own steps, the log as `ctrl`."""
        step = float(self.model.opt.timestep)
        ends = []
        driven, added = (_at_steps(one, interval, step) for one in (drive, extra))
        for k, twist in enumerate(twists):
            mujoco.mj_resetData(self.model, self.data)
            self._place(np.array([*states[:, k], np.zeros_like(states[0, k])]), *twist)
            for logged, more in zip(driven[:, k], added[:, k], strict=True):
                self.data.ctrl[self.motors] = logged
                self.data.qfrc_applied[self.main] = more
                mujoco.mj_step(self.model, self.data)
            ends.append((self.data.qpos[self.main].copy(), self.data.qvel[self.main].copy()))
            if any(one.number for one in self.data.warning[mujoco.mjtWarning.mjWARN_BADQPOS :]):
                ends[-1] = (states[0, k] + LOST, states[1, k])  # MuJoCo begins anew at its own pose
        return np.moveaxis(np.array(ends), 1, 0)


def _at_steps(values: Float[Array, "w T n"], interval: float, step: float) -> Float[Array, "S w n"]:
    """Values in the middle of a simulator's steps, between samples on straight lines."""
    at = (
        np.arange(0.0, (values.shape[1] - 1) * interval - 0.5 * step, step) + 0.5 * step
    ) / interval
    whole = np.minimum(at.astype(int), values.shape[1] - 2)
    share = (at - whole)[:, None, None]
    rows = np.moveaxis(values, 1, 0)
    return np.asarray((1.0 - share) * rows[whole] + share * rows[whole + 1])


@dataclass(frozen=True, eq=False)
class WrittenFile:
    """A file of a format (`urdf`, `mjcf`) in its place."""

    form: str
    folder: Path  # where it lies
    stated: IdentifiedArm  # what the file holds

    @classmethod
    def write(cls, form: str, folder: Path, stated: IdentifiedArm) -> WrittenFile:
        """Writes the file into a folder."""
        folder.mkdir(exist_ok=True)
        text = write_urdf(stated) if form == "urdf" else write_mjcf(stated)
        (folder / FILE_OF[form]).write_text(text, encoding="utf-8")
        return cls(form, folder, stated)

    def load(self, payload: Payload | None = None, module: ModuleType | None = None) -> LoadedModel:
        """The file in its simulator, with a module that stands in for what it lacks, if one is given."""
        path = self.folder / FILE_OF[self.form]
        arm = self.stated.nominal
        model: LoadedModel = (
            LoadedMjcf(path, arm.joint_names, payload)
            if self.form == "mjcf"
            else LoadedUrdf.read(path, tuple(arm.locked_joints), self.stated.losses, payload)
        )
        model.module = module
        return model

    def check(self, seed: int = 0) -> dict[str, Any]:
        """Largest difference of the loaded file from its bodies, losses and laws, evaluated at random states [N m].

        Single states: what has a memory (an elastic joint, a delay) is not in them.
        """
        changes = self.stated.changes
        model = self.load()
        if any(change.part(self.form) == "second joint" for change in changes):
            return {"loads": True, "torque_difference_Nm": None}
        q, dq, ddq = random_states(self.stated.nominal, np.random.default_rng(seed))
        # Link errors are in the bodies already.
        instant = in_module([c for c in changes if c.part(self.form) not in ("delay", "inertial")])
        law = LawModel(describe_arm(self.stated.whole), self.stated.losses, tuple(instant))
        wanted = law.read_log(law.joint_torque(q, dq, ddq, 0.0), 0.0)
        # States that lie for ever apart: no delay reaches from one to the next.
        left = model.read_log(model.joint_torque(q, dq, ddq, 0.0), 1e9) - wanted
        return {"loads": True, "torque_difference_Nm": float(np.max(np.abs(left)))}


def load_module(path: Path) -> ModuleType:
    """Imports a written module from its file."""
    return run_python(path, f"armgap_patch_{path.parent.name.strip('.')}")
