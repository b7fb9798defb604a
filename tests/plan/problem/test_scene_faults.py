"""Whatever is wrong in a scene file ends in one line with the file, the key and the remedy."""

from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from plan.api.planning import open_task
from tests.plan.geometry.worlds import scanned

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
    ("[[pass]]\ndeg = [1, 2, 900]", "out of the joints' limits"),
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
