"""Scenes as they are: balls, rods, meshes, a floor, things carried, pairs left out; and what is wrong with a file."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.geometry.boxes import Box
from plan.geometry.clearance_proof import prove_clearance
from plan.geometry.mesh_obstacles import holds, read_mesh
from plan.geometry.scene import Scene
from plan.geometry.solids import Solid
from plan.geometry.tool import Carried, name_links
from plan.problem.task_file import load_task
from plan.solving.set_up import require_valid_ends, set_up
from plan.spline import Splines
from tests.plan.worlds import random_rotation, three_joints

KINDS = ("box", "sphere", "capsule", "cylinder", "hull", "surface")
TASK = 'robot = "tm5-900"\n[task]\nstart_deg = [50, 0, -120]\ngoal_deg = [80, 30, -90]\nduration_s = 0.65\n'
CUBE = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n"""


def a_solid(kind: str, rng: np.random.Generator) -> Solid:
    """A shape of a kind, 5 to 25 cm large."""
    if kind == "box":
        return Solid.simple("box", *rng.uniform(0.03, 0.12, 3))
    if kind == "sphere":
        return Solid.simple("sphere", rng.uniform(0.03, 0.12))
    if kind in ("capsule", "cylinder"):
        return Solid.simple("capsule" if kind == "capsule" else "cylinder", *rng.uniform(0.03, 0.12, 2))
    points = rng.normal(size=(20, 3)) * 0.06
    hull = ConvexHull(points)
    return Solid.hull(points) if kind == "hull" else Solid.surface(points, hull.simplices)


def a_scene(arm: ArmModel, count: int, seed: int) -> Scene:
    """Obstacles of all kinds round an arm."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        place = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.2])
        if np.hypot(*place[:2]) > 0.3:
            kind = KINDS[len(found) % len(KINDS)]
            found.append(Box.around(f"{kind} {len(found)}", a_solid(kind, rng), 0, random_rotation(rng), place))
    return Scene.build(arm, found)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return a_scene(three_joints(), 12, 0)


@pytest.fixture(scope="module")
def panda() -> Scene:
    return a_scene(ArmModel.load("panda"), 6, 1)


@pytest.mark.parametrize("name", ["scene", "panda"])
def test_gaps_of_all_shapes_equal_coal(name: str, request: pytest.FixtureRequest) -> None:
    """No gap is above the exact distance; near contact all are within the two that thinned hulls give away a side."""
    world: Scene = request.getfixturevalue(name)
    low, high = np.maximum(world.arm.lower, -2.5), np.minimum(world.arm.upper, 2.5)
    q = np.random.default_rng(2).uniform(low, high, (150, world.arm.n))
    ours, exact = world.gaps(q), np.array([world.proximity.distances(row) for row in q])
    assert np.all(ours <= exact + 1e-6)
    near = (exact > 0.0) & (exact < 0.045)
    assert near.sum() > 30
    assert (exact - ours)[near].max() < 4.3e-3
    assert np.all((ours < 0.0)[exact < -1e-6])
    assert (exact < 0.0).sum() > 30
    least, together = ours.min(axis=1), world.separation(q)
    close = (least > 0.0) & (least < 0.045)
    assert together[close] == pytest.approx(least[close], abs=1e-4)  # beyond, both are bounds, each its own
    assert np.array_equal(together < 0.0, least < 0.0)


def test_far_pairs_may_be_left_out(scene: Scene) -> None:
    """Gaps up to 5 cm are what they are without a bound; all others lie beyond, and none above the distance."""
    q = np.random.default_rng(3).uniform(-2.5, 2.5, (100, 3))
    whole, some = scene.gaps(q), scene.gaps(q, 0.06)
    near = whole <= 0.05
    assert 0 < near.sum() < near.size
    assert np.array_equal(some[near], whole[near])
    assert np.all(some[~near] > 0.05)
    assert np.all(some <= np.array([scene.proximity.distances(row) for row in q]) + 1e-6)


def test_gradients_of_all_shapes_equal_finite_differences(scene: Scene) -> None:
    """The witness points' gradient is the distance's derivative for every kind of shape."""
    rng, checked, h = np.random.default_rng(3), set(), 1e-5
    for _ in range(400):
        q, pair = rng.uniform(-2, 2, 3), int(rng.integers(len(scene.pairs)))
        kind = scene.boxes[scene.pairs[pair][0]].solid.kind
        if kind in checked or not 0.01 < scene.distances(q)[pair] < 0.3:
            continue
        steps = [scene.proximity.distances(q + sign * h * e)[pair] for e in np.eye(3) for sign in (1, 0, -1)]
        forward, backward = np.diff(np.reshape(steps, (3, 3)), axis=1).T / -h
        if np.abs(forward - backward).max() < 1e-4:  # no kink
            assert np.abs(scene.gradients(q[None], np.array([pair]))[0] - (forward + backward) / 2).max() < 2e-5
            checked.add(kind)
    assert checked == set(KINDS)


def test_the_proof_holds_for_all_shapes(scene: Scene) -> None:
    """Proven clearance lies within 2 mm below the least of dense exact distances; no collision is missed."""
    rng, free = np.random.default_rng(4), 0
    for _ in range(16):
        points = rng.uniform(-1.5, 1.5, (1, 1, 3)) + np.cumsum(rng.normal(size=(1, 3, 3)) * 0.2, axis=1)
        motion = Splines(points, np.full((1, 2), 0.3))
        proof = prove_clearance(scene, motion, samples=40)
        q = motion.at(np.linspace(0.0, 0.6, 700))[0]
        least = min(float(scene.distances(row).min()) for row in q)
        assert proof.collision_free == (least > 0.0) or abs(least) < 1e-3
        if proof.collision_free:
            free += 1
            assert min(least - 2e-3, 0.5 * least) - 1e-9 < proof.proven <= least + 1e-9
    assert 0 < free < 16


def test_sweeps_find_what_dense_samples_find(scene: Scene) -> None:
    """The skipping sweep over the tree calls the same motions short of the margin as dense samples do."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.5, 1.5, (60, 1, 3)) + np.cumsum(rng.normal(size=(60, 4, 3)) * 0.2, axis=1)
    motions = Splines(points, np.full((60, 3), 0.3))
    gap, shortfall = scene.sweep(motions, 0.01)
    q = motions.states(np.linspace(0, 1, 200))[0]
    dense = scene.separation(q.reshape(-1, 3)).reshape(60, -1).min(axis=1)
    clear = np.abs(dense - 0.01) > 1e-3
    assert np.array_equal((gap < 0.01)[clear], (dense < 0.01)[clear])
    assert np.array_equal(shortfall > 0, gap < 0.01)
    assert 5 < (gap < 0.01).sum() < 55


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


