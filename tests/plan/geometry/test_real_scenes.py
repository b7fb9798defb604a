"""Scenes as they are: balls, rods, meshes, a floor, things carried, pairs left out; and what is wrong with a file."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.geometry.clearance_proof import prove_clearance
from plan.geometry.obstacle_files import holds, read_mesh
from plan.geometry.scene import Scene
from plan.geometry.solids import Box, Solid
from plan.geometry.tool import Carried, hang
from plan.problem.task_file import load_task
from plan.solving.obstruction import require_valid_ends
from plan.solving.set_up import set_up
from tests.plan.geometry.worlds import CUBE, TASK
from tests.plan.worlds import random_rotation, three_joints


def test_a_link_inside_a_closed_mesh_collides(tmp_path: Path) -> None:
    """A mesh round the whole arm touches no link, and still is no free place; beside it, it is."""
    (tmp_path / "cube.obj").write_text(CUBE)
    for shift, valid in ((-2.0, False), (3.0, True)):
        path = tmp_path / "scene.toml"
        mesh = f'shape = "mesh"\nfile = "cube.obj"\nscale = 4\nxyz_m = [{shift}, -2, -2]\n'
        path.write_text(f'{TASK}[[obstacle]]\nname = "hall"\n{mesh}')
        task = load_task(path)
        problem = set_up(task)
        if valid:
            require_valid_ends(problem, task)
            continue
        assert not prove_clearance(problem.scene, problem.decode(problem.initial)).collision_free
        with pytest.raises(InputError, match="hall collide there"):
            require_valid_ends(problem, task)


@pytest.mark.parametrize(
    ("name", "text", "more", "words"),
    [
        ("none.obj", None, "", "no such mesh file"),
        ("cube.obj", CUBE.rsplit("f", 1)[0], "", "open: 3 edges .* hull = true"),
        ("cube.obj", CUBE.replace("v 1 1 1", "v 1 nan 1"), "", "mend or replace"),
        ("cube.obj", CUBE, "scale = 5000", "give scale = 0.001"),
        ("cube.obj", CUBE, "scale = 0", "not above zero"),
        ("cube.obj", CUBE, "size_m = [1, 1, 1]", "unknown key 'size_m'"),
        ("cube.obj", "nothing", "", "mend or replace"),
        ("cube.step", CUBE, "", "give one of: .stl"),
    ],
)
def test_bad_mesh_obstacles(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str | None, more: str, words: str
) -> None:
    """Missing, open, infinite, huge, empty and foreign meshes end in one line that names the file and the remedy."""
    if text is not None:
        (tmp_path / name).write_text(text)
    path = tmp_path / "scene.toml"
    path.write_text(f'{TASK}[[obstacle]]\nshape = "mesh"\nfile = "{name}"\nxyz_m = [2, 0, 0]\n{more}\n')
    with pytest.raises(InputError, match=words) as error:
        load_task(path)
    assert str(tmp_path) in str(error.value)
    assert "\n" not in str(error.value)
    assert "".join(capfd.readouterr()) == ""  # nor does the reader say anything of its own


def test_shapes_of_a_scene_file(tmp_path: Path) -> None:
    """Every shape is read with its sizes, and the floor is one more."""
    tables = (
        'shape = "sphere"\nradius_m = 0.1',
        'shape = "capsule"\nradius_m = 0.1\nlength_m = 0.4',
        'shape = "cylinder"\nradius_m = 0.1\nlength_m = 0.4',
        "size_m = [0.1, 0.2, 0.3]",
    )
    path = tmp_path / "scene.toml"
    path.write_text(TASK + "".join(f"[[obstacle]]\nxyz_m = [2, 0, 0]\n{one}\n" for one in tables) + "[floor]\n")
    found = load_task(path).obstacles
    assert [box.solid.kind for box in found] == ["sphere", "capsule", "cylinder", "box", "box"]
    assert found[1].half == pytest.approx([0.1, 0.1, 0.3])
    assert found[2].half == pytest.approx([0.1, 0.1, 0.2])
    assert found[4].centre[2] + found[4].half[2] == pytest.approx(0.0)
    scene = set_up(load_task(path)).scene
    pairs = {scene.pair_name(i) for i in range(len(scene.pairs))}
    assert "link_3 and floor" in pairs
    seen = {pair.links for pair in scene.unchecked if pair.reason == "it stands there"}
    assert ("link_1" in {name for pair in seen for name in pair}) == ("link_1 and floor" not in pairs)


def test_what_is_carried_is_checked(tmp_path: Path) -> None:
    """A rod in the hand hits what the arm alone does not; links that it may touch are named, unknown ones refused."""
    arm = ArmModel.load("tm5-900")
    rod = Box("rod", 0, np.eye(3), np.array([0.0, 0.0, 0.4]), Solid.simple("capsule", 0.02, 0.3))
    q = np.radians([0.0, 30.0, 60.0, 0.0, 90.0, 0.0])
    tip = arm.forward_kinematics(q)[arm.links[-1]]
    crate = Box("crate", 0, np.eye(3), tip[:3, 3] + 0.5 * tip[:3, 2], np.full(3, 0.05))
    assert Scene.build(arm, [crate]).proximity.distances(q).min() > 0.01
    held = Scene.build(arm, [crate], carried=[Carried(rod, touches=("link_4",))])
    assert held.proximity.distances(q).min() < 0.0
    names = {held.pair_name(i) for i in range(len(held.pairs))}
    assert {"rod and crate", "rod and link_2"} <= names
    assert "rod and link_4" not in names
    assert ("link_4", "rod") in {pair.links for pair in held.unchecked}
    for wrong in (Carried(rod, touches=("gripper",)), Carried(rod, "gripper")):
        with pytest.raises(InputError, match="no link 'gripper'"):
            Scene.build(arm, carried=[wrong])


@pytest.mark.parametrize(
    ("robot", "link", "tip"),
    [
        ("panda", None, "panda_hand_tcp"),
        ("panda", "panda_link8", "panda_link8"),
        ("panda", "panda_link4", "panda_link4"),
        ("ur10", None, "tool0"),
        ("ur10", "ee_link", "ee_link"),
        ("tm5-900", None, "flange"),
    ],
)
def test_a_tool_is_where_its_frame_is(robot: str, link: str | None, tip: str) -> None:
    """What hangs on a frame, the URDF's tip if none is named, is placed as Pinocchio places that frame."""
    arm, place, rng = ArmModel.load(robot), np.array([0.01, -0.02, 0.05]), np.random.default_rng(0)
    tool = Box("tool", 0, random_rotation(rng), place, np.full(3, 0.02))
    scene = Scene.build(arm, carried=hang(arm, [Carried(tool, link)], None, None)[0])
    (box,) = (box for box in scene.boxes if box.name == "tool")
    q = rng.uniform(-1.0, 1.0, arm.n)
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, q)
    wanted = data.oMf[arm.model.getFrameId(tip)].act(place)
    assert data.oMi[box.joint].act(box.centre) == pytest.approx(wanted, abs=1e-9)
    assert all(scene.boxes[a].joint < scene.boxes[b].joint for a, b in scene.pairs[scene.own])


