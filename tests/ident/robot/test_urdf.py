"""Laws of robots by name, and of the URDF's one form."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.robot.urdf import EXAMPLE_ROBOTS, find_urdf, gripper_joints, matrix_to_rpy, robot_names, rpy_to_matrix
from tests.ident.made_up import joint, link, urdf

angles = st.floats(-np.pi, np.pi)


@given(angles, angles, angles)
def test_angles_come_back_from_their_rotation(roll: float, pitch: float, yaw: float) -> None:
    """rpy → matrix → rpy → matrix is the same rotation to 1e-12, gimbal lock included."""
    rotation = rpy_to_matrix(np.array([roll, pitch, yaw]))
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.allclose(rpy_to_matrix(matrix_to_rpy(rotation)), rotation, atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_gimbal_lock_keeps_the_rotation(pitch: float) -> None:
    """At a pitch of ± 90° roll and yaw can't be told apart, yet the rotation stays."""
    rotation = rpy_to_matrix(np.array([0.3, pitch, -0.8]))
    assert np.allclose(rpy_to_matrix(matrix_to_rpy(rotation)), rotation, atol=1e-7)


@pytest.mark.parametrize("name", robot_names())
def test_every_name_leads_to_an_arm(name: str) -> None:
    """Each name that `--robot` takes loads as a chain with mass in every joint's way."""
    arm = ArmModel.load(name)
    assert arm.n >= (4 if name == "scara" else 6)
    assert np.all(np.isfinite(arm.gravity(arm.neutral[None])))


def test_underscore_and_hyphen_name_one_robot() -> None:
    """`tm5_900` is `tm5-900`."""
    assert find_urdf("tm5_900") == find_urdf("tm5-900")


def test_an_unknown_robot_is_told_the_names() -> None:
    """The remedy lists all that could have been meant."""
    with pytest.raises(RobotError) as error:
        find_urdf("pandda")
    assert error.value.where == "pandda"
    assert all(name in error.value.remedy for name in ("tm5-900", *EXAMPLE_ROBOTS))


def test_a_grippers_joints_are_those_beyond_the_first_fork() -> None:
    """Fingers fork off one hand; the arm before them is a chain."""
    text = urdf(
        *(link(name) for name in "abcde"),
        joint("arm", "a", "b"),
        joint("mount", "b", "c", "fixed", limit=""),
        joint("left", "c", "d"),
        joint("right", "c", "e"),
    )
    assert gripper_joints(ET.fromstring(text)) == ["left", "right"]


