"""What can't be is refused at once, by its key; a straight line is passed nearly as quickly as can be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import toppra

from ident.errors import InputError
from plan.api.planning import open_task, solve
from plan.command_options import SolveOptions, TaskOptions
from plan.initial.line_pace import quickest_pace, timed_line
from plan.planners.sequential import Sequential
from plan.solving.obstruction import find_obstruction
from plan.solving.solve import cheapest_goal
from plan.solving.solve import solve as solve_problem
from tests.plan.worlds import START, losses, problem, three_joints

LINE = """robot = "ur10"
[task]
start_deg = [0, -60, 90, -120, -90, 0]
goal_deg = [60, -70, 100, -120, -90, 0]
duration_s = 3.0
"""
STRAIGHT = "[tool]\nstraight = true\nspeed_m_s = 0.5\n"
WALL = '[[obstacle]]\nname = "wall"\nsize_m = [0.05, 0.05, 0.3]\nxyz_m = [0.59, 0.48, 0.3]\n'
TM = 'robot = "tm5-900"\n[task]\nstart_deg = [50, 0, -120]\nduration_s = 3.0\n'
QUICK = Sequential(starts=1, kept=(1,), levels=2)


def scene(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LINE + "[[pass]]\nxyz_m = [2.5, 0, 0.5]", r"pass 1\.xyz_m is out of reach: .* comes within 1\d{3} mm"),
        (TM + "goal_deg = [80, 30, -90]\n[[pass]]\ndeg = [50, 100, 150]", r"pass 1\.deg: .* collide there"),
        (TM + "goals_deg = [[80, 30, -290]]", r"task\.goals_deg: -290.0 deg of joint_3 is out"),
        (TM + "goals_deg = [[80, 100, 150]]", r"task\.goals_deg: .*collide there"),
        (TM + "goal_deg = [80, 100, 150]", r"task\.goal_deg: .*collide there"),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(tmp_path: Path, text: str, words: str) -> None:
    """Before any search, with the key as the file has it."""
    with pytest.raises(InputError, match=words):
        open_task(scene(tmp_path, text))


def test_a_place_within_reach_is_taken(tmp_path: Path) -> None:
    """The law's other side: what can be passed is not refused."""
    found = open_task(scene(tmp_path, LINE + "[[pass]]\nxyz_m = [0.7, 0.4, 0.5]"))
    assert len(found.problem.way.vias) == 1


def test_a_line_through_a_wall_has_no_search(tmp_path: Path) -> None:
    """Six joints have no choice along a straight line: what is in its way is named, and nothing is evaluated."""
    path = scene(tmp_path, LINE + STRAIGHT + WALL)
    result = solve(path, gap=False)
    assert result.status == "infeasible"
    assert result.evaluations == 0
    assert "straight line of the tool is blocked" in result.reason
    assert "wall" in result.reason
    aside = scene(tmp_path, LINE + STRAIGHT + WALL.replace("0.48", "1.2"))
    assert find_obstruction(open_task(aside).problem) == ""


def test_a_straight_line_is_nearly_as_quick_as_its_trapezoid(tmp_path: Path) -> None:
    """Within 2 % of the quickest pace along the line, which no motion on it can undercut by more than it may be off."""
    task = open_task(scene(tmp_path, LINE + STRAIGHT), options=TaskOptions("time")).problem
    assert task.rules is not None
    line = timed_line(task, task.rules)
    least = float(line.durations.sum())
    assert least >= task.rules.length / 0.5
    result = solve_problem(task, SolveOptions("time", gap=False, seconds=60.0), QUICK)
    assert result.solved, result.reason
    assert 0.995 * least <= result.cost <= 1.02 * least


def test_the_pace_of_a_straight_joint_path_is_a_trapezoid() -> None:
    """One joint by its limits of speed and acceleration: ramps of v / a, and between them v."""
    task = problem(duration=2.0)
    limits = replace(task.limits, speed=np.full(3, 1.0), acceleration=np.full(3, 4.0), torque=np.full(3, 1e6))
    goal = START + np.array([1.5, 0.0, 0.0])
    task = replace(task, limits=limits, goal=goal)
    path = START + np.linspace(0.0, 1.0, 601)[:, None] * (goal - START)
    rules = open_task(Path(__file__).parents[3] / "examples/scenes/straight_1.toml").problem.rules
    assert rules is not None
    pace = quickest_pace(task, path, rules)
    total = float((2.0 / (pace[1:] + pace[:-1])).sum() / 600)
    assert total == pytest.approx(1.5 / 1.0 + 1.0 / 4.0, rel=2e-3)


