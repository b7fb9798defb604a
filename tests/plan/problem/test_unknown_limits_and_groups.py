"""Limits that a URDF does not know, and joints that an SRDF names."""

import re
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.api.planning import open_task
from plan.command_options import TaskOptions
from plan.problem.task_file import load_task
from tests.plan.worlds import on_wheels

SCENE = """robot = "{robot}"
{top}
[task]
{ends}
duration_s = 3.0
{more}
"""
ENDS = "start_deg = [10, 0, -60, 0, 30, 0]\ngoal_deg = [30, 20, -50, 0, 30, 0]"
SRDF = """<robot name="tm5_900">
  <group name="manipulator"><chain base_link="link_0" tip_link="link_6"/></group>
  <group name="shoulder"><joint name="joint_1"/><joint name="joint_2"/><joint name="joint_3"/></group>
  <group name="hand"><joint name="joint_5"/><joint name="joint_6"/></group>
  <group name="all"><group name="manipulator"/><group name="all"/></group>
  <group_state name="home" group="manipulator">
    <joint name="joint_1" value="0.1"/><joint name="joint_2" value="0"/><joint name="joint_3" value="-1.0"/>
    <joint name="joint_4" value="0"/><joint name="joint_5" value="0.5"/><joint name="joint_6" value="0"/>
  </group_state>
  <group_state name="up" group="shoulder">
    <joint name="joint_1" value="0.2"/><joint name="joint_2" value="0.1"/><joint name="joint_3" value="-0.5"/>
  </group_state>
  <group_state name="half" group="shoulder"><joint name="joint_1" value="0.2"/></group_state>
</robot>
"""


def unknown_arm(folder: Path, limits: str, joint: str = "joint_2") -> Path:
    """The TM5-900 with other limits of one joint."""
    arm = ArmModel.load("tm5-900")
    pattern = rf'(<joint name="{joint}".*?)<limit[^>]*/>'
    text, count = re.subn(pattern, rf"\1<limit {limits}/>", arm.urdf, count=1, flags=re.DOTALL)
    assert count == 1
    (folder / "custom_arm.urdf").write_text(text.replace('name="tm5_900"', 'name="custom"'))
    return folder / "custom_arm.urdf"


def scene(folder: Path, robot: object, ends: str = ENDS, more: str = "", top: str = "") -> Path:
    path = folder / "scene.toml"
    path.write_text(SCENE.format(robot=robot, ends=ends, more=more, top=top))
    return path


# What exporters write where nobody gave a limit of torque or speed.
PLACEHOLDERS = ("0", "1", "1000000")


@pytest.mark.parametrize("effort", PLACEHOLDERS)
def test_a_torque_that_is_a_placeholder_is_unknown(tmp_path: Path, effort: str) -> None:
    """It bounds nothing and is told; where nothing else bounds a time task, the key that would is named."""
    robot = unknown_arm(tmp_path, f'lower="-3" upper="3" effort="{effort}" velocity="3"')
    path = scene(tmp_path, robot)
    found = open_task(path).problem
    assert np.isinf(found.limits.torque[1])
    assert np.isfinite(found.limits.torque[[0, 2, 3, 4, 5]]).all()
    assert any("limits of torque of joint_2 are unknown" in note for note in found.notes)
    evaluation = found.initial_evaluation
    assert evaluation.torque[0] >= 0.0
    with pytest.raises(InputError, match=r"how strong joint_2 may be.*torque_Nm or acceleration"):
        open_task(path, options=TaskOptions("time"))
    path = scene(tmp_path, robot, more="[limits]\nacceleration_deg_s2 = [90, 90, 90, 90, 90, 90]")
    assert open_task(path, options=TaskOptions("time")).problem.limits.acceleration is not None


@pytest.mark.parametrize("velocity", PLACEHOLDERS)
def test_a_speed_that_is_a_placeholder_is_asked_for(tmp_path: Path, velocity: str) -> None:
    """The joint and the key are named; with the key the task is taken."""
    robot = unknown_arm(tmp_path, f'lower="-3" upper="3" effort="100" velocity="{velocity}"')
    with pytest.raises(InputError, match=r"how fast joint_2 may be.*give limits\.speed_deg_s"):
        open_task(scene(tmp_path, robot))
    path = scene(tmp_path, robot, more="[limits]\nspeed_deg_s = [90, 90, 90, 90, 90, 90]")
    assert open_task(path).problem.limits.speed[1] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("place", ["0", "1"])
def test_positions_without_room_are_a_turn_either_way(tmp_path: Path, place: str) -> None:
    """Or what the task gives; a start away from nought is allowed, and it is told."""
    limits = f'lower="{place}" upper="{place}" effort="100" velocity="3"'
    robot = unknown_arm(tmp_path, limits)
    found = open_task(scene(tmp_path, robot)).problem
    assert found.limits.lower[1] == pytest.approx(-2.0 * np.pi)
    assert any("limits of position of joint_2 are unknown" in note for note in found.notes)
    more = "[limits]\nlower_deg = [-90, -40, -90, -90, -90, -90]\nupper_deg = [90, 50, 90, 90, 90, 90]"
    found = open_task(scene(tmp_path, robot, more=more)).problem
    assert np.degrees([found.limits.lower[1], found.limits.upper[1]]) == pytest.approx([-40.0, 50.0])


