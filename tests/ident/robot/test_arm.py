"""Laws of the rigid arm: inverse dynamics, its derivatives, and the regressor, τ = Y π."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.errors import RobotError
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from tests.ident.made_up import joint, link, random_states, sliding_arm, urdf

ROBOTS = ("tm5-900", "panda", "ur10", "so100", "sliding")


@pytest.fixture(scope="module", params=ROBOTS)
def arm(request: pytest.FixtureRequest) -> ArmModel:
    return sliding_arm() if request.param == "sliding" else ArmModel.load(request.param)


@pytest.fixture(scope="module")
def tm5() -> ArmModel:
    return ArmModel.load("tm5-900")


def _changed(arm: ArmModel, seed: int = 3) -> ArmModel:
    """The arm with every inertial number 10 % off: no body that exists, but a legal point of a search."""
    noise = np.random.default_rng(seed).standard_normal(10 * arm.n)
    return arm.with_inertial_parameters(arm.inertial_parameters * (1 + 0.1 * noise))


def test_inverse_dynamics_equals_pinocchio_state_by_state(arm: ArmModel) -> None:
    """The batch is rnea of every state, to 1e-12 of the torque's size."""
    states = random_states(np.random.default_rng(1), 50, arm.n)
    data = arm.model.createData()
    expected = np.array([pin.rnea(arm.model, data, *state) for state in zip(*states, strict=True)])
    torque = arm.inverse_dynamics(*states)
    assert torque.shape == (50, arm.n)
    assert np.allclose(arm.with_gravity(np.zeros(3)).gravity(states[0]), 0.0, atol=1e-12)
    assert np.allclose(torque, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("samples", [0, 1, 2, 3])
def test_small_batches_keep_their_shape(arm: ArmModel, samples: int) -> None:
    """No state, one state, fewer states than threads: shape (T, n)."""
    states = random_states(np.random.default_rng(1), samples, arm.n)
    assert arm.inverse_dynamics(*states).shape == (samples, arm.n)
    assert arm.regressor(*states).shape == (samples, arm.n, 10 * arm.n)


def test_power_is_the_rate_of_energy(tm5: ArmModel) -> None:
    """τ·dq = d(T + V)/dt on a free motion: the sign of gravity and of every inertia is right (to 1e-5 W of 100 W)."""
    time = np.arange(0, 1, 1e-4)
    size, rate = np.linspace(0.3, 0.8, 6), np.linspace(2, 5, 6)
    q = size * np.sin(rate * time[:, None])
    dq, ddq = size * rate * np.cos(rate * time[:, None]), -size * rate**2 * np.sin(rate * time[:, None])
    data = tm5.model.createData()
    energy = [pin.computeMechanicalEnergy(tm5.model, data, a, b) for a, b in zip(q, dq, strict=True)]
    power = (tm5.inverse_dynamics(q, dq, ddq) * dq).sum(axis=1)
    assert np.allclose(np.gradient(energy, time)[1:-1], power[1:-1], atol=1e-5 * np.abs(power).max())


def test_inertial_parameters_come_back(arm: ArmModel) -> None:
    """Parameters put in are read out, also those that no body can have."""
    changed = _changed(arm)
    again = arm.with_inertial_parameters(changed.inertial_parameters)
    assert np.allclose(again.inertial_parameters, changed.inertial_parameters, rtol=1e-12, atol=1e-14)
    states = random_states(np.random.default_rng(4), 10, arm.n)
    same = arm.with_inertial_parameters(arm.inertial_parameters)
    assert np.allclose(same.inverse_dynamics(*states), arm.inverse_dynamics(*states), atol=1e-11)


def test_changed_copies_leave_the_arm_alone(tm5: ArmModel) -> None:
    """Payload, gravity and inertias make new arms, no payload none; the old one gives its torque to the last bit."""
    assert tm5.with_payload(None) is tm5.with_payload(Payload(0.0, (1.0, 1.0, 1.0))) is tm5.locked([]) is tm5
    states = random_states(np.random.default_rng(5), 10, 6)
    before = tm5.inverse_dynamics(*states)
    _changed(tm5).inverse_dynamics(*states)
    tm5.with_payload(Payload(1.0, (0.0, 0.0, 0.1))).inverse_dynamics(*states)
    tm5.with_gravity(np.array([1.0, 2.0, 3.0])).inverse_dynamics(*states)
    tm5.locked(["joint_6"])
    assert np.array_equal(tm5.inverse_dynamics(*states), before)


@pytest.mark.parametrize("robot", ["nominal", "changed inertias", "slides"])
@pytest.mark.parametrize("kept", [(0, 1, 2), (0, 2), (1, 3), (3,)])
def test_locked_joints_are_the_full_arm_with_them_frozen(tm5: ArmModel, kept: tuple[int, ...], robot: str) -> None:
    """The reduced arm's torque is the full arm's on the free joints with the others at rest, to 1e-9 N m.

    Also where the inertias were changed after loading, joints slide, and whether the locked are first, last or between.
    """
    rng = np.random.default_rng(6)
    full = {"nominal": tm5, "changed inertias": _changed(tm5), "slides": sliding_arm()}[robot]
    locked = [i for i in range(full.n) if i not in kept]
    positions = rng.uniform(-2, 2, len(locked))
    reduced = full.locked([full.joint_names[i] for i in locked], positions)
    states = random_states(rng, 200, len(kept))
    whole = [np.zeros((200, full.n)) for _ in range(3)]
    whole[0][:, locked] = positions
    for big, small in zip(whole, states, strict=True):
        big[:, list(kept)] = small
    expected = full.inverse_dynamics(*whole)[:, list(kept)]
    assert reduced.joint_names == tuple(full.joint_names[i] for i in kept)
    assert reduced.locked_joints == dict(zip([full.joint_names[i] for i in locked], positions, strict=True))
    assert np.allclose(reduced.inverse_dynamics(*states), expected, rtol=0, atol=1e-9)


def test_locking_step_by_step_is_locking_at_once(tm5: ArmModel) -> None:
    """Two reductions after each other, under tilted gravity, are one."""
    tilted = tm5.with_gravity(np.array([3.0, 0.0, -9.0]))
    once = tilted.locked(["joint_4", "joint_6"], [0.3, -0.5])
    twice = tilted.locked(["joint_6"], [-0.5]).locked(["joint_4"], [0.3])
    states = random_states(np.random.default_rng(8), 20, 4)
    assert np.allclose(once.inverse_dynamics(*states), twice.inverse_dynamics(*states), atol=1e-10)
    assert twice.locked_joints == {"joint_6": -0.5, "joint_4": 0.3}


def test_payload_acts_through_the_jacobian(arm: ArmModel) -> None:
    """A point mass m adds m Jᵀ(a − g) to the torque, a the acceleration of its point on the last link."""
    payload = Payload(1.3, (0.05, -0.02, 0.12))
    states = random_states(np.random.default_rng(9), 20, arm.n)
    data, model, last = arm.model.createData(), arm.model, arm.n
    expected = []
    for q, dq, ddq in zip(*states, strict=True):
        placed = pin.SE3(np.eye(3), np.array(payload.com_m))
        pin.forwardKinematics(model, data, q, dq, ddq)
        frame = pin.Frame("load", last, placed, pin.FrameType.OP_FRAME)
        own = pin.Model(model)
        index = own.addFrame(frame)
        own_data = own.createData()
        pin.forwardKinematics(own, own_data, q, dq, ddq)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        acceleration = pin.getFrameClassicalAcceleration(own, own_data, index, world).linear
        jacobian = pin.computeFrameJacobian(own, own_data, q, index, world)[:3]
        expected.append(payload.mass_kg * jacobian.T @ (acceleration - model.gravity.linear))
    added = arm.with_payload(payload).inverse_dynamics(*states) - arm.inverse_dynamics(*states)
    assert np.allclose(added, expected, rtol=0, atol=1e-10 * max(1.0, np.abs(expected).max()))


def test_continuous_joints_turn_without_limit() -> None:
    """A continuous joint has one position variable (nq = nv) and the torque has a period of 2π in it."""
    arm = sliding_arm()
    assert arm.model.nq == arm.model.nv == 4
    assert arm.upper[2] > 1e6 > -1e6 > arm.lower[2]
    assert arm.neutral[2] == 0.0
    q, dq, ddq = random_states(np.random.default_rng(10), 20, 4)
    turned = q + np.array([0, 0, 4 * np.pi, 0])
    assert np.allclose(arm.inverse_dynamics(turned, dq, ddq), arm.inverse_dynamics(q, dq, ddq), atol=1e-10)


def test_a_gripper_is_locked_and_told() -> None:
    """The Panda is its seven joints; its fingers are fixed at zero, weigh on the arm, and are named."""
    panda = ArmModel.load("panda")
    assert panda.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))
    assert panda.locked_joints == {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    assert panda.inertial_parameters[60] > 1.0  # hand and fingers hang on link 7


def test_joints_that_are_not_wanted_are_locked_at_neutral(tm5: ArmModel) -> None:
    """`load(joints=…)` keeps the named ones in the arm's order, whatever the order given."""
    arm = ArmModel.load("tm5-900", joints=["joint_3", "joint_1"])
    assert arm.joint_names == ("joint_1", "joint_3")
    assert set(arm.locked_joints) == {"joint_2", "joint_4", "joint_5", "joint_6"}
    assert ArmModel.load("tm5-900", joints=tm5.joint_names).locked_joints == {}


@pytest.mark.parametrize("joints", [["joint_9"], ["joint_1", "joint_9"]])
def test_an_unknown_joint_is_named(joints: list[str], tm5: ArmModel) -> None:
    """Keeping or locking a joint that is not there names it and lists those that are."""
    for refused in (lambda: ArmModel.load("tm5-900", joints=joints), lambda: tm5.locked(joints)):
        with pytest.raises(RobotError) as error:
            refused()
        assert "'joint_9'" in error.value.what
        assert "joint_1, joint_2" in error.value.remedy
    with pytest.raises(RobotError, match="every joint would be locked"):
        tm5.locked(tm5.joint_names)
    with pytest.raises(RobotError, match="no moving joint 'joint_9'"):
        ArmModel.from_urdf(tm5.urdf, locked={"joint_9": 0.0})


def test_poses_of_many_states_are_those_of_each(arm: ArmModel) -> None:
    """An array at a time and a state at a time give the same poses, of joints that turn and that slide; a link each."""
    q = np.random.default_rng(4).uniform(-2.0, 2.0, (7, arm.n))
    alone = [arm.forward_kinematics(row) for row in q]
    assert len(arm.links) == len(set(arm.links) & set(alone[0])) == arm.n
    for name, (turn, place) in arm.link_poses(q, tuple(alone[0])).items():
        assert np.allclose(turn, [pose[name][:3, :3] for pose in alone], atol=1e-12)
        assert np.allclose(place, [pose[name][:3, 3] for pose in alone], atol=1e-12)


def test_missing_meshes_are_an_input_error(tmp_path: Path) -> None:
    """An arm whose meshes are not there still has dynamics; asking for its geometry names the file and a remedy."""
    body = link("b").replace(
        "</link>",
        '<collision><geometry><mesh filename="package://nowhere/link.stl"/></geometry></collision></link>',
    )
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(link("a"), body, joint("one", "a", "b")), encoding="utf-8")
    arm = ArmModel.load(path)
    assert arm.gravity(np.zeros((1, 1))).shape == (1, 1)
    with pytest.raises(RobotError) as error:
        _ = arm.geometry
    assert error.value.where == str(path)


