"""Models that a simulator holds: the laws themselves, and written files as their simulators read them back.

All of them predict a torque log, files also the motion under a logged torque: a file is judged by what is in it and not
by what was meant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import SPRING_SUFFIX
from ident.export.python import describe_arm
from ident.laws.acting import Effect, acting_torque, read_log, shifted
from ident.laws.motion import Arm, Losses, MovingArm
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel

# Step of the rollouts with Pinocchio: dry friction near rest is stiff [s].
ROLLOUT_STEP = 2.5e-4
# What a motion is off by that grows without bound [rad].
LOST = 2.0 * np.pi
# The deflection of an elastic joint is integrated with steps no longer than this [s].
SPRING_STEP = 1e-3


class SimulatorModel(Protocol):
    """What a controller is designed with, and what a log is compared with."""

    def joint_torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], interval: float
    ) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m]."""
        ...

    def read_log(self, torque: Float[Array, "T n"], interval: float) -> Float[Array, "T n"]:
        """What the log says of it [N m]."""
        ...


@dataclass(frozen=True, eq=False)
class LawModel:
    """Rigid body, losses, and laws of identified effects: what a patch holds.

    Attributes:
        arm: The chain, its links tuned.
        losses: Rotor inertia and friction.
        effects: Named effects; those without a law in torque are left out.
        warmth: Of a run's joints, as `MovingArm` takes it; half warm where nobody has followed it.
    """

    arm: Arm
    losses: Losses
    effects: tuple[Effect, ...] = ()
    warmth: Any = 0.5

    @classmethod
    def of(cls, identified: IdentifiedArm, payload: Payload | None = None) -> LawModel:
        """All of an identified arm that has a law, with a known payload."""
        arm = describe_arm(identified.tuned.with_payload(payload))
        return cls(arm, identified.losses, tuple(identified.effects))

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        states = MovingArm(self.arm, self.losses, q, dq, ddq, interval, warmth=self.warmth)
        plain = states.rigid + self.losses.torque(dq, ddq, states.direction)
        return np.asarray(plain + acting_torque(self.effects, states))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        return read_log(self.effects, torque, interval)


def log_error(model: SimulatorModel, motion: Motion) -> Float[Array, "t n"]:
    """What a model leaves of a run's log through the run's own filter; zero where a joint doesn't slide [N m]."""
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    left = motion.tau_filtered - motion.filtered(model.read_log(torque, motion.interval))
    return np.where(motion.settled, left, 0.0)