@pytest.mark.parametrize("case", range(4))
def test_a_bent_path_is_passed_within_all_limits_and_no_slower_than_need_be(case: int) -> None:
    """By the path's own derivatives and Pinocchio's torque, between its places, too; beside toppra's optimum.

    Friction is left out there, which makes its optimum shorter where torque binds.
    """
    rng = np.random.default_rng([82, case])
    size, phase, rate = 0.4 * rng.normal(size=(2, 3)), rng.uniform(0.0, 6.0, (2, 3)), rng.uniform(2.0, 9.0, (2, 3))
    slope = 0.5 * rng.normal(size=3)
    arm = three_joints()
    friction = losses()
    limits = replace(problem().limits, acceleration=np.full(3, 6.0))
    if case % 2:  # torque binds
        limits = replace(limits, acceleration=None, torque=rng.uniform(0.6, 1.0) * limits.torque)
    task = replace(problem(duration=2.0), limits=limits)

    def path(s: np.ndarray, order: int = 0) -> np.ndarray:
        line = (START + slope * s, slope, 0.0)[order]
        return line + (size * rate**order * np.sin(rate * s[..., None] + phase + order * np.pi / 2.0)).sum(axis=-2)

    even = np.linspace(0.0, 1.0, 241)[:, None]
    rules = open_task(Path(__file__).parents[3] / "examples/scenes/straight_1.toml").problem.rules
    assert rules is not None
    pace = quickest_pace(task, path(even), rules)
    push = np.diff(pace**2) / (2.0 * even[1])
    used = np.zeros(3)
    data = arm.model.createData()
    for share in (0.0, 0.5, 1.0):
        s = even[:-1] + share * even[1]
        square = (pace[:-1] ** 2 + 2.0 * share * even[1] * push)[:, None]
        q, dq = path(s), path(s, 1) * np.sqrt(square)
        ddq = path(s, 1) * push[:, None] + path(s, 2) * square
        tau = np.array([pin.rnea(arm.model, data, *state) for state in zip(q, dq, ddq, strict=True)])
        tau += friction.motor_inertia * ddq + friction.viscous * dq + friction.offset
        tau += friction.coulomb * np.tanh(dq / friction.transition_speed)
        if share == 0.5:  # a joint that turns round there meets its friction between two places
            tau[path(even[:-1], 1) * path(even[1:], 1) <= 0.0] = 0.0
        shares = [dq / limits.speed, tau / limits.torque]
        if limits.acceleration is not None:
            shares.append(ddq / limits.acceleration)
        for number, values in enumerate(shares):
            used[number] = max(used[number], np.abs(values).max())
    assert used.max() <= 1.01
    assert used.max() >= 0.98
    if limits.acceleration is not None:
        total = float((2.0 / (pace[1:] + pace[:-1])).sum() / 240)
        spline = toppra.SplineInterpolator(even[:, 0], path(even))
        bounds = [np.stack([-limit, limit], axis=1) for limit in (limits.speed, limits.acceleration)]
        rates = [toppra.constraint.JointVelocityConstraint(bounds[0])]
        rates.append(toppra.constraint.JointAccelerationConstraint(bounds[1]))
        motion = toppra.algorithm.TOPPRA(rates, spline).compute_trajectory(0.0, 0.0)
        least = float(motion.duration)
        assert 0.995 * least <= total <= 1.015 * least


def test_notes_of_goals_tell_the_truth() -> None:
    """Where no short search reaches any goal the nearest is taken, and nothing is said of a cheapest one."""
    task = problem(duration=0.02)
    _, (note,) = cheapest_goal([task, task], False, (60, 0.2), 0)
    assert "reached none of them, and the nearest was taken" in note
    assert "cheapest" not in note
    easy = problem(duration=2.0)
    _, (note,) = cheapest_goal([easy, easy], False, (600, 6.0), 0)
    assert "reached 2 of them, and the cheapest was taken" in note


def test_a_solved_result_has_a_history() -> None:
    """Its last row is the certified cost; of a start that is the goal, too."""
    for task in (problem(duration=1.0), replace(problem(), goal=START)):
        result = solve_problem(task, SolveOptions(gap=False, evaluations=60), QUICK)
        assert result.solved
        rows = result.to_dict()["history"]
        assert rows[-1][2] == pytest.approx(result.cost)