def test_a_payload_hangs_where_it_is_said(tmp_path: Path) -> None:
    """Its centre is given in the tip's frame or the named one; results name it; no link in mid-arm carries it."""
    arm, torques = ArmModel.load("panda"), {}
    ends = "start_deg = [0, 0, 0, -90, 0, 30, 0]\ngoal_deg = [9, 0, 0, -90, 0, 30, 0]\n"
    head = f'robot = "panda"\n[task]\n{ends}duration_s = 2\n'
    for link, com in ((None, [0.0, 0.0, 0.0]), ("panda_hand", [0.0, 0.0, 0.1034]), ("panda_link7", [0.0, 0.0, 0.0])):
        named = "" if link is None else f'link = "{link}"\n'
        (tmp_path / "scene.toml").write_text(f"{head}[payload]\nmass_kg = 2\ncom_m = {com}\n{named}")
        found = set_up(load_task(tmp_path / "scene.toml"))
        still = np.zeros((1, 1, arm.n))
        torques[link] = found.model.torque(found.start[None, None], still, still)[0, 0]
        assert found.carried == ({"name": "payload", "link": link or "panda_hand_tcp", "mass_kg": 2.0, "com_m": com},)
    assert torques[None] == pytest.approx(torques["panda_hand"], abs=1e-6)
    assert np.abs(torques[None] - torques["panda_link7"]).max() > 1.0
    (tmp_path / "scene.toml").write_text(f'{head}[payload]\nmass_kg = 2\nlink = "panda_link4"\n')
    with pytest.raises(InputError, match="'panda_link4' is not moved by the last joint"):
        set_up(load_task(tmp_path / "scene.toml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<robot name="other"><disable_collisions link1="a" link2="b"/></robot>', "give this robot's SRDF"),
        ('<robot name="tm5_900"><disable_collisions link1="a" link2="b"/></robot>', "no link 'a'"),
        ("<robot", "not XML"),
        ("<arm/>", "not <robot>"),
        (None, "no such SRDF"),
    ],
)
def test_bad_srdf_files(tmp_path: Path, text: str | None, words: str) -> None:
    """The SRDF of another robot, or none at all, is refused."""
    path = tmp_path / "scene.toml"
    path.write_text(f'srdf = "arm.srdf"\n{TASK}')
    if text is not None:
        (tmp_path / "arm.srdf").write_text(text)
    with pytest.raises(InputError, match=words):
        set_up(load_task(path))