def _robot(*changes: tuple[str, str]) -> str:
    """A sound two-joint URDF with some text replaced."""
    text = urdf(link("a"), link("b"), link("c"), joint("one", "a", "b"), joint("two", "b", "c", "prismatic"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


GEAR = (
    "<transmission><joint name='one'/><actuator><mechanicalReduction>{}</mechanicalReduction></actuator></transmission>"
)
BAD = {
    "text in a gear ratio": (_robot(("</robot>", GEAR.format("fast") + "</robot>")), "<mechanicalReduction> is 'fast'"),
    "a gear ratio of zero": (_robot(("</robot>", GEAR.format(0) + "</robot>")), "<mechanicalReduction> is '0'"),
    "not XML": ("# robot", "not XML"),
    "empty": ("", "not XML"),
    "another format": ("<mujoco/>", "root element is <mujoco>"),
    "no name": (_robot((' name="made_up"', "")), "<robot> has no name"),
    "no links": (urdf(), "0 base links"),
    "no joints": (urdf(link("a")), "no moving joint"),
    "joint without parent": (_robot(('<parent link="a"/>', "")), "joint 'one' names no parent link"),
    "joint without child": (_robot(('<child link="b"/>', "<child/>")), "joint 'one' names no child link"),
    "joint to nowhere": (_robot(('<child link="b"/>', '<child link="z"/>')), "joint 'one': there is no child link 'z'"),
    "joint without name": (_robot(('name="one" ', "")), "a <joint> has no name"),
    "joint twice": (_robot(('name="two"', 'name="one"')), "two joints are named 'one'"),
    "link twice": (_robot(('<link name="c">', '<link name="b">')), "two links are named 'b'"),
    "joint type": (_robot(("prismatic", "screw")), "joint 'two': type is 'screw'"),
    "no limit": (_robot(('<limit lower="-2" upper="2" effort="50" velocity="3"/>', "")), "joint 'one' has no <limit>"),
    "limits swapped": (_robot(('lower="-2"', 'lower="5"')), "lower limit 5 is above upper limit 2"),
    "text in a limit": (_robot(('upper="2"', 'upper="two"')), "joint 'one': limit upper is 'two'"),
    "no effort": (_robot((' effort="50"', "")), "joint 'one': limit effort is ''"),
    "zero axis": (_robot(('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>')), "joint 'one': axis is zero"),
    "short axis": (_robot(('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>')), "joint 'one': axis is '0 1'"),
    "text in an origin": (_robot(("0.1 -0.05 0.3", "0.1 x 0.3")), "joint 'one': origin xyz is '0.1 x 0.3'"),
    "text in a mass": (urdf(link("a"), link("b", "heavy"), joint("one", "a", "b")), "link 'b': mass is 'heavy'"),
    "NaN mass": (urdf(link("a"), link("b", "nan"), joint("one", "a", "b")), "link 'b': mass is 'nan'"),
    "negative mass": (urdf(link("a"), link("b", -1), joint("one", "a", "b")), "link 'b': mass is -1"),
    "text in a moment": (urdf(link("a"), link("b", 1, moment="?"), joint("one", "a", "b")), "link 'b': ixx is '?'"),
    "half an inertial": (
        urdf(link("a"), '<link name="b"><inertial><mass value="1"/></inertial></link>', joint("one", "a", "b")),
        "lacks <mass> or <inertia>",
    ),
    "no inertia": (
        urdf(link("a"), link("b"), '<link name="c"/>', joint("one", "a", "b"), joint("two", "b", "c")),
        "joint two moves no mass",
    ),
    "two bases": (_robot(('<link name="a">', '<link name="x"/><link name="a">')), "2 base links (x, a)"),
    "a loop": (urdf(link("a"), link("b"), joint("one", "a", "b"), joint("two", "b", "a")), "0 base links"),
    "two parents": (
        urdf(*(link(n) for n in "abcd"), joint("1", "a", "b"), joint("2", "a", "c"), joint("3", "b", "d")).replace(
            "</robot>", joint("4", "c", "d") + "</robot>"
        ),
        "link 'd' hangs from two joints",
    ),
    "two arms": (
        urdf(link("a"), link("b"), link("c"), joint("left", "a", "b"), joint("right", "a", "c")),
        "not a serial chain: right forks off",
    ),
    "a torso with two arms": (
        urdf(
            link("base"),
            link("torso"),
            joint("waist", "base", "torso"),
            *(
                link(f"{side}{i}") + joint(f"{side}_{i}", "torso" if i == 1 else f"{side}{i - 1}", f"{side}{i}")
                for side in "lr"
                for i in range(1, 7)
            ),
        ),
        "not a serial chain: r_1 forks off",
    ),
    "floating joint": (
        urdf(link("a"), link("b"), joint("one", "a", "b", "floating", limit="")),
        "joints of more than one axis",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_urdf_is_refused_with_file_place_and_remedy(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """RobotError names the file and what is wrong where, gives a remedy in one line; nothing else is printed."""
    text, what = BAD[case]
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError) as error:
        ArmModel.load(path)
    assert error.value.where == str(path)
    assert what in error.value.what
    assert error.value.remedy
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_a_sound_urdf_is_not_refused(tmp_path: Path) -> None:
    """The URDF that the bad ones are made from loads."""
    path = tmp_path / "robot.urdf"
    path.write_text(_robot(), encoding="utf-8")
    assert ArmModel.load(path).joint_names == ("one", "two")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    """A mesh or an archive given as URDF is an input error, not a crash."""
    path = tmp_path / "arm.urdf"
    path.write_bytes(b"\xff\xfe\x00\x01" * 20)
    with pytest.raises(RobotError, match="is not UTF-8 text"):
        ArmModel.load(path)
