"""The arm's shapes: what the URDF gives, what is refused, and what stands in."""

import re
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.errors import InputError, RobotError
from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf, robot_names
from plan.cli.app import main
from plan.geometry.arm_shapes import WORDS, arm_shapes, bare_links
from plan.geometry.scene import Scene
from plan.geometry.solids import Box

SCENE = """robot = "{urdf}"
[task]
start_deg = [50, 0, -120]
goal_deg = [80, 30, -90]
duration_s = 0.65
[[obstacle]]
name = "crate"
size_m = [0.3, 0.3, 0.3]
xyz_m = [0.0, -0.35, 0.6]
"""
TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def shapeless(folder: Path, links: str = ".*", visual: bool = True) -> Path:
    """The TM5-900 without the collision geometry of some links."""
    text = find_urdf("tm5-900").read_text()
    for name in re.findall(r'<link name="([^"]+)"', text):
        if re.fullmatch(links, name):
            body = rf'(<link name="{name}">.*?)<collision.*?</collision>'
            text = re.sub(body, r"\1", text, count=1, flags=re.S)
    if not visual:
        text = re.sub(r"<visual.*?</visual>", "", text, flags=re.S)
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def with_mesh(folder: Path, name: str) -> Path:
    """The TM5-900 whose third link is a mesh."""
    text = find_urdf("tm5-900").read_text()
    link = re.search(r'<link name="link_3">.*?</link>', text, flags=re.S)
    part = re.sub(
        r"<collision>.*?</collision>",
        f'<collision><geometry><mesh filename="{name}" scale="1 2 1"/></geometry></collision>',
        link.group(),
        flags=re.S,
    )
    path = folder / "pack" / "urdf" / "arm.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.replace(link.group(), part))
    return path


@pytest.mark.parametrize("command", ["solve", "compare", "excite"])
def test_an_arm_without_shapes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    """No proof without geometry: one line that names the links and the remedy, status 2, nothing written."""
    urdf = shapeless(tmp_path, "link_[24]")
    scene, out = tmp_path / "scene.toml", tmp_path / "out.json"
    scene.write_text(SCENE.format(urdf=urdf))
    what = ["excite", "--robot", str(urdf)] if command == "excite" else [command, str(scene)]
    monkeypatch.setattr(sys, "argv", ["plan", *what, "--json", str(out)])
    with pytest.raises(SystemExit) as stop:
        main()
    said = capsys.readouterr()
    assert stop.value.code == 2
    assert "no_shape" in said.err
    assert "link_2, link_4" in said.err
    assert "--shapes" in said.err
    assert said.err.count("\n") == 1
    assert "proven" not in said.out
    assert not out.exists()


@pytest.mark.parametrize("stand_in", WORDS)
def test_stand_ins_enclose_the_joints_they_join(tmp_path: Path, stand_in: str) -> None:
    """Whatever stands in, it lies at its joint; fitted shapes reach the next joint, and the issue tells of them."""
    arm = ArmModel.load(shapeless(tmp_path))
    shapes = arm_shapes(arm, stand_in)
    assert {box.name for box in shapes.boxes} == set(shapes.bare)
    assert shapes.issue.issue == "no_shape"
    assert "link_3" in shapes.issue.evidence
    scene = Scene.build(arm, [Box("crate", 0, np.eye(3), [0.6, 0, 0.3], [0.1, 0.1, 0.1])], stand_in=stand_in)
    assert (scene.proximity.distances(np.zeros(6)) < np.inf).all()
    for box in shapes.boxes if stand_in != "visual" else ():
        ends = np.stack([np.zeros(3), arm.model.jointPlacements[min(box.joint + 1, arm.n)].translation])
        inside = np.abs((ends[: 1 + (box.joint < arm.n)] - box.centre) @ box.rotation)
        assert np.all(inside <= box.half + 1e-9)


