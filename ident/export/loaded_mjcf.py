"""A written MJCF in MuJoCo."""

from __future__ import annotations

from pathlib import Path
from warnings import catch_warnings

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.export.loaded_model import LOST, LoadedModel, at_steps
from ident.export.mjcf import SPRING_SUFFIX
from ident.laws.acting import shifted
from ident.recordings.recording import Payload

# The deflection of an elastic joint is integrated with steps no longer than this [s], and than so
# much of its swing.
SPRING_STEP = 1e-3
SPRING_TURN = 0.1
# Newton's steps to the springs' balance at the start, and by how much one is bent for its slope
# [rad].
BALANCE_STEPS = 4
BALANCE_SLOPE = 1e-6
# Inertia of a known payload, a point, for MuJoCo, which asks for some [m²] a kilogram.
POINT = 1e-6

# What diverges is found here and reported; MuJoCo would append it to a file in the folder where
# the user is.
mujoco.set_mju_user_warning(lambda message: None)


class LoadedMjcf(LoadedModel):
    """An MJCF in MuJoCo, without its joint limits, which a log may touch."""

    form = "mjcf"

    def __init__(self, path: Path, joints: tuple[str, ...], payload: Payload | None = None) -> None:
        mujoco.set_mju_user_warning(lambda _: None)  # else on the terminal and in a file here
        spec = mujoco.MjSpec.from_file(str(path))
        if payload is not None and payload.mass_kg > 0.0:
            _add_payload(spec, joints[-1], payload)
        with catch_warnings(action="ignore"):  # of links without inertia, as a URDF may have them
            self.model = spec.compile()
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.data = mujoco.MjData(self.model)
        numbers = {self.model.joint(k).name: k for k in range(self.model.njnt)}
        self.main = np.array([self.model.jnt_dofadr[numbers[name]] for name in joints])
        elastic = [name + SPRING_SUFFIX for name in joints]
        springs = [numbers[name] for name in elastic if name in numbers]
        self.springs = self.model.jnt_dofadr[springs]
        self.stiffness = self.model.jnt_stiffness[springs]
        motors = [self.model.actuator(name).id for name in joints]
        self.motors = np.array(motors)
        self.gear = self.model.actuator_gear[motors, 0]
        self.bias = self.model.actuator_biasprm[motors, 0]
        sensors = [self.model.sensor(f"{name}_log").id for name in joints]
        cutoff = self.model.sensor_cutoff[sensors]
        self.cutoff = np.where(cutoff > 0.0, cutoff, np.inf)
        self.delay = float(self.model.sensor_delay[sensors[0]])

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        log = shifted(torque / self.gear - self.bias, self.delay, interval)
        return np.clip(log, -self.cutoff, self.cutoff)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        return shifted(log, -self.delay, interval)

    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        torque = np.empty_like(q)
        deflections = self.deflections(q, dq, ddq, interval)
        for k, state in enumerate(zip(q, dq, ddq, strict=True)):
            self._place(np.array(state), deflections[k])
            mujoco.mj_inverse(self.model, self.data)
            torque[k] = self.data.qfrc_inverse[self.main]
        return torque

    def deflections(
        self, q: Array, dq: Array, ddq: Array, interval: float
    ) -> Float[Array, "T 3 s"]:
        """From balance under the load, in small steps, the joints' motion on straight lines between
        samples.
        """
        springs = np.zeros((len(q), 3, len(self.springs)))
        if len(self.springs) == 0 or interval <= 0.0:
            return springs
        states = np.stack([q, dq, ddq], axis=1)
        springs[0] = self._at_start(states, interval)
        steps = self._steps(states[0], springs[0], interval)
        for k in range(1, len(q)):
            twist, rate, acceleration = springs[k - 1]
            for step in range(1, steps + 1):
                rate = rate + interval / steps * acceleration
                twist = twist + interval / steps * rate
                change = states[k] - states[k - 1]
                state = states[k - 1] + step / steps * change
                acceleration = self._acceleration(state, twist, rate)
            springs[k] = (twist, rate, acceleration)
        # Between straight lines a spring jerks at each sample; what it does on the whole is in its
        # rates.
        springs[:, 2] = np.gradient(springs[:, 1], interval, axis=0)
        return springs

    def _steps(
        self, state: Float[Array, "3 n"], spring: Float[Array, "3 s"], interval: float
    ) -> int:
        """Steps between two samples that are short beside the fastest spring's swing."""
        twist, rate, _ = spring
        with_unit = self._on_springs(state, twist, rate, 1.0)
        without = self._on_springs(state, twist, rate, 0.0)
        swing = float(np.sqrt(np.max(self.stiffness / (with_unit - without))))
        longest = min(SPRING_STEP, SPRING_TURN / swing)
        return max(1, int(np.ceil(interval / longest)))

    def _at_start(self, states: Float[Array, "T 3 n"], interval: float) -> Float[Array, "3 s"]:
        """Springs in balance under the load, that give way as it grows: nothing swings."""
        still = np.zeros(len(self.springs))
        load = -self._on_springs(states[0], still, still, 0.0)
        next_load = -self._on_springs(states[1], still, still, 0.0)
        twist = load / self.stiffness
        rate = (next_load - load) / (self.stiffness * interval)
        for _ in range(BALANCE_STEPS):  # the load changes with the deflection
            left = self._on_springs(states[0], twist, still, 0.0)
            ahead = self._on_springs(states[0], twist + BALANCE_SLOPE, still, 0.0)
            twist = twist - BALANCE_SLOPE * left / (ahead - left)
        return np.stack([twist, rate, self._acceleration(states[0], twist, rate)])

    def _acceleration(
        self, state: Float[Array, "3 n"], twist: Array, rate: Array
    ) -> Float[Array, " s"]:
        """By what two inverse dynamics leave on the springs [rad/s²].

        Each spring feels its own acceleration only.
        """
        left = self._on_springs(state, twist, rate, 0.0)
        with_unit = self._on_springs(state, twist, rate, 1.0)
        return -left / (with_unit - left)

    def _on_springs(
        self, state: Float[Array, "3 n"], twist: Array, rate: Array, acceleration: float
    ) -> Float[Array, " s"]:
        """Torque that inverse dynamics leave on the springs [N m].

        Args:
            state: Joints' positions, velocities and accelerations.
            twist: The springs' deflections [rad].
            rate: Their rates [rad/s].
            acceleration: That of every spring [rad/s²].
        """
        same = np.full(len(self.springs), acceleration)
        self._place(state, np.stack([twist, rate, same]))
        mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse[self.springs])

    def _place(self, state: Float[Array, "3 n"], springs: Float[Array, "3 s"]) -> None:
        """Sets positions, velocities and accelerations of joints and of springs."""
        targets = (self.data.qpos, self.data.qvel, self.data.qacc)
        for target, joint, spring in zip(targets, state, springs, strict=True):
            target[self.main] = joint
            target[self.springs] = spring

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """MuJoCo's own steps, the log as `ctrl`."""
        step = float(self.model.opt.timestep)
        controls = at_steps(drive, interval, step)
        added = at_steps(extra, interval, step)
        ends = []
        for k, (twist, rate) in enumerate(twists):
            position, velocity = states[:, k]
            mujoco.mj_resetData(self.model, self.data)
            start = np.stack([position, velocity, np.zeros_like(position)])
            self._place(start, np.stack([twist, rate, np.zeros_like(twist)]))
            for control, torque in zip(controls[:, k], added[:, k], strict=True):
                self.data.ctrl[self.motors] = control
                self.data.qfrc_applied[self.main] = torque
                mujoco.mj_step(self.model, self.data)
            if self._diverged():  # MuJoCo begins anew at its own pose
                ends.append((position + LOST, velocity))
            else:
                reached = self.data.qpos[self.main].copy()
                ends.append((reached, self.data.qvel[self.main].copy()))
        return np.moveaxis(np.array(ends), 1, 0)

    def _diverged(self) -> bool:
        """Whether MuJoCo met a state that is no number since its data were reset."""
        warnings = self.data.warning[mujoco.mjtWarning.mjWARN_BADQPOS :]
        return any(warning.number for warning in warnings)


def _add_payload(spec: mujoco.MjSpec, joint: str, payload: Payload) -> None:
    """Adds a known payload, a point, to the body that a joint moves."""
    body = spec.joint(joint).parent.add_body(name="known_payload", pos=payload.com_m)
    body.mass = payload.mass_kg
    body.inertia = np.full(3, POINT * payload.mass_kg)
    body.ipos = np.zeros(3)
    body.explicitinertial = True
