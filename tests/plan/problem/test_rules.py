"""What a way has to keep, by slopes and a second checker; what is wrong in a scene file is one line with the remedy."""

import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomli_w

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf
from plan.api.planning import open_task, solve
from plan.planners.sequential import Sequential
from plan.problem.rule_values import Rules
from plan.problem.rules import Cone, ViaPoint, WayRules
from plan.problem.task_file import load_task
from tests.ident.made_up import sliding_arm
from tests.plan.checker import World, rule_faults
from tests.plan.geometry.worlds import scanned

SCENES = Path(__file__).parents[3] / "examples" / "scenes"
QUICK = Sequential(starts=3, kept=(1,), levels=1)
TIPS = {"tm5-900": "flange", "ur10": "tool0", "panda": "panda_hand_tcp"}
DOWN = np.array([0.0, 0.0, -1.0])


def rules(name: str, way: WayRules, seed: int = 3) -> tuple[Rules, np.ndarray, np.ndarray]:
    """Rules of an arm between two drawn positions, and states that are not far from the straight line."""
    arm, rng = ArmModel.load(name), np.random.default_rng(seed)
    start, goal = rng.uniform(-1.0, 1.0, (2, arm.n))
    made = Rules(arm, way, start, goal)
    shares = rng.uniform(0.1, 0.9, (6, 1))
    q = start + shares * (goal - start) + 0.002 * rng.normal(size=(6, arm.n))
    return made, q, rng.normal(size=(6, arm.n))


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_slopes_are_those_of_the_values(name: str) -> None:
    """Along random changes of position and speed every row changes as its derivatives say."""
    cones = (Cone(np.array([0.6, 0.0, 0.8]), DOWN, 0.4, True), Cone(np.array([0.0, 0.0, 1.0]), DOWN, 0.3, False))
    made, q, dq = rules(name, WayRules(speed=0.3, straight=0.01, cones=cones))
    rng, step = np.random.default_rng(9), 1e-6
    for _ in range(3):
        a, b = rng.normal(size=q.shape), rng.normal(size=q.shape)
        ahead, behind = (made.rows(q + sign * step * a, dq + sign * step * b) for sign in (1.0, -1.0))
        for row, after, before in zip(made.rows(q, dq), ahead, behind, strict=True):
            seen = (row.by_position * a).sum(axis=1)
            seen += 0.0 if row.by_speed is None else (row.by_speed * b).sum(axis=1)
            if row.name == "turn":  # right where it is kept only: the tool's own turn is taken as small
                continue
            assert (after.value - before.value) / (2.0 * step) == pytest.approx(seen, rel=1e-6, abs=1e-6)


def test_the_tool_is_where_pinocchio_has_it() -> None:
    """Place and axes of the frame, its speed, and the order in which via points are passed."""
    vias = (ViaPoint(np.zeros(6), False, 0.1), ViaPoint(np.zeros(3), True, 0.1))
    made, q, _ = rules("ur10", WayRules(vias=vias))
    arm = ArmModel.load("ur10")
    place, turn, linear, angular = made.tool(q)
    for k, row in enumerate(q):
        frame, data = arm.model.getFrameId("tool0"), arm.model.createData()
        jacobian = pin.computeFrameJacobian(arm.model, data, row, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        pin.updateFramePlacement(arm.model, data, frame)
        assert place[k] == pytest.approx(data.oMf[frame].translation, abs=1e-9)
        assert turn[k] == pytest.approx(data.oMf[frame].rotation, abs=1e-9)
        assert np.concatenate([linear[k].T, angular[k].T]) == pytest.approx(jacobian, abs=1e-9)
    first, second = made.when_passed(q)
    assert first <= second


@pytest.mark.parametrize("name", ["through_2", "through_4", "straight_4", "goals_1", "cone_5", "straight_1"])
def test_plans_keep_what_their_scene_asks_for(name: str) -> None:
    """A quick search of each kind: solved, and the second checker, which shares no code, finds nothing broken."""
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    plan = solve(SCENES / f"{name}.toml", planner=QUICK, gap=False).to_dict()
    assert plan["status"] == "solved", plan["reason"]
    assert all(one["kept"] for one in plan["rules"])
    world = World(find_urdf(scene["robot"]), [], {}) if scene["robot"] == "tm5-900" else bare_world(scene["robot"])
    assert rule_faults(plan, scene, world, TIPS[scene["robot"]]) == []
    # What the scene asks for beyond that is seen by the checker, too.
    stricter = {**scene, "tool": {**scene.get("tool", {}), "speed_m_s": 1e-3}}
    assert rule_faults(plan, stricter, world, TIPS[scene["robot"]]) != []


def bare_world(robot: str) -> World:
    """The checker's arm without its shapes."""
    world = World.__new__(World)
    world.model = pin.buildModelFromUrdf(str(find_urdf(robot)))
    world.data = world.model.createData()
    return world


def test_a_tool_too_slow_for_its_time_is_refused_with_the_time_it_takes(tmp_path: Path) -> None:
    """0.9 m at 5 cm/s take longer than the task's 3 s: no search, and the least duration is named."""
    scene = tomllib.loads((SCENES / "straight_1.toml").read_text())
    scene["tool"]["speed_m_s"] = 0.05
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(scene))
    found = solve(tmp_path / "scene.toml", planner=QUICK, gap=False)
    assert found.status == "infeasible"
    assert "the tool takes 18" in found.reason