def test_points_inside_are_told_from_points_outside(tmp_path: Path) -> None:
    """The solid angle tells the inside of a closed surface, wherever the point is."""
    (tmp_path / "cube.obj").write_text(CUBE)
    solid, middle = read_mesh(tmp_path / "cube.obj", np.ones(3), False)
    assert middle == pytest.approx([0.5] * 3)
    points = np.random.default_rng(6).uniform(-1, 1, (200, 3))
    assert [holds(solid, point) for point in points] == [bool(np.all(np.abs(point) < 0.5)) for point in points]


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


def test_an_open_mesh_counts_by_its_hull(tmp_path: Path) -> None:
    """With hull = true, an open mesh is the convex body round it."""
    (tmp_path / "cube.obj").write_text(CUBE.rsplit("f", 1)[0])
    path = tmp_path / "scene.toml"
    path.write_text(f'{TASK}[[obstacle]]\nfile = "cube.obj"\nhull = true\nxyz_m = [2, 0, 0]\n')
    (box,) = load_task(path).obstacles
    assert box.solid.kind == "hull"
    assert box.centre == pytest.approx([2.5, 0.5, 0.5])


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
    told = {pair.links for pair in scene.unchecked if pair.reason == "it stands there"}
    assert ("link_1" in {name for pair in told for name in pair}) == ("link_1 and floor" not in pairs)


def test_what_is_carried_is_checked(tmp_path: Path) -> None:
    """A rod in the hand hits what the arm alone does not; links that it may touch are named, unknown ones refused."""
    arm = ArmModel.load("tm5-900")
    rod = Box.around("rod", Solid.simple("capsule", 0.02, 0.3), 0, None, np.array([0.0, 0.0, 0.4]))
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
    scene = Scene.build(arm, carried=name_links(arm, [Carried(tool, link)]))
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


def test_a_payload_takes_torque(tmp_path: Path) -> None:
    """Two kilograms in the hand raise the torque that holds the arm."""
    torques = []
    for more in ("", "[payload]\nmass_kg = 2\ncom_m = [0, 0, 0.05]\n"):
        (tmp_path / "scene.toml").write_text(TASK + more)
        problem = set_up(load_task(tmp_path / "scene.toml"))
        still = np.zeros((1, 1, 3))
        torques.append(problem.model.torque(problem.start[None, None], still, still)[0, 0])
    lever = np.abs(torques[1] - torques[0])[1]
    assert 2.0 < lever < 2.0 * 9.81 * 1.1


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