class LoadedModel(SimulatorModel, ABC):
    """A patched file in its simulator; its log is read as far as the file says."""

    @abstractmethod
    def roll_out(
        self,
        states: Float[Array, "2 w n"],
        twists: Float[Array, "w 2 s"],
        drive: Float[Array, "w T n"],
        extra: Float[Array, "w T n"],
        interval: float,
    ) -> Float[Array, "2 w n"]:
        """States after w stretches of time under what a log says of the torque.

        Args:
            states: Positions and velocities at their starts.
            twists: What the springs' deflections and their rates are there (`deflections`).
            drive: Logged torque, already earlier by the log's delay [N m].
            extra: Joint torque added to it [N m].
            interval: Sampling interval of both [s].
        """

    def deflections(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], interval: float
    ) -> Float[Array, "T 3 s"]:
        """Deflection, rate and acceleration of the model's s springs along a motion, of which no log tells."""
        return np.zeros((len(q), 3, 0))

    def missing(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Joint torque along a run that is added to the file's own [N m]."""
        return np.zeros_like(q)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        """What `roll_out` takes for a log: earlier by its lateness, as far as the file says [N m]."""
        return log


class HelpedModel(LoadedModel):
    """A file with a written module that stands in for what it lacks: of a `urdf` also what the log reads."""

    def __init__(self, file: LoadedModel, module: ModuleType, form: str) -> None:
        self.file, self.module, self.form = file, module, form

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        return self.file.roll_out(states, twists, drive, extra, interval)

    def deflections(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T 3 s"]:
        return self.file.deflections(q, dq, ddq, interval)

    def missing(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        return np.asarray(self.module.missing_torque(self.form, q, dq, ddq, interval), dtype=float)

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        return self.file.joint_torque(q, dq, ddq, interval) + self.missing(q, dq, ddq, interval)

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        read = self.module.log_of_torque if self.form == "urdf" else self.file.read_log
        return np.asarray(read(torque, interval), dtype=float)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        undo = self.module.torque_of_log if self.form == "urdf" else self.file.undo_log
        return np.asarray(undo(log, interval), dtype=float)


class LoadedUrdf(LoadedModel):
    """A URDF in Pinocchio. Rotor inertia, and how friction turns round, stand in the parameter file instead."""

    def __init__(
        self,
        path: Path,
        locked: tuple[str, ...],
        losses: Losses,
        payload: Payload | None,
    ) -> None:
        arm = ArmModel.from_urdf(path.read_text(encoding="utf-8"), path)
        arm = arm.locked([name for name in locked if name in arm.joint_names])
        self.losses = replace(losses, viscous=arm.model.damping, coulomb=arm.model.friction)
        self.arm = arm.with_payload(payload).with_rotors(losses.motor_inertia)

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        slip = np.tanh(dq / self.losses.transition) if interval <= 0.0 else self.losses.direction(q, dq)
        return self.arm.inverse_dynamics(q, dq, ddq) + self._friction(dq, slip)

    def _friction(self, dq: Array, slip: Array) -> Array:
        return np.asarray(self.losses.viscous * dq + self.losses.coulomb * slip)

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        return torque

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """Semi-implicit Euler's method; what slides at the start has slid before."""
        q, dq = np.array(states)
        slip, stops = np.tanh(dq / self.losses.transition), self.losses.range > 0.0
        reach = np.where(stops, self.losses.range, 1.0)
        for torque in _at_steps(drive + extra, interval, ROLLOUT_STEP):
            dq = dq + ROLLOUT_STEP * self.arm.forward_dynamics(q, dq, torque - self._friction(dq, slip))
            q = q + ROLLOUT_STEP * dq
            held = np.clip(slip + ROLLOUT_STEP * dq / reach, -1.0, 1.0)
            slip = np.where(stops, held, np.tanh(dq / self.losses.transition))
        return np.stack([q, dq])


class LoadedMjcf(LoadedModel):
    """An MJCF in MuJoCo, without its joint limits, which a log may touch."""

    def __init__(self, path: Path, joints: tuple[str, ...], payload: Payload | None = None) -> None:
        mujoco.set_mju_user_warning(lambda _: None)  # else on the terminal and in a file where the user works
        spec = mujoco.MjSpec.from_file(str(path))
        if payload is not None and payload.mass_kg > 0.0:
            body = spec.joint(joints[-1]).parent.add_body(name="known_payload", pos=payload.com_m)
            body.mass, body.inertia, body.ipos = payload.mass_kg, np.full(3, 1e-6 * payload.mass_kg), np.zeros(3)
            body.explicitinertial = True
        self.model = spec.compile()
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.data = mujoco.MjData(self.model)
        named = {self.model.joint(i).name: i for i in range(self.model.njnt)}
        self.main = np.array([self.model.jnt_dofadr[named[name]] for name in joints])
        springs = [named[name + SPRING_SUFFIX] for name in joints if name + SPRING_SUFFIX in named]
        self.springs = self.model.jnt_dofadr[springs]
        motors = [self.model.actuator(name).id for name in joints]
        self.motors = np.array(motors)
        self.gear, self.bias = self.model.actuator_gear[motors, 0], self.model.actuator_biasprm[motors, 0]
        sensors = [self.model.sensor(f"{name}_log").id for name in joints]
        self.cutoff = np.where(self.model.sensor_cutoff[sensors] > 0.0, self.model.sensor_cutoff[sensors], np.inf)
        self.delay = float(self.model.sensor_delay[sensors[0]])

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        return shifted(log, -self.delay, interval)

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        out = np.empty_like(q)
        twists = self.deflections(q, dq, ddq, interval)
        for k, state in enumerate(zip(q, dq, ddq, strict=True)):
            self._place(*state, *twists[k])
            mujoco.mj_inverse(self.model, self.data)
            out[k] = self.data.qfrc_inverse[self.main]
        return out

    def deflections(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T 3 s"]:
        """From balance under the load, in small steps, the joints' motion on straight lines between samples."""
        found = np.zeros((len(q), 3, len(self.springs)))
        if len(self.springs) == 0 or interval <= 0.0:
            return found
        states = np.stack([q, dq, ddq], axis=1)
        first, second = (self._sag(states[k]) for k in (0, 1))
        found[0, :2] = first, (second - first) / interval
        for k in range(1, len(q)):
            found[k] = self._deflect(states[k - 1], states[k], found[k - 1], interval)
        return found

    def _place(self, q: Array, dq: Array, ddq: Array, twist: Array, rate: Array, change: Array | float = 0.0) -> None:
        for target, values, behind in (
            (self.data.qpos, q, twist),
            (self.data.qvel, dq, rate),
            (self.data.qacc, ddq, change),
        ):
            target[self.main] = values
            target[self.springs] = behind

    def _sag(self, state: Float[Array, "3 n"]) -> Float[Array, " s"]:
        """Deflections in balance with the load of a state."""
        none = np.zeros(len(self.springs))
        self._place(state[0], state[1], state[2], none, none)
        mujoco.mj_inverse(self.model, self.data)
        stiffness = self.model.jnt_stiffness[self.model.dof_jntid[self.springs]]
        return np.asarray(-self.data.qfrc_inverse[self.springs] / stiffness)

    def _deflect(self, before: Array, after: Array, twist: Array, interval: float) -> Float[Array, "3 s"]:
        """Deflections, rates and accelerations one sample on."""
        steps = max(1, int(np.ceil(interval / SPRING_STEP)))
        x, v, change = twist
        for step in range(1, steps + 1):
            v = v + interval / steps * change
            x = x + interval / steps * v
            change = self._spring_acceleration(before + step / steps * (after - before), x, v)
        return np.stack([x, v, change])

    def _spring_acceleration(self, state: Array, x: Array, v: Array) -> Array:
        """By what two inverse dynamics leave on the springs; each spring feels its own acceleration only."""
        left = []
        for change in (0.0, 1.0):
            self._place(state[0], state[1], state[2], x, v, change)
            mujoco.mj_inverse(self.model, self.data)
            left.append(np.array(self.data.qfrc_inverse[self.springs]))
        return np.asarray(-left[0] / (left[1] - left[0]))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        log = shifted(torque / self.gear - self.bias, self.delay, interval)
        return np.clip(log, -self.cutoff, self.cutoff)

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """MuJoCo's own steps, the log as `ctrl`."""
        step, ends = float(self.model.opt.timestep), []
        driven, added = (_at_steps(one, interval, step) for one in (drive, extra))
        for k, twist in enumerate(twists):
            mujoco.mj_resetData(self.model, self.data)
            self._place(states[0, k], states[1, k], np.zeros_like(states[0, k]), *twist)
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
    at = (np.arange(0.0, (values.shape[1] - 1) * interval - 0.5 * step, step) + 0.5 * step) / interval
    whole = np.minimum(at.astype(int), values.shape[1] - 2)
    share = (at - whole)[:, None, None]
    rows = np.moveaxis(values, 1, 0)
    return np.asarray((1.0 - share) * rows[whole] + share * rows[whole + 1])