SLIDES = """robot = "{robot}"
[task]
start_deg = [30, -0.05, 60]
goals_deg = [[0, {goal}, 90], [1, 0.3, 2]]
wrist_deg = [0.2]
duration_s = 2
[limits]
lower_deg = [-90, -0.2, -90]
speed_deg_s = [60, 0.5, 60]
"""


def test_what_a_scene_says_of_joints_that_slide_is_in_metres(tmp_path: Path) -> None:
    """Law: lists of a scene file have degrees for joints that turn and metres for those that slide."""
    arm, file = sliding_arm(), tmp_path / "arm.urdf"
    file.write_text(arm.urdf)
    (tmp_path / "scene.toml").write_text(SLIDES.format(robot=file, goal=0.1))
    task = load_task(tmp_path / "scene.toml")
    turn = np.degrees(1.0)
    assert [one.tolist() for one in (task.start, task.goal)] == [
        pytest.approx([30 / turn, -0.05, 60 / turn]),
        pytest.approx([0.0, 0.1, 90 / turn]),
    ]
    assert task.others[0] == pytest.approx([1 / turn, 0.3, 2 / turn])
    assert task.lower == pytest.approx([-90 / turn, -0.2, -90 / turn])
    assert task.wrist == pytest.approx([0.2])
    (tmp_path / "scene.toml").write_text(SLIDES.format(robot=file, goal=2.5).replace(", [1, 0.3, 2]", ""))
    with pytest.raises(InputError, match=r"2\.500 m of slide_2 is out of its limits.*within -0\.20 m to 2\.00 m"):
        solve(tmp_path / "scene.toml", planner=QUICK, gap=False, shapes="capsules")