def test_digest_tells_arms_apart(tm5: ArmModel) -> None:
    """Equal URDF text, equal digest; a locked joint makes another arm."""
    assert tm5.digest == ArmModel.load("tm5_900").digest != tm5.locked(["joint_6"]).digest


@pytest.mark.parametrize("outer", [1.0, -3.0])
def test_derivatives_are_those_of_inverse_dynamics(outer: float) -> None:
    """Central differences by each joint's position, velocity and acceleration; the mass matrix is symmetric. So it is
    where tuning makes the outer links weigh less than nothing.
    """
    arm = ArmModel.load("tm5-900")
    scale = np.ones(10 * arm.n)
    scale[-30::10] = outer
    arm = arm.with_inertial_parameters(scale * arm.inertial_parameters)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5, arm.n))
    found = arm.derivatives(*states)
    for which in range(3):
        for j in range(arm.n):
            step = np.zeros_like(states)
            step[which, :, j] = 1e-5
            slope = (arm.inverse_dynamics(*(states + step)) - arm.inverse_dynamics(*(states - step))) / 2e-5
            np.testing.assert_allclose(found[which][:, :, j], slope, atol=1e-6)
    np.testing.assert_allclose(found[2], np.swapaxes(found[2], 1, 2))


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "ur10", "z1", "xarm7", "sliding"])
def test_regressor_times_parameters_is_the_torque(robot: str) -> None:
    """Y π = inverse dynamics to 1e-11 of the torque's size, turning and sliding joints, gravity askew."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(1), 300, arm.n)
    for tilted in (arm, arm.with_gravity(np.array([1.0, -2.0, 4.0]))):
        torque = tilted.inverse_dynamics(*states)
        product = tilted.regressor(*states) @ arm.inertial_parameters
        assert np.allclose(product, torque, rtol=0, atol=1e-11 * np.abs(torque).max())


@pytest.mark.parametrize("robot", ["panda", "sliding"])
def test_regressor_equals_pinocchios_own(robot: str) -> None:
    """Every column is Pinocchio's joint torque regressor to 1e-11 of the largest; some columns come in their order."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(2), 20, arm.n)
    each, data = zip(*states, strict=True), arm.model.createData()
    expected = np.array([pin.computeJointTorqueRegressor(arm.model, data, *state) for state in each])
    assert np.allclose(arm.regressor(*states), expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    chosen = (31, 3, 10, 29)
    assert np.array_equal(arm.regressor(*states, chosen), arm.regressor(*states)[:, :, list(chosen)])
