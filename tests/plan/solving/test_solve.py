"""Plans that certify themselves, and tasks that have none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plan.geometry.solids import Box
from plan.initial.starts import straight
from plan.options import CompareOptions, SolveOptions
from plan.planners import Candidate
from plan.planners.evolution import Evolution
from plan.problem.result import certify
from plan.problem.task_file import Trial
from plan.solving.compare import compare, cost_at
from plan.solving.set_up import find_obstruction, from_trial
from plan.solving.solve import _certified, find_starts, solve
from tests.plan.worlds import GOAL, MONITOR, START, joint_nets, ledger, model, problem, three_joints

# Two walls from 24 cm beside the base's axis outwards and far up; the wrist's far side is 29 cm from the axis in every
# position, so there is no way from one side of the walls to the other.
WALLS = [Box(f"wall {x}", 0, np.eye(3), [x, 0.0, 0.85], [0.48, 0.01, 0.85]) for x in (-0.72, 0.72)]


def test_certificate_equals_pinocchio_and_coal() -> None:
    """Peaks, energy and clearance of a plan equal those of a plain loop over Pinocchio and Coal."""
    task = problem(MONITOR, duration=1.0)
    result = solve(task, SolveOptions(method="cma", gap=False))
    assert result.solved
    arm, losses = three_joints(), task.model.losses
    times = np.linspace(0, 1.0, 10_000)
    q, dq, ddq = result.splines.at(times)
    tau = arm.inverse_dynamics(q, dq, ddq) + losses.motor_inertia * ddq + losses.viscous * dq
    tau += losses.coulomb * np.tanh(dq / 0.01) + losses.offset
    energy = np.trapezoid(np.abs(tau * dq).sum(axis=1), times)
    assert result.certificate.energy["absolute"] == pytest.approx(energy, rel=2e-3)
    assert result.certificate.torque_share == pytest.approx(np.abs(tau).max(axis=0) / arm.effort_limit, rel=5e-3)
    assert all(task.scene.distances(row).min() > 0.0 for row in q)
    least = min(task.scene.proximity.distances(row).min() for row in q[::10])
    assert least - 1e-3 <= result.certificate.clearance.proven <= least + 1e-6


@pytest.mark.parametrize("turn", [0.31, 0.52, 0.73])
def test_certificate_sees_peaks_where_joints_turn(turn: float) -> None:
    """Friction changes sign within a millisecond; the certificate's peak equals that of a hundred times finer look."""
    task = problem(duration=1.0)
    vias = np.radians([[60.0, 40.0 * turn, -125.0 - 10.0 * turn], [85.0 + 10.0 * turn, 35.0, -100.0]])
    splines = task.decode(task.encode(vias, task.durations)[None])
    q, dq, ddq = splines.at(np.linspace(0, 1.0, 120_000))
    tau = task.model.torque(q[None], dq[None], ddq[None])[0]
    peak = np.abs(tau).max(axis=0)
    tight = replace(task, limits=replace(task.limits, torque=peak))
    assert certify(tight, splines).torque_share == pytest.approx(np.ones(3), abs=2e-5)


def test_record_has_the_contracts_keys(tmp_path: Path) -> None:
    """`plan.problem.result/1` as promised, and as JSON."""
    result = solve(problem(), SolveOptions(method="sqp"))
    result.save(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    keys = "schema status method objective metric energy_J duration_s peak_torque_share collision_free clearance_m "
    keys += "via_points_rad times_s evaluations seconds seed reference_gap cpu_seconds bound"
    assert set(keys.split()) <= set(record)
    assert record["schema"] == "plan.result/1"
    assert set(record["energy_J"]) == {"signed", "positive", "absolute"}
    assert len(record["via_points_rad"]) == len(record["times_s"]) >= 2
    assert record["bound"] <= record["energy_J"]["absolute"]
    assert record["reference_gap"] == 0.0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"durations": np.zeros(3)}, "duration is zero"),
        ({"durations": np.full(3, 0.01)}, "too short"),
        ({"goal": np.radians([80.0, 200.0, -90.0])}, "out of its limits"),
    ],
)
def test_impossible_tasks_have_a_reason(changes: dict[str, np.ndarray], reason: str) -> None:
    """Zero or too short a duration, or an end out of limits: a status and a reason, at once."""
    result = solve(replace(problem(), **changes), SolveOptions(method="cma"))
    assert result.status == "infeasible"
    assert reason in result.reason
    assert result.evaluations == 0


