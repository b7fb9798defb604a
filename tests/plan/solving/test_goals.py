"""Goals as poses: every way to stand there is found, and what can't be reached is told in one line."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.robot.arm import ArmModel
from plan.api.planning import open_task
from plan.initial.inverse_kinematics import reach_pose
from plan.options import SolveOptions
from plan.problem.rules import Pose

TASK = """robot = "tm5-900"
[task]
start_deg = [50, 0, -120, 0, 30, 0]
duration_s = 2.0
"""


def posed(arm: ArmModel, q: np.ndarray, turned: bool = True) -> tuple[np.ndarray, np.ndarray | None]:
    at = arm.forward_kinematics(q)[arm.links[-1]]
    return at[:3, 3], at[:3, :3] if turned else None


@pytest.mark.parametrize(
    ("robot", "q"), [("tm5-900", [0.4, 0.4, 1.3, 0.5, 1.1, 0.2]), ("ur5", [0.4, -0.9, 1.3, -0.5, 1.1, 0.2])]
)
def test_all_eight_ways_of_a_six_jointed_arm(robot: str, q: list[float]) -> None:
    """Elbow, shoulder and wrist have two ways each; all of them bring the frame there, the drawn one among them."""
    arm = ArmModel.load(robot)
    ways, outside, _ = reach_pose(
        arm, Pose(None, *posed(arm, np.array(q))), arm.links[-1], np.zeros(6), arm.lower, arm.upper
    )
    assert len(ways) + outside == 8
    assert min(np.abs(np.angle(np.exp(1j * (way - q)))).max() for way in ways) < 1e-4
    for way in ways:
        assert arm.forward_kinematics(way)[arm.links[-1]][:3, 3] == pytest.approx(posed(arm, np.array(q))[0], abs=1e-6)
    far = [np.abs(way).max() for way in ways]
    assert far == sorted(far)


def scene(folder: Path, pose: str, task: str = TASK) -> Path:
    path = folder / "scene.toml"
    path.write_text(f"{task}[task.goal_pose]\n{pose}\n")
    return path


@pytest.mark.parametrize("kind", ["rpy_rad", "quaternion_xyzw"])
def test_a_plan_ends_at_the_pose(tmp_path: Path, kind: str) -> None:
    """Angles and quaternions name the same turn; the plan's end stands there, and what was chosen from is told."""
    arm = ArmModel.load("tm5-900")
    place, rotation = posed(arm, np.radians([70.0, 20.0, -80.0, 10.0, 60.0, 20.0]))
    turn = pin.rpy.matrixToRpy(rotation) if kind == "rpy_rad" else pin.Quaternion(rotation).coeffs()
    task = open_task(scene(tmp_path, f'frame = "link_6"\nxyz_m = {place.tolist()}\n{kind} = {turn.tolist()}'))
    assert len(task.problems) >= 4
    result = task.solve(SolveOptions(method="cma", evaluations=300, gap=False))
    at = arm.forward_kinematics(result.splines.points[0, -1])["link_6"]
    assert at[:3, 3] == pytest.approx(place, abs=1e-6)
    assert at[:3, :3] == pytest.approx(rotation, abs=1e-6)
    assert "joint positions bring the frame to the goal's pose" in result.notes[0]
