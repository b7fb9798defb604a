"""Laws of the rigid arm: inverse dynamics, its derivatives, and the regressor, τ = Y π."""

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


def test_inertial_parameters_come_back(arm: ArmModel) -> None:
    """Parameters put in are read out, also those that no body can have."""
    changed = _changed(arm)
    again = arm.with_inertial_parameters(changed.inertial_parameters)
    assert np.allclose(again.inertial_parameters, changed.inertial_parameters, rtol=1e-12, atol=1e-14)
    states = random_states(np.random.default_rng(4), 10, arm.n)
    same = arm.with_inertial_parameters(arm.inertial_parameters)
    assert np.allclose(same.inverse_dynamics(*states), arm.inverse_dynamics(*states), atol=1e-11)


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
def test_regressor_equals_pinocchios_own(robot: str) -> None:
    """Every column is Pinocchio's joint torque regressor to 1e-11 of the largest; some columns come in their order."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    arm = arm.with_gravity(np.array([1.0, -2.0, 4.0]))
    states = random_states(np.random.default_rng(2), 20, arm.n)
    each, data = zip(*states, strict=True), arm.model.createData()
    expected = np.array([pin.computeJointTorqueRegressor(arm.model, data, *state) for state in each])
    assert np.allclose(arm.regressor(*states), expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    chosen = (31, 3, 10, 29)
    assert np.array_equal(arm.regressor(*states, chosen), arm.regressor(*states)[:, :, list(chosen)])


# Vendor's DH table (classic): offset of θ [deg], α [deg], a [m], d [m].
DH = (
    (0, -90, 0.0, 0.1452),
    (-90, 0, 0.429, 0.0),
    (0, 0, 0.4115, 0.0),
    (90, 90, 0.0, -0.1223),
    (0, 90, 0.0, 0.106),
    (0, 0, 0.0, 0.11315),
)
POSITION_LIMITS_DEG = (270, 180, 155, 180, 180, 270)
VELOCITY_LIMITS_DEG = (180, 180, 180, 225, 225, 225)
EFFORT_LIMITS = (157, 157, 157, 43, 43, 43)
GEAR_RATIOS = (100, 100, 100, 80, 80, 80)
# Recommended set: mass [kg], centre of mass [m], xx xy xz yy yz zz about it [kg m²], links 1 to 6.
INERTIALS = np.fromstring(
    """
4.032 0.0    -0.00484  0.00192 0.0119696631 -1.3257185e-05 -4.976894e-07 0.0115493998  1.5684e-08    0.0088001191
8.897 0.2145  0.0     -0.1451  0.024459      0.0            0.0          0.355         0.0           0.348
2.443 0.304   0.0     -0.0197  0.0036349728 -0.0003364099   8.7e-10      0.0609980271 -1.483504e-07  0.060500000044
1.576 0.0    -0.00638  0.00709 0.0025637446 -7.272469e-06  -2.13948e-08  0.0026425443  2.337788e-07  0.0020584051
1.576 0.0    -0.00638 -0.00709 0.0025637446  7.272469e-06   2.13948e-08  0.0026425443  2.337788e-07  0.0020584051
0.65  0.0     0.03885 -0.01936 0.0014897527  8.594908e-05  -1.576286e-06 0.0014535245 -4.385241e-06  0.0007745738
""",
    sep=" ",
).reshape(6, 10)


def _dh_pose(q: np.ndarray) -> np.ndarray:
    """Flange pose by the vendor's DH table."""
    pose = np.eye(4)
    for angle, (offset, alpha, a, d) in zip(q, DH, strict=True):
        theta, twist = angle + np.deg2rad(offset), np.deg2rad(alpha)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(twist), np.sin(twist)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def test_the_flange_stands_where_the_vendor_says(tm5: ArmModel) -> None:
    """Home pose (0, -0.23545, 1.0917) m; at random postures the DH table's pose to 1e-12."""
    home = tm5.forward_kinematics(np.zeros(6))["flange"]
    assert np.allclose(home[:3, 3], (0.0, -0.23545, 1.0917), atol=1e-12)
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6)):
        assert np.allclose(tm5.forward_kinematics(q)["flange"], _dh_pose(q), atol=1e-12)


def test_limits_are_the_published_ones(tm5: ArmModel) -> None:
    """Positions, velocities and torques; joint 3 is the one with ± 155°."""
    assert np.allclose(np.rad2deg(tm5.upper), POSITION_LIMITS_DEG, atol=1e-9)
    assert np.allclose(np.rad2deg(tm5.lower), -np.array(POSITION_LIMITS_DEG), atol=1e-9)
    assert np.allclose(np.rad2deg(tm5.velocity_limit), VELOCITY_LIMITS_DEG, atol=1e-9)
    assert np.array_equal(tm5.effort_limit, EFFORT_LIMITS)
    assert tm5.joint_names == tuple(f"joint_{i}" for i in range(1, 7))


def test_masses_and_moments_are_the_recommended_set(tm5: ArmModel) -> None:
    """Each link's mass, centre of mass and moments about it, which a body could have; 19.174 kg, base not counted."""
    assert INERTIALS[:, 0].sum() == pytest.approx(19.174)
    for i, (mass, x, y, z, xx, xy, xz, yy, yz, zz) in enumerate(INERTIALS, start=1):
        body = tm5.model.inertias[i]
        assert body.mass == pytest.approx(mass)
        assert np.allclose(body.lever, (x, y, z), atol=1e-12)
        assert np.allclose(body.inertia, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], atol=2e-10)
        small, middle, large = np.linalg.eigvalsh(body.inertia)
        assert 0.0 < small <= large < small + middle


def test_gear_ratios_are_told(tm5: ArmModel) -> None:
    """100 on joints 1 to 3, 80 on 4 to 6; an arm without transmissions has none, and no words or zeros are ratios."""
    ratios = tm5.gear_ratios
    assert ratios is not None
    assert np.array_equal(ratios, GEAR_RATIOS)
    assert ArmModel.load("panda").gear_ratios is None
    for wrong in ("reduction", "0", "nan"):
        assert ArmModel.from_urdf(tm5.urdf.replace(">100<", f">{wrong}<"), tm5.source).gear_ratios is None


def test_locking_step_by_step_is_locking_at_once(tm5: ArmModel) -> None:
    """Two reductions after each other, under tilted gravity, are one."""
    tilted = tm5.with_gravity(np.array([3.0, 0.0, -9.0]))
    once = tilted.locked(["joint_4", "joint_6"], [0.3, -0.5])
    twice = tilted.locked(["joint_6"], [-0.5]).locked(["joint_4"], [0.3])
    states = random_states(np.random.default_rng(8), 20, 4)
    assert np.allclose(once.inverse_dynamics(*states), twice.inverse_dynamics(*states), atol=1e-10)
    assert twice.locked_joints == {"joint_6": -0.5, "joint_4": 0.3}
