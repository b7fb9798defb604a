"""What makers publish is kept, unless the task says otherwise; what is missing is said."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ident.robot.arm import ArmModel
from plan.problem.makers_limits import TABLE, find_makers_limits
from plan.problem.task_file import load_task
from plan.solving.set_up import set_up

TASK = """robot = "{robot}"
[task]
start_deg = {start}
goal_deg = {goal}
duration_s = 2
{more}"""


def limits_of(folder: Path, more: str = "", robot: str = "panda", joints: int = 7):  # type: ignore[no-untyped-def]
    start, goal = ([*ends, 0, -90, 0, 90, 0][:joints] for ends in ([0, 0], [20, 10]))
    (folder / "scene.toml").write_text(TASK.format(robot=robot, start=start, goal=goal, more=more))
    return set_up(load_task(folder / "scene.toml"))


def test_every_row_says_where_it_is_from() -> None:
    """A source, and as many positive numbers as joints; a binding row has limits of acceleration."""
    for row in tomllib.loads(TABLE.read_text())["arm"]:
        assert len(row["source"]) > 20
        for key in ("speed_rad_s", "acceleration_rad_s2", "jerk_rad_s3"):
            assert key not in row or (len(row[key]) == row["joints"] and min(row[key]) > 0.0)
        assert not row["binding"] or "acceleration_rad_s2" in row


@pytest.mark.parametrize(("robot", "binding"), [("panda", True), ("xarm7", True), ("ur5", False), ("tm5-900", False)])
def test_arms_are_known_by_their_urdf(robot: str, binding: bool) -> None:
    found = find_makers_limits(ArmModel.load(robot))
    assert found.binding == binding


NAMES = [("fr3", 7, 301.4), ("lbr_iiwa_14_r820", 7, 135.0), ("iiwa7", 7, 180.0), ("GEN3_URDF_V12", 7, 66.46)]


@pytest.mark.parametrize(("name", "joints", "speed"), [*NAMES, ("gen3", 6, 66.46), ("ur3e_robot", 6, 360.0)])
def test_arms_are_known_by_the_names_of_makers(name: str, joints: int, speed: float) -> None:
    """Law: the first row that fits a name and a number of joints, its last joint's speed among them."""
    found = find_makers_limits(SimpleNamespace(name=name, source=None, n=joints))  # type: ignore[arg-type]
    assert np.degrees(found.speed)[-1] == pytest.approx(speed, rel=1e-3)


def test_makers_limits_are_kept_where_the_task_gives_none(tmp_path: Path) -> None:
    """The task's own come first; without either the result says that they are missing. A URDF may not say more."""
    kept = limits_of(tmp_path)
    assert kept.limits.acceleration == pytest.approx([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
    assert len(kept.limits.jerk) == 7
    assert limits_of(tmp_path, "", "ur10", 6).limits.speed[0] == pytest.approx(np.radians(120.0), rel=1e-4)
    assert any("libfranka" in note for note in kept.notes)
    assert any("without --model" in note for note in kept.notes)
    own = limits_of(tmp_path, "[limits]\nacceleration_deg_s2 = [90, 90, 90, 90, 90, 90, 90]\n")
    assert own.limits.acceleration == pytest.approx(np.full(7, np.pi / 2))
    without = limits_of(tmp_path, "[limits]\nmakers = false\n")
    assert without.limits.acceleration is None
    assert any("no limit of acceleration and jerk" in note for note in without.notes)
