"""Laws of the bodies: MuJoCo moves the links as Pinocchio says, and nothing gains or loses energy by itself."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.simulation.hardware import AddedBody, build_model, draw_hardware
from ident.simulation.laws import plain_friction
from ident.simulation.loop import Laws, advance, engine, fresh_state


def compiled(arm, bodies, step=5e-4):
    model = build_model(arm.urdf, arm.joint_names, arm.links, bodies, step)
    return model, mujoco.MjData(model)


def nominal_hardware(arm):
    """The arm exactly as its URDF says, without friction."""
    zero = np.zeros(arm.n)
    drawn = draw_hardware(arm, np.random.default_rng(0), inertia_error=0.0)
    return drawn.replace(friction=plain_friction(zero, zero, np.ones(arm.n)))


class Plant:
    """The plant's own loop on a nominal arm with rotors; its energy."""

    def __init__(self, arm, pose, rotor, viscous=0.0):
        hardware = nominal_hardware(arm)
        self.rotor, self.reference, self.arm = rotor, arm.model.createData(), arm
        self.model, self.data = compiled(arm, hardware.bodies.replace(joint_inertia=rotor))
        self.data.qpos[:] = pose
        mujoco.mj_forward(self.model, self.data)
        self.laws = Laws(hardware.friction, hardware.drive, hardware.heat, hardware.outside, hardware.contact)
        self.laws.friction["viscous"] = viscous
        self.views, self.state = engine(self.model, self.data), fresh_state(arm.n)

    def step(self, k):
        advance(self.views, self.laws, self.state, k * 5e-4)

    def energy(self):
        """Kinetic, potential [J]."""
        q, dq, model = np.array(self.data.qpos), np.array(self.data.qvel), self.arm.model
        kinetic = pin.computeKineticEnergy(model, self.reference, q, dq) + 0.5 * self.rotor @ dq**2
        return kinetic, pin.computePotentialEnergy(model, self.reference, q)


def random_states(arm, count, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)
    for _ in range(count):
        yield rng.uniform(low, high), rng.standard_normal(arm.n), 10.0 * rng.standard_normal(arm.n)


def accelerations(model, data, q, dq, tau):
    n = len(q)
    data.qpos[:n], data.qvel[:n], data.qfrc_applied[:n] = q, dq, tau
    mujoco.mj_forward(model, data)
    return np.array(data.qacc[:n])


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "ur10"])
def test_forward_dynamics_is_pinocchios(robot):
    """With nominal links both engines give the same accelerations to 1e-8."""
    arm = ArmModel.load(robot)
    model, data = compiled(arm, nominal_hardware(arm).bodies)
    reference = arm.model.createData()
    for q, dq, tau in random_states(arm, 30):
        expected = pin.aba(arm.model, reference, q, dq, tau)
        np.testing.assert_allclose(accelerations(model, data, q, dq, tau), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("robot", ["tm5-900", "panda"])
def test_energy_is_kept_without_friction_and_control(robot):
    """A free swing of the plant's own loop: kinetic and potential energy of links and rotors sum to a constant."""
    arm = ArmModel.load(robot)
    plant = Plant(arm, np.clip(np.full(arm.n, 0.5), arm.lower, arm.upper), 0.2 * np.ones(arm.n))
    energies = []
    for k in range(4000):
        plant.step(k)
        energies.append(plant.energy())
    swing, total = np.ptp(energies, axis=0)[0], np.sum(energies, axis=1)
    assert swing > 1.0
    assert np.abs(total - total[0]).max() < 1e-3 * swing


def test_work_of_motors_is_stored_or_lost(arm):
    """With viscous friction only: the motors' work less the friction's loss is the change of energy, to 0.1 %."""
    plant = Plant(arm, 0.4, 0.3 * np.ones(arm.n), viscous=6.0)
    start, work, loss, before = sum(plant.energy()), 0.0, 0.0, np.zeros(arm.n)
    for k in range(3000):
        plant.state["torque"] = np.array([8.0, -30.0, -15.0, 1.0, 0.5, 0.2]) * np.sin(k * 5e-4 * 4.0)
        plant.step(k)
        speed = np.array(plant.data.qvel)
        middle = 0.5 * (before + speed)
        work += plant.state["torque"] @ middle * 5e-4
        loss += 6.0 * before @ middle * 5e-4
        before = speed
    assert loss > 5.0
    assert abs(sum(plant.energy()) - start - work + loss) < 1e-3 * (abs(work) + loss)


def test_payload_is_a_body(arm):
    """A point mass at the flange is the payload of the arm model."""
    bodies = nominal_hardware(arm).bodies.replace(added=(AddedBody(arm.links[-1], 1.2, (0.02, -0.03, 0.08)),))
    model, data = compiled(arm, bodies)
    loaded = arm.with_payload(Payload(1.2, (0.02, -0.03, 0.08)))
    for q, dq, tau in random_states(arm, 10):
        acceleration = accelerations(model, data, q, dq, tau)
        again = loaded.inverse_dynamics(q[None], dq[None], acceleration[None])[0]
        np.testing.assert_allclose(again, tau, atol=1e-8)
