"""Laws of the plant's bodies and friction: they move as Pinocchio says, stick, slide, and give no energy."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.simulation.hardware import AddedBody, build_model, draw_hardware
from ident.simulation.laws import (
    bristle,
    change_law,
    cool_down,
    heat_law,
    make_law,
    plain_friction,
    remembered_torque,
    sliding_level,
    warm_up,
)
from ident.simulation.loop import Laws, advance, engine, fresh_state
from ident.simulation.sensing import Sensing, read_encoder, torque_noise


def joint(**values):
    law = plain_friction(np.array([10.0]), np.array([5.0]), np.array([1.0]))
    return change_law(law, **values)[0]


def level(record, v, angle=0.0, load=0.0, acceleration=0.0, warm=0.0):
    return sliding_level(record, v, angle, load, acceleration, warm)


def test_levels_move_with_their_own_cause_only():
    """Stribeck with low speed, load with torque, seat with angle, heat with temperature, skidding with acceleration."""
    assert level(joint(stribeck=4.0), 1e-4) == pytest.approx(14.0, rel=1e-2)
    assert level(joint(stribeck=4.0), 2.0) == pytest.approx(10.0, rel=1e-6)
    assert level(joint(load=0.1), 0.5, load=50.0) > level(joint(load=0.1), 0.5, load=-50.0) > 13.0
    assert level(joint(load=0.1), 0.5) == pytest.approx(10.0, abs=0.1)
    angles = [level(joint(seat=0.2), 0.5, angle=a) for a in np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)]
    assert np.mean(angles) == pytest.approx(10.0, rel=1e-3)
    assert np.ptp(angles) == pytest.approx(4.0, rel=0.1)
    assert level(joint(thermal_coulomb=0.01), 0.5, warm=20.0) == pytest.approx(10.0 * np.exp(-0.2))
    assert level(joint(skid=3.0), 0.5, acceleration=20.0) == pytest.approx(13.0, rel=1e-3)
    assert level(joint(coulomb_skew=2.0), 0.5) - level(joint(coulomb_skew=2.0), -0.5) == pytest.approx(2.0)


def test_heat_settles_where_loss_and_cooling_balance():
    """Under the rated loss the lubricant ends at the stated rise, and cools down in a pause."""
    network = heat_law(np.array([6.0]), rise=25.0, time_constant=20.0)
    state, record = fresh_state(1), network[0]
    for _ in range(200000):
        warm_up(record, state[0], 6.0, 0.02)
    assert state["lubricant_rise"][0] == pytest.approx(25.0, rel=0.02)
    rise = np.column_stack([state["lubricant_rise"], state["housing_rise"]])
    assert cool_down(network, rise, 0.0) == pytest.approx(rise)
    assert cool_down(network, rise, 1e5) == pytest.approx(0.0, abs=1e-3)
    twice = cool_down(network, cool_down(network, rise, 30.0), 30.0)
    assert twice == pytest.approx(cool_down(network, rise, 60.0))


TICK = 1e-3


def follow(angle, transmitted=0.0, **law):  # type: ignore[no-untyped-def]
    """Torque of a law along a path of one joint."""
    joint = make_law("outside", 1, **law)[0]
    state = fresh_state(1)
    state["transmitted"] = transmitted
    speed = np.gradient(angle, TICK)
    return np.array([remembered_torque(joint, state[0], q, v, TICK) for q, v in zip(angle, speed, strict=True)])


def at_speed(speed, seconds=2.0):  # type: ignore[no-untyped-def]
    return speed * np.arange(round(seconds / TICK)) * TICK


def test_a_seal_is_viscous_when_slow_and_a_spring_when_quick() -> None:
    assert follow(at_speed(0.2), seal=10.0, seal_relaxation=0.1)[-1] == pytest.approx(-10.0 * 0.2 * 0.1, rel=1e-2)
    t = np.arange(2000) * TICK
    quick = 0.01 * np.sin(2 * np.pi * 20.0 * t)
    torque = follow(quick, seal=10.0, seal_relaxation=1.0)
    assert np.corrcoef(torque[1000:], quick[1000:])[0, 1] < -0.99


def test_rest_strengthens_a_contact_and_slip_renews_it() -> None:
    moving = at_speed(0.3)
    rested = np.concatenate([np.zeros(3000), moving])
    fresh, aged = follow(moving, ageing=1.0, ageing_slip=0.01), follow(rested, ageing=1.0, ageing_slip=0.01)[3000:]
    assert -aged[:20].mean() > 2.0 * -fresh[:20].mean()
    assert aged[-1] == pytest.approx(fresh[-1], rel=1e-3)
    assert follow(-moving, ageing=1.0)[-1] > 0.0


def test_tooth_friction_turns_round_within_a_tooth_and_needs_load() -> None:
    angle = at_speed(0.5)
    torque = follow(angle, transmitted=40.0, tooth=0.05, tooth_order=20.0)
    assert torque.max() == pytest.approx(2.0, rel=0.02)
    assert torque.min() == pytest.approx(-2.0, rel=0.02)
    assert abs(torque[: round(2 * np.pi / 20 / 0.5 / TICK)].mean()) < 0.05
    assert not follow(angle, tooth=0.05).any()


def test_a_kinematic_error_shakes_hardest_at_the_resonance() -> None:
    law = {"wobble": 1e-3, "wobble_order": 100.0, "wobble_inertia": 1.0, "wobble_resonance": 60.0}
    below, at, above = (np.abs(follow(at_speed(v), **law)[200:]).max() for v in (0.2, 0.6, 1.8))
    assert at > 5.0 * below
    assert at > 1.2 * above


RATED, RATIO = np.array([157.0, 43.0]), np.array([100.0, 80.0])
TICKS = np.arange(4001) * 1e-3
TIMES = np.arange(1000) * 4e-3
WAVE = np.column_stack([20.0 * np.sin(2.0 * TICKS), 5.0 * np.cos(3.0 * TICKS)])


def true(times=TIMES):
    return np.column_stack([20.0 * np.sin(2.0 * times), 5.0 * np.cos(3.0 * times)])


def test_noise_has_the_stated_size_and_colour():
    sensing = Sensing.typical(RATED, RATIO)
    noise = torque_noise(sensing, 40000, 4e-3, np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), sensing.noise_floor, rtol=0.05)
    assert ((noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0) > 0.2).all()


def test_encoders_count():
    """Readings are whole counts of the motor's encoder, near the truth."""
    sensing = Sensing.typical(RATED, RATIO)
    reading = read_encoder(sensing, TICKS, WAVE, TIMES, np.random.default_rng(0))
    counts = reading / sensing.count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert np.abs(reading - true())[:, 0].max() < 1e-4


DT = 5e-4


def test_a_cycle_loses_energy():
    """Over any closed path friction takes energy, also below the breakaway."""
    for amplitude in (1e-5, 1e-4, 1e-2):
        phase = np.linspace(0.0, 8.0 * np.pi, 8000)
        speed, z, work = amplitude * np.cos(phase) * np.pi, 0.0, 0.0
        for v in speed:
            z, torque = bristle(z, v, 10.0, 5e4, 100.0, DT)
            work += torque * v * DT
        assert work > 0.0


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_rest_holds_any_torque_below_the_level(share):
    """A body pushed with less than the level creeps by no more than the presliding; with more it runs away."""
    travel = []
    for load in (share * 10.0, 1.3 * 10.0):
        z = v = x = 0.0
        for k in range(6000):
            z, torque = bristle(z, v, 10.0, 5e4, 250.0, DT)
            v += DT * (load * min(k / 3000, 1.0) - torque)
            x += DT * v
        travel.append(x)
    assert travel[0] < 2e-3
    assert travel[1] > 1.0


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
