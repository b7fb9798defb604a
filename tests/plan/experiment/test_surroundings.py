"""`plan excite` among things: a scene, a floor, narrower limits; and the wrong robot's files."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf, robot_argument
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.around import surroundings_of
from plan.experiment.feasible import Feasibility
from plan.experiment.hypotheses import ask
from plan.options import ExciteOptions

SCENE = """[[obstacle]]
name = "post"
size_m = [0.1, 0.1, 1.0]
xyz_m = [0.5, 0, 0.5]
[limits]
lower_deg = [-90, -60, -120, -90, -90, -90]
upper_deg = [90, 60, 120, 90, 90, 90]
speed_deg_s = [20, 20, 20, 20, 20, 20]
"""


@pytest.fixture(scope="module")
def whole() -> ArmModel:
    return ArmModel.load("tm5-900")


def move(a: np.ndarray, b: np.ndarray) -> ReferenceMotion:
    """Ten seconds from one position to another, from rest to rest."""
    x = np.linspace(0.0, 1.0, 10_001)[:, None]
    share, rate, change = x**3 * (10 - 15 * x + 6 * x**2), 3 * x**2 * (1 - x) ** 2, 6 * x * (1 - x) * (1 - 2 * x)
    return ReferenceMotion("move", a + share * (b - a), rate * (b - a), change * (b - a) / 10)


def test_nothing_goes_below_the_base_plane_unless_told(whole: ArmModel) -> None:
    """A motion that dips under the base plane is allowed without a floor, and refused by default."""
    above, below = np.radians([0.0, 20.0, 30.0, 0.0, 0.0, 0.0]), np.radians([0.0, 100.0, 10.0, 0.0, 0.0, 0.0])
    dip = move(above, below)
    free = Feasibility(whole, around=surroundings_of(whole, ExciteOptions(floor="none")))
    floored = Feasibility(whole, around=surroundings_of(whole))
    assert free.allows(dip)
    assert free.clearance(dip) > 0.0
    assert not floored.allows(dip)
    assert floored.clearance(dip) == 0.0
    assert floored.clearance(move(above, above + 0.01)) > 0.0
    assert "floor" in {box.name for box in floored.scene.obstacles}


def test_a_scene_narrows_what_is_allowed(whole: ArmModel, tmp_path: Path) -> None:
    """Obstacles, joint limits and top speed of a scene file are kept; the option's top speed as well."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    around = surroundings_of(whole, ExciteOptions(scene=path, top_speed=10.0))
    found = Feasibility(whole, around=around)
    assert np.degrees(found.limits.upper) == pytest.approx([90, 60, 120, 90, 90, 90])
    assert np.degrees(found.limits.speed) == pytest.approx(10.0)
    side, front = (np.radians([angle, 30.0, 60.0, 0.0, 0.0, 0.0]) for angle in (-80.0, 80.0))
    assert found.scene.distances(side).min() > 0.01
    assert found.clearance(move(side, front)) == 0.0
    assert Feasibility(whole, around=surroundings_of(whole)).clearance(move(side, front)) > 0.0


@pytest.mark.parametrize(
    ("text", "floor", "words"),
    [
        ('robot = "ur10"\n', "0", "give its --robot"),
        ("[limits]\nlower_deg = [9, 0, 0, 0, 0, 0]\nupper_deg = [1, 1, 1, 1, 1, 1]", "0", "is not below"),
        ("[limits]\nlower_deg = [1, 2]\n", "0", "has 2 numbers, not 6"),
        ("[floor]\nheight_m = 99\nhigh = 1\n", "0", "unknown key 'high'"),
        ("", "low", "is no height"),
        ("", "nan", "is no height"),
    ],
)
def test_bad_surroundings(whole: ArmModel, tmp_path: Path, text: str, floor: str, words: str) -> None:
    """Another robot's scene, limits that contradict each other, and floors that are none."""
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        surroundings_of(whole, ExciteOptions(scene=tmp_path / "scene.toml", floor=floor))


def test_another_robots_diagnosis_is_refused(whole: ArmModel, tmp_path: Path) -> None:
    """Joints of the same names do not make it the same arm."""
    record = {"schema": "ident.diagnosis/1", "robot": "other", "joints": list(whole.joint_names), "findings": []}
    (tmp_path / "d.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="it is of 'other', the robot is"):
        ask(whole, None, None, tmp_path / "d.json")


def test_commands_name_the_robot_so_that_they_run(tmp_path: Path) -> None:
    """A known name stands for itself; a path is quoted for the shell."""
    for name in ("tm5-900", "ur10"):
        arm = ArmModel.load(name)
        assert robot_argument(arm.name, arm.source) == name
    path = tmp_path / "my arm; $x.urdf"
    path.write_text(find_urdf("tm5-900").read_text())
    assert robot_argument("tm5_900", path) == f"'{path}'"