def test_unknown_stand_ins_and_missing_pictures_are_refused(tmp_path: Path) -> None:
    """No such stand-in, and no visual shape where that was asked for: the remedy is named."""
    arm = ArmModel.load(shapeless(tmp_path, visual=False))
    with pytest.raises(InputError, match="use one of: visual, capsules, boxes"):
        arm_shapes(arm, "spheres")  # type: ignore[arg-type]
    with pytest.raises(RobotError, match="use --shapes capsules or boxes"):
        arm_shapes(arm, "visual")


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        (None, "package://pack/part.obj", "is not there"),
        (TETRAHEDRON, "part.gif", "is no mesh that can be read"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "part.obj", "mend|replace"),
        ("no mesh at all", "part.stl", "mend"),
    ],
)
def test_bad_meshes_are_refused(tmp_path: Path, text: str | None, name: str, words: str) -> None:
    """A mesh that is missing, unreadable or not finite is named with the remedy."""
    urdf = with_mesh(tmp_path, name)
    if text is not None:
        (urdf.parent / name).write_text(text)
    with pytest.raises(RobotError, match=words):
        arm_shapes(ArmModel.load(urdf))


def test_simple_shapes_count_as_they_are(tmp_path: Path) -> None:
    """A sphere and a cylinder of the URDF keep their distances: no box is put round them."""
    text = shapeless(tmp_path, "link_6|link_5").read_text()
    for link, shape in (("link_6", '<sphere radius="0.05"/>'), ("link_5", '<cylinder radius="0.05" length="0.1"/>')):
        geometry = f'<link name="{link}"><collision><geometry>{shape}</geometry></collision>'
        text = text.replace(f'<link name="{link}">', geometry)
    (tmp_path / "arm.urdf").write_text(text)
    arm = ArmModel.load(tmp_path / "arm.urdf")
    ball = next(box for box in arm_shapes(arm).boxes if box.name == "link_6")
    assert ball.solid.kind == "sphere"
    assert next(box for box in arm_shapes(arm).boxes if box.name == "link_5").solid.kind == "cylinder"
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, np.zeros(6))
    centre = data.oMi[6].act(ball.centre)
    away = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)  # towards the corner of the box round the ball
    crate = Box("ball", 0, np.eye(3), centre + 0.1 * away, [0.001, 0.001, 0.001])
    scene = Scene.build(arm, [crate])
    (pair,) = [i for i in range(len(scene.pairs)) if scene.pair_name(i) == "link_6 and ball"]
    expected = np.linalg.norm(np.maximum(np.abs(centre - crate.centre) - 0.001, 0.0)) - 0.05
    assert scene.proximity.distances(np.zeros(6))[pair] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("robot", robot_names())
def test_pairs_are_checked_or_named(robot: str) -> None:
    """Of every two links that can move against each other, the certificate says whether they are looked at."""
    if robot == "kinova":
        pytest.skip("its meshes take seconds to read")
    arm = ArmModel.load(robot)
    scene = Scene.build(arm, stand_in="capsules" if bare_links(arm) else None)
    links = scene.boxes
    checked = {frozenset((links[a].name, links[b].name)) for a, b in scene.pairs}
    seen = {frozenset(pair.links) for pair in scene.unchecked}
    apart = {frozenset((a.name, b.name)) for a in links for b in links if a.joint != b.joint}
    assert checked | seen == apart


def test_stand_ins_hit_what_the_arm_hits(tmp_path: Path) -> None:
    """Capsules for the whole arm touch a box at the elbow, as the arm's own boxes do."""
    q = np.radians([80.0, 30.0, -90.0, 0.0, 0.0, 0.0])
    own = ArmModel.load("tm5-900")
    elbow = own.forward_kinematics(q)["link_3"][:3, 3]
    crate = Box("crate", 0, np.eye(3), elbow, [0.1, 0.1, 0.1])
    bare = ArmModel.load(shapeless(tmp_path))
    assert Scene.build(own, [crate]).proximity.distances(q).min() < 0.0
    assert Scene.build(bare, [crate], stand_in="capsules").proximity.distances(q).min() < 0.0
    assert Scene.build(bare, [crate], stand_in="boxes").proximity.distances(q).min() < 0.0