def test_an_srdf_by_another_name_counts_where_it_speaks_of_this_robot(tmp_path: Path) -> None:
    """All links that it names are the robot's; what it leaves out says whose it is."""
    path = tmp_path / "scene.toml"
    path.write_text(f'srdf = "arm.srdf"\n{TASK}')
    links = '<disable_collisions link1="link_1" link2="link_3" reason="Never"/>'
    (tmp_path / "arm.srdf").write_text(f'<robot name="other">{links}</robot>')
    scene = set_up(load_task(path)).scene
    assert "left out by arm.srdf, which is of a robot 'other': Never" in [pair.reason for pair in scene.unchecked]
    (tmp_path / "arm.srdf").write_text('<robot name="other"><group name="none"/></robot>')
    with pytest.raises(InputError, match="give this robot's SRDF"):
        set_up(load_task(path))


def test_pairs_of_an_srdf_are_left_out_and_named(tmp_path: Path) -> None:
    """What the SRDF disables is not checked, and the certificate says so with the SRDF's reason."""
    path = tmp_path / "scene.toml"
    path.write_text(f'srdf = "arm.srdf"\n{TASK}')
    entry = '<disable_collisions link1="link_6" link2="link_2" reason="Never"/>'
    (tmp_path / "arm.srdf").write_text(f'<robot name="{three_joints().name}">{entry}</robot>')
    scene = set_up(load_task(path)).scene
    assert "link_6 and link_2" not in {scene.pair_name(i) for i in range(len(scene.pairs))}
    assert [pair.reason for pair in scene.unchecked if set(pair.links) == {"link_2", "link_6"}] == [
        "left out by arm.srdf: Never"
    ]


def test_points_inside_are_told_from_points_outside(tmp_path: Path) -> None:
    """The solid angle shows the inside of a closed surface, wherever the point is."""
    (tmp_path / "cube.obj").write_text(CUBE)
    solid, middle = read_mesh(tmp_path / "cube.obj", np.ones(3), False)
    assert middle == pytest.approx([0.5] * 3)
    points = np.random.default_rng(6).uniform(-1, 1, (200, 3))
    assert [holds(solid, point) for point in points] == [bool(np.all(np.abs(point) < 0.5)) for point in points]