@pytest.mark.parametrize(("limit", "power", "room"), [("acceleration", 2, 4.0), ("jerk", 3, 12.0)])
def test_durations_that_the_limits_rule_out(limit: str, power: int, room: float) -> None:
    """A way d takes √(4 d / a) and ∛(12 d / j) at least: told before anything is searched, and no sooner."""
    task, way = problem(duration=1.0), float(np.abs(GOAL - START).max())
    for share, told in ((0.9, True), (1.1, False)):
        limits = replace(task.limits, **{limit: np.full(3, share * room * way)})  # 1: just what takes the task's 1 s
        reason = find_obstruction(replace(task, limits=limits))
        assert (f"at the {limit} limits it takes {share ** (-1 / power):.3f} s" in reason) == told


def test_goal_inside_an_obstacle() -> None:
    """The goal in a box is told with the names of both."""
    tip = three_joints().forward_kinematics(GOAL)["link_6"][:3, 3]
    result = solve(problem(Box("crate", 0, np.eye(3), tip, [0.1, 0.1, 0.1])), SolveOptions(method="cma"))
    assert result.status == "infeasible"
    assert "the goal is not allowed: " in result.reason
    assert " collide there" in result.reason
    assert "crate" in result.reason


def test_arm_too_weak_to_hold_itself() -> None:
    """A torque limit below what gravity asks for at an end is named, with both torques."""
    task = problem()
    weak = replace(task, limits=replace(task.limits, torque=np.array([157.0, 10.0, 157.0])))
    result = solve(weak, SolveOptions(method="cma"))
    assert result.status == "infeasible"
    assert "joint 2 can't hold the arm" in result.reason
    needed = float(result.reason.split("that takes ")[1].split(" N m")[0])
    still = np.zeros((1, 2, 3))
    torque = np.abs(weak.model.torque(np.stack([weak.start, weak.goal])[None], still, still)[0, :, 1])
    assert needed == pytest.approx(torque.max(), rel=5e-3)
    assert result.reason.endswith("it may use 10 N m")


def test_unreachable_goal_within_the_budget() -> None:
    """Walls between start and goal: no plan, a reason that names what is hit and why no seed was found."""
    start, goal = np.radians([-90.0, 40.0, 60.0]), np.radians([90.0, 40.0, 60.0])
    task = replace(problem(*WALLS, duration=3.0), start=start, goal=goal, vias=straight(start, goal, 2))
    assert task.scene.separation(np.stack([start, goal])).min() > 0.005
    result = solve(task, SolveOptions(method="cma", evaluations=600, seconds=20.0, gap=False))
    assert result.status in ("infeasible", "budget_spent")
    assert result.evaluations <= 600
    assert "wall" in result.reason
    assert "no way round the obstacles was found" in result.reason


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_seconds_bound_the_starts_too(objective: str) -> None:
    """With next to no time a task with a way round is answered at once, with what ended the search."""
    task = problem(MONITOR, duration=1.0, objective=objective, free="vias" if objective == "energy" else "both")
    result = solve(task, SolveOptions(method="cma", evaluations=10**6, seconds=0.01, gap=False))
    assert result.status == "budget_spent"
    assert result.reason


def test_budget_spent_is_told() -> None:
    """With five evaluations and a box in the way the status says what ended the search, or the plan is allowed."""
    result = solve(problem(MONITOR, duration=1.0), SolveOptions(method="ga", evaluations=5, seconds=10.0, gap=False))
    assert result.evaluations <= 5
    assert result.status == "budget_spent" or (result.certificate is not None and not result.certificate.broken)


