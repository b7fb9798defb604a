"""Laws of robots by name, and of the URDF's one form."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.errors import RobotError
from ident.process import missing_extra
from ident.robot import names as robot_files
from ident.robot.arm import ArmModel
from ident.robot.branches import gripper_joints
from ident.robot.meshes import find_mesh
from ident.robot.names import EXAMPLE_ROBOTS, find_urdf, robot_argument, robot_names
from ident.robot.rotations import matrix_to_rpy, rpy_to_matrix
from tests.ident.made_up import joint, link, urdf

angles = st.floats(-np.pi, np.pi)


@given(angles, st.one_of(angles, st.sampled_from([np.pi / 2, -np.pi / 2])), angles)
def test_angles_come_back_from_their_rotation(roll: float, pitch: float, yaw: float) -> None:
    """rpy → matrix → rpy → matrix is the same rotation; at a pitch of ± 90° roll and yaw can't be distinguished."""
    rotation = rpy_to_matrix(np.array([roll, pitch, yaw]))
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.allclose(rpy_to_matrix(matrix_to_rpy(rotation)), rotation, atol=1e-7)


@pytest.mark.parametrize("name", [*robot_names(), "tiago_no_hand", "anymal-kinova", "ur5_joint_limited_robot"])
def test_every_name_leads_to_an_arm(name: str) -> None:
    """Each name that `--robot` takes, and each file's of example-robot-data, is a chain with mass in every joint's way.

    Of a robot with one arm, that arm is taken, whatever else moves on it.
    """
    arm = ArmModel.load(name)
    assert arm.n >= (4 if name == "scara" else 6)
    assert np.all(np.isfinite(arm.gravity(arm.neutral[None])))


def test_an_unknown_robot_is_told_the_names() -> None:
    """The remedy lists all that could have been meant; hyphens may be underscores."""
    assert find_urdf("tm5_900") == find_urdf("tm5-900")
    with pytest.raises(RobotError) as error:
        find_urdf("pandda")
    assert error.value.where == "pandda"
    assert all(name in error.value.remedy for name in ("tm5-900", *EXAMPLE_ROBOTS))


def test_an_arm_by_its_path_needs_no_package_of_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: without example-robot-data only its names are out of reach, and one line says what to install."""
    monkeypatch.setattr(robot_files.importlib.metadata, "distributions", lambda name: [])
    monkeypatch.setattr(robot_files, "example_files", robot_files.example_files.__wrapped__)
    own = Path("arms", "panda_description", "urdf", "panda.urdf")
    assert robot_argument("panda", own) == own.as_posix()
    assert robot_argument("tm5_900", find_urdf("tm5-900")) == "tm5-900"
    assert find_mesh("package://arm/link.stl", own) is None
    with pytest.raises(RobotError, match="no such URDF file or robot"):
        find_urdf("pandda")
    with pytest.raises(ModuleNotFoundError) as error:
        find_urdf("panda")
    assert "armgap[sim]" in missing_extra(error.value).remedy  # type: ignore[union-attr]


def test_a_head_wheels_and_a_hand_do_not_hide_the_arm() -> None:
    """The arm goes on in the one branch that is as long as an arm; what forks off beyond it are fingers."""
    names = [f"arm_{i}" for i in range(5)]
    chain = [joint(name, "torso" if i == 0 else f"link_{i - 1}", f"link_{i}") for i, name in enumerate(names)]
    thumb = [joint(f"thumb_{i}", "link_4" if i == 0 else f"t{i - 1}", f"t{i}") for i in range(6)]
    parts = [
        *(link(name) for name in ("base", "wheel", "torso", "head", "finger")),
        *(link(f"link_{i}") for i in range(5)),
        *(link(f"t{i}") for i in range(6)),
        joint("wheel_joint", "base", "wheel", "continuous", limit=""),
        joint("lift", "base", "torso", "prismatic"),
        joint("head_joint", "torso", "head"),
        joint("finger_joint", "link_4", "finger"),
    ]
    arm = ArmModel.from_urdf(urdf(*parts, *chain, *thumb))
    assert arm.joint_names == ("lift", *names)


def test_prefixes_that_nobody_declared_are_read() -> None:
    """Law: a name's prefix says nothing of the arm; robots' own parsers know no namespaces, and public URDFs none."""
    plain = urdf(link("base"), link("link_1"), joint("turn", "base", "link_1"))
    odd = plain.replace("effort=", 'drake:acceleration="2.5" effort=').replace("</robot>", "<sim:note/></robot>")
    assert ArmModel.from_urdf(odd).content == ArmModel.from_urdf(plain).content
    assert "drake:acceleration" in ArmModel.from_urdf(odd).urdf


def test_joints_that_follow_others_are_no_free_ones() -> None:
    """Law: a coupled chain is refused by its joints' names, not modelled as if free; a hand's are no matter."""
    names = [f"arm_{i}" for i in range(5)]
    chain = [joint(name, "base" if i == 0 else f"link_{i - 1}", f"link_{i}") for i, name in enumerate(names)]
    links = [link("base"), *(link(f"link_{i}") for i in range(5))]
    follows = '<mimic joint="arm_1" multiplier="-1"/></joint>'
    with pytest.raises(RobotError, match="arm_3 moves with other joints"):
        ArmModel.from_urdf(urdf(*links, *chain[:3], chain[3].replace("</joint>", follows), chain[4]))
    hand = [joint(f"finger_{i}", "link_4", f"f{i}").replace("</joint>", follows if i else "</joint>") for i in range(2)]
    arm = ArmModel.from_urdf(urdf(*links, link("f0"), link("f1"), *chain, *hand))
    assert arm.joint_names == tuple(names)


@pytest.mark.parametrize(
    ("robot", "joints"),
    [("baxter:left_w2", 7), ("pr2:r_wrist_roll_joint", 8), ("tiago_dual:arm_left_7_joint", 8), ("talos_reduced", 0)],
)
def test_one_of_several_arms_is_named_by_its_last_joint(robot: str, joints: int) -> None:
    """Law: all that is not on the way to it is locked at zero and moves as one with what it hangs on."""
    name, _, tip = robot.partition(":")
    if not tip:  # what is reported of a robot of several arms leads to one of them
        with pytest.raises(RobotError) as error:
            ArmModel.load(name)
        tip = error.value.remedy.split(":")[2].split()[0]
    arm = ArmModel.load(f"{name}:{tip}")
    assert arm.joint_names[-1] == tip == arm.tip
    assert not joints or arm.n == joints
    assert set(arm.locked_joints).isdisjoint(arm.joint_names)
    assert set(arm.locked_joints.values()) == {0.0}
    assert np.all(np.isfinite(arm.gravity(arm.neutral[None])))
    seen = robot_argument(arm.name, arm.source, arm.keeping(arm.joint_names[2:]).tip)
    assert ArmModel.load(seen).joint_names == arm.joint_names


def test_two_arms_are_not_guessed_between() -> None:
    """Which of Baxter's is meant nobody knows; the arms that are offered end before their fingers."""
    with pytest.raises(RobotError, match="not a serial chain") as error:
        ArmModel.load("baxter")
    assert error.value.remedy.endswith(": :left_w2 or :right_w2")
    with pytest.raises(RobotError, match=r"no moving joint 'left_w9'.*left_w2"):
        ArmModel.load("baxter:left_w9")


