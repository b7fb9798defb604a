"""One arm in one world: MuJoCo's rigid body, LuGre bristles, springy and loose gears, a PD controller."""

from typing import Any

import mujoco
import numpy as np

from tests.bench.other_simulator.drawn import Arm, Effect, World

# Of the integration [s].
STEP = 0.0005


class Simulator:
    """One arm in one world with its effects; all runs at once."""

    def __init__(self, text: str, world: World, arm: Arm, effects: tuple[Effect, ...], rng: np.random.Generator):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.model.opt.timestep = STEP
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.nominal = mujoco.MjModel.from_xml_string(text)
        self.nominal.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.world, self.arm, self.effects = world, arm, effects
        self.n = self.model.nv
        off = np.random.default_rng(int(rng.integers(2**32)))
        for body in range(1, self.model.nbody):
            self.model.body_mass[body] *= 1.0 + world.links_off * off.standard_normal()
            self.model.body_inertia[body] *= 1.0 + world.links_off * off.standard_normal()
            self.model.body_ipos[body] *= 1.0 + world.links_off * off.standard_normal()
        self._change_bodies()
        self.soft = [e for e in effects if e.name in ("joint_elasticity", "backlash")]
        rigid = np.ones(self.n, bool)
        for e in self.soft:
            rigid[e.joint] = False
        self.model.dof_armature[:] = np.where(rigid, arm.rotor, 0.0)
        self.rigid = rigid
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def _change_bodies(self) -> None:
        last = int(self.model.jnt_bodyid[-1])
        for e in self.effects:
            if e.name == "payload":
                self._add(last, e.size, np.array([e.figures["x"], e.figures["y"], e.figures["z"]]))
            if e.name == "link_inertial_error":
                body = int(self.model.jnt_bodyid[e.joint])
                self.model.body_mass[body] *= 1.0 + e.size
                self.model.body_inertia[body] *= 1.0 + e.size
                shift = e.size * 0.05 * np.array([e.figures["x"], e.figures["y"], e.figures["z"]])
                self.model.body_ipos[body] += shift
            if e.name == "gravity_misalignment":
                g = 9.81
                a, b = e.size * np.cos(e.figures["way"]), e.size * np.sin(e.figures["way"])
                self.model.opt.gravity[:] = [g * np.sin(a), g * np.sin(b), -g * np.cos(np.hypot(a, b))]

    def _add(self, body: int, mass: float, place: np.ndarray) -> None:
        """A point-like mass joins a body: masses, centres and inertias combine."""
        m = self.model
        frame = np.zeros(9)
        mujoco.mju_quat2Mat(frame, m.body_iquat[body])
        turn = frame.reshape(3, 3)
        old = turn @ np.diag(m.body_inertia[body]) @ turn.T
        total = m.body_mass[body] + mass
        centre = (m.body_mass[body] * m.body_ipos[body] + mass * place) / total

        def shifted(weight: float, r: np.ndarray) -> np.ndarray:
            return weight * (r @ r * np.eye(3) - np.outer(r, r))

        whole = old + shifted(m.body_mass[body], m.body_ipos[body] - centre) + shifted(mass, place - centre)
        values, axes = np.linalg.eigh(whole + 1e-3 * mass * np.eye(3))
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, axes.ravel())
        m.body_mass[body], m.body_ipos[body] = total, centre
        m.body_inertia[body], m.body_iquat[body] = values, quat

    def run(self, reference: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """References `[R T n]` at the step's rate -> logged states and torques `[R T n]`, and the effects' torque."""
        R, T, n = reference.shape
        speed = np.gradient(reference, STEP, axis=1)
        accel = np.gradient(speed, STEP, axis=1)
        feed = self._feed_forward(reference, speed, accel)
        data = [mujoco.MjData(self.model) for _ in range(R)]
        for d, q0 in zip(data, reference[:, 0], strict=True):
            d.qpos[:] = q0
        inertia = self._typical_inertia(reference[0, 0])
        w = 2 * np.pi * self.world.bandwidth
        stiff, damp = inertia * w**2, 1.4 * inertia * w
        spread = 1.0 + self.world.between_runs * rng.standard_normal((R, 1, n))[:, 0]
        bristle, slow = np.zeros((R, n)), np.zeros((R, n))
        rotor, rotor_speed = reference[:, 0].copy(), np.zeros((R, n))
        log = {k: np.zeros((R, T, n)) for k in ("q", "v", "tau", "extra")}
        zero = np.zeros(n)
        for e in self.effects:
            if e.name == "encoder_offset":
                zero[e.joint] = e.size
        torque = feed[:, 0].copy()
        gap = self.world.seconds + 20.0
        q = np.zeros((R, n))
        v = np.zeros((R, n))
        rest = np.zeros((R, n))
        for k in range(T):
            for r, d in enumerate(data):
                q[r], v[r] = d.qpos, d.qvel
            motor_q = np.where(self.rigid, q, rotor)
            motor_v = np.where(self.rigid, v, rotor_speed)
            command = feed[:, k] + stiff * (reference[:, k] - motor_q - zero) + damp * (speed[:, k] - motor_v)
            rest = np.where(np.abs(motor_v) < 0.005, rest + STEP, 0.0)
            clock = k * STEP + gap * np.arange(R)[:, None]
            friction, extra, bristle, slow = self._friction(
                motor_q, motor_v, torque, clock, spread, bristle, slow, rest
            )
            outer, recorded = self._others(q, motor_q, motor_v, command, clock, k, data)
            torque = command
            delivered = command - recorded
            net = delivered - friction - outer
            for e in self.soft:
                j = e.joint
                twist = rotor[:, j] - q[:, j]
                if e.name == "backlash":
                    half = 0.5 * e.size
                    twist = np.sign(twist) * np.maximum(np.abs(twist) - half, 0.0)
                spring = e.figures["K"] if e.name == "backlash" else 1.0 / e.size
                bend = spring * twist + 0.03 * np.sqrt(spring * self.arm.rotor[j]) * (rotor_speed[:, j] - v[:, j])
                rotor_speed[:, j] += STEP * (net[:, j] - bend) / self.arm.rotor[j]
                rotor[:, j] += STEP * rotor_speed[:, j]
                net[:, j] = bend
            for r, d in enumerate(data):
                d.qfrc_applied[:] = net[r]
                mujoco.mj_step(self.model, d)
            log["q"][:, k], log["v"][:, k], log["tau"][:, k] = motor_q + zero, motor_v, command
            log["extra"][:, k] = extra + outer + recorded
        return log

    def _typical_inertia(self, q: np.ndarray) -> np.ndarray:
        d = mujoco.MjData(self.nominal)
        d.qpos[:] = q
        mujoco.mj_forward(self.nominal, d)
        full = np.zeros((self.n, self.n))
        mujoco.mj_fullM(self.nominal, d, full)
        return np.diag(full) + self.arm.rotor

    def _feed_forward(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """The nominal rigid body every tenth step, linear between, with the usual viscous friction."""
        d = mujoco.MjData(self.nominal)
        out = np.zeros_like(q)
        every = np.arange(0, q.shape[1], 10)
        for r in range(q.shape[0]):
            some = np.zeros((len(every), self.n))
            for i, k in enumerate(every):
                d.qpos[:], d.qvel[:], d.qacc[:] = q[r, k], v[r, k], a[r, k]
                mujoco.mj_inverse(self.nominal, d)
                some[i] = d.qfrc_inverse
            for j in range(self.n):
                out[r, :, j] = np.interp(np.arange(q.shape[1]), every, some[:, j])
        return out + 0.8 * self.arm.viscous * v + self.arm.rotor * a

    def _friction(
        self,
        q: np.ndarray,
        v: np.ndarray,
        torque: np.ndarray,
        clock: np.ndarray,
        spread: np.ndarray,
        bristle: np.ndarray,
        slow: np.ndarray,
        rest: np.ndarray,
    ) -> tuple[np.ndarray, ...]:
        """Bristle friction `[R n]`, the effects' share of it, and the bristles' next states."""
        arm = self.arm
        level = arm.coulomb * spread
        viscous = np.broadcast_to(arm.viscous, v.shape) * spread
        plain = level.copy()
        thin = viscous.copy()
        more = np.zeros_like(v)
        for e in self.effects:
            j, f = e.joint, e.figures
            level, viscous = level.copy(), viscous.copy()
            if e.name == "stribeck_friction":
                level[:, j] += e.size * np.exp(-(np.abs(v[:, j] / f["vs"]) ** f["delta"]))
            elif e.name == "nonlinear_viscous_friction":
                more[:, j] += (
                    e.size * np.sign(v[:, j]) * np.abs(v[:, j]) ** f["power"] * np.minimum(np.abs(v[:, j]) / 0.01, 1)
                )
            elif e.name == "load_dependent_friction":
                level[:, j] += e.size * np.abs(torque[:, j] - 0.5 * arm.coulomb[j] * np.sign(v[:, j]))
            elif e.name == "thermal_friction":
                warm = 1.0 - np.exp(-clock[:, 0] / f["tau"])
                viscous[:, j] *= 1.0 - e.size * warm
                level[:, j] *= 1.0 - 0.4 * e.size * warm
            elif e.name == "position_dependent_friction":
                level[:, j] *= 1.0 + e.size * np.cos(f["k"] * q[:, j] + f["phi"])
            elif e.name == "asymmetric_friction":
                level[:, j] *= 1.0 + e.size * np.sign(v[:, j]) * np.minimum(np.abs(v[:, j]) / 0.002, 1.0)
                viscous[:, j] *= 1.0 + e.size * np.sign(v[:, j])
            elif e.name == "joint_coupling":
                other = int(f["other"])
                both = v[:, other] + (v[:, j] if f["sum"] else 0.0)
                more[:, j] += e.size * (np.tanh(both / 0.02) + 0.4 * both)
            elif e.name == "seal_after_rest":
                level[:, j] += e.size * np.exp(-np.maximum(0.6 - rest[:, j], 0.0) / 0.1)
        level = np.maximum(level, 0.05 * arm.coulomb)
        viscous = np.maximum(viscous, 0.05 * arm.viscous)
        width = arm.coulomb / arm.bristle
        fade = np.exp(-np.abs(v) * width / level * STEP)
        slip = level * np.sign(v) / width
        bristle = np.where(np.abs(v) > 1e-9, slip + (bristle - slip) * fade, bristle)
        friction = width * bristle + viscous * v + more
        for e in self.effects:
            if e.name == "presliding_hysteresis":
                j, reach = e.joint, e.figures["reach"]
                slow = slow.copy()
                slow[:, j] = np.clip(slow[:, j] + v[:, j] * STEP, -reach, reach)
                friction[:, j] += e.size * slow[:, j] / reach
                more[:, j] += e.size * (slow[:, j] / reach - np.sign(v[:, j]))
        return friction, (level - plain) * np.sign(v) + (viscous - thin) * v + more, bristle, slow

    def _others(
        self,
        q: np.ndarray,
        mq: np.ndarray,
        v: np.ndarray,
        command: np.ndarray,
        clock: np.ndarray,
        k: int,
        data: list[Any],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Torques on the link `[R n]`, and what the log tells beyond what the motor delivers."""
        outer, recorded = np.zeros_like(q), np.zeros_like(q)
        for e in self.effects:
            j, f = e.joint, e.figures
            if e.name == "torque_ripple":
                outer[:, j] += e.size * np.cos(f["order"] * mq[:, j] + f["phi"])
            elif e.name == "spring_torque":
                outer[:, j] += e.size * (q[:, j] - f["rest"])
            elif e.name == "cable_at_the_end":
                outer[:, j] += e.size * np.maximum(q[:, j] - f["from"], 0.0) ** 2
            elif e.name == "floor_vibration":
                outer[:, j] += e.size * np.sin(2 * np.pi * f["hertz"] * clock[:, 0])
            elif e.name == "squared_of_neighbour":
                outer[:, j] += e.size * v[:, int(f["other"])] * np.abs(v[:, int(f["other"])])
            elif e.name == "torque_gain_error":
                recorded[:, j] += e.size * command[:, j]
            elif e.name == "torque_offset":
                recorded[:, j] += e.size
            elif e.name == "torque_saturation":
                over = np.maximum(np.abs(command[:, j]) - f["knee"], 0.0)
                recorded[:, j] -= np.sign(command[:, j]) * over**2 / (over + 1.0 / e.size)  # bends, then is flat
            elif e.name == "external_contact":
                when = k * STEP
                for r, d in enumerate(data):
                    if r % 3 == int(f["which"]) and f["from"] < when < f["from"] + f["long"]:
                        push = e.size * np.sin(np.pi * (when - f["from"]) / f["long"]) ** 2
                        jac = np.zeros((3, self.n))
                        body = int(self.model.jnt_bodyid[j])
                        mujoco.mj_jac(self.model, d, jac, None, d.xpos[body], body)
                        outer[r] -= push * (jac.T @ np.array([f["x"], f["y"], f["z"]]))
        # The log tells the command; the drive's readings are off by gain and offset, and flatten.
        return outer, recorded