@pytest.mark.parametrize(
    ("ends", "start", "goal"),
    [
        ('start_state = "home"\ngoal_deg = [30, 20, -50, 0, 30, 0]', [0.1, 0, -1, 0, 0.5, 0], None),
        ('start_deg = [10, 0, -60]\ngoal_state = "up"', None, [0.2, 0.1, -0.5]),
        (
            'group = "all"\nstart_state = "home"\ngoal_deg = [0, 0, 0, 0, 0, 0]',
            [0.1, 0, -1, 0, 0.5, 0],
            None,
        ),
    ],
)
def test_named_states_are_their_angles(
    tmp_path: Path, ends: str, start: list[float] | None, goal: list[float] | None
) -> None:
    """A state's values stand at the end that names it."""
    (tmp_path / "arm.srdf").write_text(SRDF.replace('group="manipulator"', 'group="all"') if "all" in ends else SRDF)
    task = load_task(scene(tmp_path, "tm5-900", ends, top='srdf = "arm.srdf"'))
    if start is not None:
        assert task.start == pytest.approx(start)
    if goal is not None:
        assert task.goal == pytest.approx(goal)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        (
            "start_deg = [1, 2]\ngoal_deg = [1, 3]",
            r"2 angles.*manipulator \(6: joint_1.*shoulder \(3: joint_1, joint_2",
        ),
        (
            'group = "shoulder"\n' + ENDS,
            r"6 angles, group 'shoulder' has 3 joints: joint_1, joint_2, joint_3; give 3",
        ),
        (
            'group = "hand"\nstart_deg = [1, 2]\ngoal_deg = [1, 3]',
            "'hand' has the joints joint_5, joint_6, the arm",
        ),
        (
            'group = "legs"\n' + ENDS,
            "'legs', which the SRDF does not have; use one of: manipulator, shoulder",
        ),
        (
            'start_state = "bed"\ngoal_deg = [1, 2, 3]',
            "'bed', which the SRDF does not have; use one of: half, home, up",
        ),
        ('start_state = "half"\ngoal_deg = [1, 2, 3]', "'half' says nothing of joint_2, joint_3"),
        (
            'start_state = "up"\nstart_deg = [1, 2, 3]\ngoal_deg = [1, 2, 3]',
            "both start_deg and start_state",
        ),
    ],
)
def test_what_no_group_or_state_fits_is_refused(tmp_path: Path, ends: str, words: str) -> None:
    """The groups with their joints, or the states, stand in the one line that refuses."""
    (tmp_path / "arm.srdf").write_text(SRDF)
    with pytest.raises(InputError, match=words):
        load_task(scene(tmp_path, "tm5-900", ends, top='srdf = "arm.srdf"'))


def test_a_state_needs_its_file(tmp_path: Path) -> None:
    """Without an SRDF the key that needs one is named; more angles than joints are refused with the joints' names."""
    with pytest.raises(InputError, match=r"task\.start_state needs an SRDF"):
        load_task(scene(tmp_path, "tm5-900", 'start_state = "home"\ngoal_deg = [1, 2, 3]'))
    ends = "start_deg = [1, 2, 3, 4, 5, 6, 7]\ngoal_deg = [1, 2, 3, 4, 5, 6, 7]"
    with pytest.raises(InputError, match="7 angles, tm5_900 has 6 joints: joint_1, joint_2"):
        open_task(scene(tmp_path, "tm5-900", ends))


ON_WHEELS = {
    "all angles": ("[0.5, 20, 10, 0, -60, 0, 30, 0]", "[0.5, 20, 30, 20, -50, 0, 30, 0]", [0.5, np.radians(20.0)]),
    "the arm's angles": ("[10, 0, -60, 0, 30, 0]", "[30, 20, -50, 0, 30, 0]", [0.0, 0.0]),
    "the base at its zero": ("[0, 0, 10, 0, -60, 0, 30, 0]", "[0, 0, 30, 20, -50, 0, 30, 0]", [0.0, 0.0]),
}


@pytest.mark.parametrize("case", ON_WHEELS)
def test_joints_without_a_drive_are_held_where_they_stand(case: str, tmp_path: Path) -> None:
    """Law: a task that does not move a base without a drive is the arm's, the base held and told."""
    start, goal, held = ON_WHEELS[case]
    path = scene(tmp_path, on_wheels(tmp_path), f"start_deg = {start}\ngoal_deg = {goal}")
    problem = open_task(path).problem
    assert problem.scene.arm.joint_names == tuple(f"joint_{number}" for number in range(1, 7))
    assert list(problem.held) == ["slide", "yaw"]
    np.testing.assert_allclose(list(problem.held.values()), held)
    np.testing.assert_allclose(np.degrees(problem.start), [10, 0, -60, 0, 30, 0])


def test_a_base_that_is_to_move_is_not_held(tmp_path: Path) -> None:
    path = scene(
        tmp_path,
        on_wheels(tmp_path),
        "start_deg = [0, 0, 10, 0, -60, 0, 30, 0]\ngoal_deg = [0.2, 0, 30, 20, -50, 0, 30, 0]",
    )
    with pytest.raises(InputError, match=r"how fast slide, yaw may be.*speed_deg_s"):
        open_task(path)