def test_a_name_of_robot_descriptions_leads_to_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the package is installed, its module knows the path; where it is not, that is reported."""
    with pytest.raises(RobotError, match="robot_descriptions"):
        find_urdf("no_such_description")
    package = tmp_path / "robot_descriptions"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "made_up_description.py").write_text(f"URDF_PATH = {str(tmp_path / 'arm.urdf')!r}\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert find_urdf("made_up_description") == tmp_path / "arm.urdf"
    (package / "wanting_description.py").write_text("import no_such_package_of_anybody\n")
    with pytest.raises(RobotError, match=r"lacks a package that it needs \(no_such_package_of_anybody\)"):
        find_urdf("wanting_description")
    with pytest.raises(RobotError, match="has no such robot"):
        find_urdf("missing_description")


def _robot(*changes: tuple[str, str]) -> str:
    """A sound two-joint URDF with some text replaced."""
    text = urdf(link("a"), link("b"), link("c"), joint("one", "a", "b"), joint("two", "b", "c", "prismatic"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


BAD = {
    "not XML": ("# robot", "not XML"),
    "a file that is no text": ("\udcff\udcfe\x00\x01" * 20, "is not UTF-8 text"),
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
        "two moves no mass",
    ),
    "no inertia at all": (
        urdf(*(f'<link name="{name}"/>' for name in "abc"), joint("one", "a", "b"), joint("two", "b", "c")),
        "one and two move no mass",
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
    """RobotError names the file and what is wrong where, gives a remedy in one line; nothing else is printed.

    The URDF that the bad ones are made from loads.
    """
    text, what = BAD[case]
    path = tmp_path / "robot.urdf"
    path.write_text(_robot(), encoding="utf-8")
    assert ArmModel.load(path).joint_names == ("one", "two")
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(RobotError) as error:
        ArmModel.load(path)
    assert error.value.where == str(path)
    assert what in error.value.what
    assert error.value.remedy
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("length", [1, 1100])
def test_fingers_are_found_however_long_the_chain(length: int) -> None:
    """Beyond an arm or, without recursion, at the end of 1100 joints one after the other; in document order."""
    chain = [joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(length)]
    mount = joint("mount", f"l{length}", "hand", "fixed", limit="")
    fingers = [joint("left", "hand", "tip_a"), joint("right", "hand", "tip_b")]
    root = ET.fromstring("<robot name='long'><link name='l0'/>" + "".join([*chain, mount, *fingers]) + "</robot>")
    assert gripper_joints(root) == ["left", "right"]


def test_more_joints_than_any_robot_moves_are_refused_before_the_dynamics() -> None:
    """Room for the dynamics grows with the cube of the joints: 151 are reported, not tried."""
    links = "".join(link(f"l{k}") for k in range(152))
    joints = "".join(joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(151))
    with pytest.raises(RobotError, match="151 joints that move"):
        ArmModel.from_urdf(f"<robot name='long'>{links}{joints}</robot>")