def test_gap_to_the_default_method() -> None:
    """A genetic algorithm is a little above the default method, and the gap says by how much."""
    task = problem()
    known = solve(task)
    other = solve(task, SolveOptions(method="ga", evaluations=1000, seconds=60.0))
    assert other.reference_gap == pytest.approx(other.cost / known.cost - 1.0, abs=1e-6)
    assert other.reference_gap > 0


def test_taught_vias_are_improved() -> None:
    """From taught via points with time stamps, energy falls and the number of via points stays."""
    taught = Trial("hand", np.radians([[45.0, 18.0, -95.0], [62.0, 30.0, -80.0]]), np.array([1.5, 2.7]))
    task = problem(MONITOR, duration=4.0)
    task = from_trial(task, taught)
    start = find_starts(task, np.random.default_rng(0)).problems
    assert len(start) == 1
    assert start[0].durations == pytest.approx([1.5, 1.2, 1.3])
    result = solve(task, SolveOptions(method="cma", gap=False))
    assert result.solved
    assert result.cost < start[0].initial_evaluation.cost[0]
    assert result.splines.points.shape[1] == 4


def test_time_starts_from_the_energy_optimum() -> None:
    """For the time objective the initial path is the energy optimum, as in the paper."""
    task = problem(duration=1.0, objective="time", free="times")
    (start,) = find_starts(task, np.random.default_rng(0)).problems
    energy = Evolution().run([problem(duration=1.0)], ledger(), np.random.default_rng(0)).best
    assert np.abs(start.vias - energy.splines.points[0, 1:-1]).max() < 0.05
    result = solve(task, SolveOptions(method="cma", gap=False))
    assert result.solved
    assert result.cost < 0.5


def test_mended_between_samples() -> None:
    """Whatever the search's samples miss, a returned plan breaks nothing when looked at densely."""
    result = solve(
        problem(objective="time", free="both", model=model(joint_nets())), SolveOptions(method="ppo", gap=False)
    )
    assert result.solved
    assert result.certificate.torque_share.max() <= 1.0 + 1e-9
    assert result.certificate.speed_share.max() <= 1.0 + 1e-9


@pytest.mark.parametrize("objective", ["time", "energy"])
def test_mending_ends_at_the_first_motion_that_passes(objective: str) -> None:
    """A limit passed by half a thousandth costs a fifth of a per cent at most, and no search all over again."""
    task = replace(problem(duration=1.0), objective=objective, free="both" if objective == "time" else "vias")
    splines = solve(task, SolveOptions(evaluations=40, gap=False)).splines
    limits = replace(task.limits, speed=splines.top_speed[0] / 1.0005)
    tight = task.with_initial(splines, limits=limits)
    own, (cost,) = ledger(), tight.initial_evaluation.cost
    own.best = Candidate(tight, tight.initial, float(cost), 0.0)
    found, certificate = _certified(own, np.random.default_rng(0))
    assert not certificate.broken
    assert found.cost <= 1.002 * cost
    assert own.evaluations < 300


def test_comparison_counts_alike() -> None:
    """Every method has its row; costs at equal evaluations never lie below the end's; the best is zero above itself."""
    table = compare(problem(), "table 3", CompareOptions(methods="cma,ppo,ga", seeds=2, evaluations=300, seconds=0.5))
    rows = table.rows()
    assert [row["method"] for row in rows] == ["cma", "ppo", "ga"]
    assert all(row["runs"] == 2 for row in rows)
    for row in rows:
        assert row["cost_at_evaluations"] >= row["cost"] * (1 - 1e-2)
        assert row["above_best"] >= -1e-12
    assert min(row["above_best"] for row in rows) < 1e-3
    run = table.results[0]
    assert cost_at(run, 10**9, 0) == pytest.approx(run.cost, rel=1e-2)
    assert cost_at(run, 0, 0) == float("inf")