TABLE3 = (Path(__file__).parents[1] / "data" / "table3.toml").read_text()
START, GOAL = "start_deg = [50, 0, -120]", "goal_deg = [80, 30, -90]"
# All six joints, and where the last link is to end.
POSE = TABLE3.replace(START, "start_deg = [50, 0, -120, 0, 30, 0]").replace(GOAL, "") + "[task.goal_pose]\n"
CHANGED = [
    ("[task]", "[tusk]", "unknown key 'tusk'"),
    (START, "", "task.start_deg is missing"),
    (START, 'start_deg = ["a", 0, 1]', "not a list of numbers"),
    (GOAL, "goal_deg = [80, 30]", "has 2 numbers, not 3"),
    (GOAL, "goal_deg = [80, 30, nan]", "not a list of numbers"),
    (GOAL, "goal_deg = [80, 300, -90]", "out of its limits"),
    (GOAL, "goal_deg = [80, 100, 150]", "collide there"),
    (GOAL, f"{GOAL}\ngoals_deg = [[1, 2, 3]]", "both goal_deg and goals_deg"),
    (GOAL, f"{GOAL}\ngoal_pose = {{xyz_m = [0.3, 0, 0.4]}}", "both goal_deg and goal_pose"),
    ("duration_s = 0.65", "duration_s = -1", "task.duration_s is -1"),
    ("duration_s = 0.65", "duration_s = 0", "task.duration_s is 0, not a number above zero"),
    ("duration_s = 0.65", 'duration_s = "soon"', "task.duration_s is 'soon'"),
    ("via_points = 2", "via_points = 0", "task.via_points is 0"),
    ("via_points = 2", "wrist_deg = [0, 0]", "3 joints stand still"),
    ("via_points = 2", "wrist_deg = [0, 0, 900]", "out of the limits"),
    ('robot = "tm5-900"', 'robot = "tm9"', "no such URDF file or robot"),
    ('robot = "tm5-900"', 'robot = "tm5-900', "not TOML"),
]
ADDED = [
    ("[limits]\nlower_deg = [400, -90, -90]", "leave joint_1 no room"),
    ("[tool]\nsped_m_s = 1.0", "unknown key 'sped_m_s'"),
    ("[tool]\nspeed_m_s = 0.0", "tool.speed_m_s is 0.0"),
    ("[tool]\nwithin_m = 0.01", "add straight = true"),
    ("[tool]\nstraight = 1", "give true or false"),
    ('[tool]\nframe = "nose"', "tool.frame: no link 'nose'"),
    ("[[tool.cone]]", "tool.cone 1 has neither allowed_deg nor keep_out_deg"),
    ("[[tool.cone]]\nallowed_deg = 10\nkeep_out_deg = 5", "tool.cone 1 has both allowed_deg and keep_out_deg"),
    ("[[tool.cone]]\nallowed_deg = 10\naxis = [0, 0, 0]", "no direction"),
    ("[[tool.cone]]\nallowed_deg = 5", "the tool's axis breaks tool.cone 1"),
    ("[tool.cone]\nallowed_deg = 5", "with two brackets"),
    ("[[pass]]", "neither deg nor xyz_m"),
    ("[[pass]]\ndeg = [1, 2]", "has 2 numbers, not 3"),
    ("[[pass]]\ndeg = [1, 2, 3]\nwithin_m = 1", "pass 1 has both deg and within_m"),
    ("[[pass]]\ndeg = [1, 2, 900]", "pass 1.deg: 900.0 deg of joint_3 is out of its limits"),
    ("[[pass]]\ndegrees = [1, 2, 3]", "unknown key 'degrees'"),
]
OBSTACLES = [
    ("size_m = [0.1, 0, 0.1]\nxyz_m = [1, 0, 0]", "not above zero"),
    ("size_m = [0.1, 0.1]\nxyz_m = [1, 0, 0]", "has 2 numbers, not 3"),
    ("size_m = [0.1, 0.1, 0.1]", "xyz_m is missing"),
    ("size_m = [0.1, 0.1, 0.1]\nxyz_m = [1, 0, 0]\ncolour = 3", "unknown key 'colour'"),
    ("size_m = [0.4, 0.4, 0.4]\nxyz_m = [-0.1, -0.5, 0.3]", "task.start_deg"),
    ('cloud = "none.ply"\nradius_m = 0.01', "none.ply.*can't be read .No such file"),
    ('cloud = "nan.npy"\nradius_m = 0.01', "row 3, column 2 is no number, nor are 2 others; leave"),
    ('cloud = "bad.ply"\nradius_m = 0.01', "bad.ply.*can't be read"),
    ('cloud = "bad.pcd"\nradius_m = 0.01', "bad.pcd.*can't be read"),
    ('cloud = "scan.stl"\nradius_m = 0.01', "give one of: .ply"),
    ('cloud = "wide.npy"\nradius_m = 0.01', "give scale = 0.001"),
    ('cloud = "flat.npy"\nradius_m = 0.01', "no point cloud; give 1 or more rows of 3 or more numbers"),
    ('cloud = "good.npy"', "obstacle 1.radius_m is missing; add it, in metres"),
    ('cloud = "good.npy"\nradius_m = 0', "radius_m is 0, not a number above zero"),
    ('cloud = "good.npy"\nradius_m = 0.01\nsize_m = [1, 1, 1]', "unknown key 'size_m'"),
]
POSES = [
    ("xyz_m = [3, 0, 0]", "can't bring link_6 there; they come within [0-9]{4} mm; move the pose$"),
    ("xyz_m = [0.3, 0, 0.4]\nframe = 'claw'", "no frame 'claw'; use one of: .*link_6"),
    ("xyz_m = [0.3, 0]", "has 2 numbers, not 3"),
    ("xyz_m = [300, 0, 400]", "has 400, beyond 100; give metres"),
    ("rpy_rad = [0, 0, 0]", "xyz_m is missing"),
    ("xyz_m = [0.3, 0, 0.4]\nquaternion_xyzw = [0, 0, 0, 2]", "has length 2, not 1"),
    ("xyz_m = [0.3, 0, 0.4]\nquaternion_xyzw = [0, 0, 0, 1]\nrpy_rad = [0, 0, 0]", "give one of them"),
    ("xyz_m = [0.3, 0, 0.4]\nyaw = 3", "unknown key 'yaw'"),
    ("xyz_m = [0.0, 0.0, 0.05]", "in all of them something collides|can't bring"),
]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((TABLE3.replace(old, new), words) for old, new, words in CHANGED),
        *((f"{TABLE3}\n{more}\n", words) for more, words in ADDED),
        *((f"{TABLE3}\n[[obstacle]]\n{more}\n", words) for more, words in OBSTACLES),
        *((POSE + more, words) for more, words in POSES),
    ],
)
def test_a_fault_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    points = scanned(9, 40)
    for name, values in (("good", points), ("wide", 1e4 * points), ("flat", points[:, :2])):
        np.save(tmp_path / f"{name}.npy", values)
    points[2:5, 1] = np.nan
    np.save(tmp_path / "nan.npy", points)
    (tmp_path / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n1\n")
    (tmp_path / "bad.pcd").write_text("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nDATA ascii\n1 2 3\n")
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=words.replace("[[", r"\[\[")) as error:
        open_task(path)
    assert "\n" not in str(error.value)
    assert "tm9" in str(error.value) or str(tmp_path) in str(error.value) or "no link 'nose'" in str(error.value)
