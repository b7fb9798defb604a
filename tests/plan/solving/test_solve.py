"""Plans that certify themselves, tasks that have none, what no plan can cost less than, and goals that are poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.compiled import compile_seconds
from ident.robot.arm import ArmModel
from plan.api.planning import open_task, tell_compiling
from plan.command_options import CompareOptions, SolveOptions
from plan.dynamics.power import power_integral, section_nodes
from plan.geometry.solids import Box
from plan.initial.inverse_kinematics import reach_pose
from plan.initial.vias import straight
from plan.planners import base
from plan.planners.base import Candidate, Ledger, budget_seconds
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential
from plan.problem.certificate import certify
from plan.problem.rules import Pose
from plan.solving.bound import least_energy, least_time
from plan.solving.compare import compare, cost_at
from plan.solving.mending import certify_best, time_for_mending
from plan.solving.obstruction import find_obstruction
from plan.solving.set_up import from_taught
from plan.solving.solve import LEAST_SECONDS, _ledger, find_starts, solve
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
    assert all(task.scene.distances(row).min() > 0.0 for row in q[::4])
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
    for share, seen in ((0.9, True), (1.1, False)):
        limits = replace(task.limits, **{limit: np.full(3, share * room * way)})  # 1: just what takes the task's 1 s
        reason = find_obstruction(replace(task, limits=limits))
        assert (f"at the {limit} limits it takes {share ** (-1 / power):.3f} s" in reason) == seen


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


def test_gap_to_the_default_method() -> None:
    """A genetic algorithm is a little above the default method, and the gap says by how much."""
    task = problem()
    known = solve(task)
    other = solve(task, SolveOptions(method="ga", evaluations=1000, seconds=60.0))
    assert other.reference_gap == pytest.approx(other.cost / known.cost - 1.0, abs=1e-6)
    assert other.reference_gap > 0


def test_taught_vias_are_improved() -> None:
    """From taught via points with time stamps, energy falls and the number of via points stays."""
    vias = np.radians([[45.0, 18.0, -95.0], [62.0, 30.0, -80.0]])
    task = from_taught(problem(MONITOR, duration=4.0), vias, np.array([1.5, 2.7]))
    start, _ = find_starts(task, np.random.default_rng(0))
    assert len(start) == 1
    assert start[0].durations == pytest.approx([1.5, 1.2, 1.3])
    result = solve(task, SolveOptions(method="cma", gap=False))
    assert result.solved
    assert result.cost < start[0].initial_evaluation.cost[0]
    assert result.splines.points.shape[1] == 4


def test_time_starts_from_the_energy_optimum() -> None:
    """For the time objective the initial path is the energy optimum, as in the paper."""
    task = problem(duration=1.0, objective="time", free="times")
    (start,), _ = find_starts(task, np.random.default_rng(0))
    energy = Evolution().run([problem(duration=1.0)], ledger(), np.random.default_rng(0)).best
    assert np.abs(start.vias - energy.splines.points[0, 1:-1]).max() < 0.05
    result = solve(task, SolveOptions(method="cma", gap=False))
    assert result.solved
    assert result.cost < 0.5


@pytest.mark.parametrize("objective", ["time", "energy"])
def test_mending_ends_at_the_first_motion_that_passes(objective: str) -> None:
    """A limit passed by half a thousandth costs a fifth of a per cent at most, and no search all over again."""
    task = replace(problem(duration=1.0), objective=objective, free="both" if objective == "time" else "vias")
    splines = solve(task, SolveOptions(evaluations=40, gap=False)).splines
    limits = replace(task.limits, speed=splines.top_speed[0] / 1.0005)
    tight = task.with_initial(splines, limits=limits)
    own, (cost,) = ledger(), tight.initial_evaluation.cost
    own.best = Candidate(tight, tight.initial, float(cost), 0.0)
    found, certificate = certify_best(own, np.random.default_rng(0), None)
    assert not certificate.broken
    reached = float(found.total[0]) if objective == "time" else certificate.energy[tight.metric]
    assert reached <= 1.002 * cost
    assert own.evaluations < 300


def test_seconds_hold_all_that_a_task_takes() -> None:
    """Law: what was spent before, the search, and what is kept for the certificate are what was asked for."""
    asked = SolveOptions(seconds=3.0)
    for spent, left in ((0.0, 3.0), (1.0, 2.0), (5.0, LEAST_SECONDS)):
        own = _ledger(asked, spent)
        assert own.most_seconds + own.kept_back == pytest.approx(left)
        assert own.kept_back > 0.0
        assert time_for_mending(own) <= left
    own = _ledger(SolveOptions(), 5.0)  # where nothing is asked for, the search has its usual time
    assert own.most_seconds == SolveOptions().budget[1]
    assert own.kept_back == 0.0
    spent = replace(asked, seconds=0.5)
    result = open_task(Path(__file__).parents[1] / "data" / "obstacle.toml", None, replace(spent, beyond=True))
    found = result.solve(replace(spent, beyond=True, gap=False), began=budget_seconds() - 10.0)
    assert found.cpu_seconds >= 10.0  # what was spent before counts
    assert found.evaluations < 2000


def test_seconds_do_not_hold_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what compiling takes leaves a search its time, and is told beside what that took."""
    own = Ledger(10**9, 3.0)
    now = base.processor_seconds()
    monkeypatch.setattr(base, "processor_seconds", lambda: now + 20.0)
    monkeypatch.setattr(base, "compile_seconds", lambda: compile_seconds() + 20.0)
    assert 0.0 < own.seconds_left <= 3.0
    result = tell_compiling(solve(problem(), SolveOptions(evaluations=40, gap=False)), 20.0)
    assert result.cpu_seconds >= 20.0
    assert "20 s more were spent on compiling" in result.notes[-1]


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


@pytest.mark.parametrize("net", [None, joint_nets()], ids=["no net", "net"])
def test_no_random_motion_takes_less_energy(net) -> None:  # type: ignore[no-untyped-def]
    """Of many motions between the ends none lies below the bound, in any metric that counts joules."""
    rng = np.random.default_rng(0)
    for metric in ("signed", "positive", "absolute"):
        task = problem(model=model(net), metric=metric, duration=1.0)
        bound = least_energy(task)
        motions = task.decode(task.initial + 0.3 * rng.normal(size=(200, task.dimension)))
        s, w = section_nodes(40)
        q, dq, ddq = motions.states(s)
        weights = (motions.durations[:, :, None] * w).reshape(200, -1)
        costs = power_integral(task.model.torque(q, dq, ddq), dq, weights, metric)
        assert costs.min() >= bound


def test_the_energy_bound_is_what_steady_motion_needs() -> None:
    """Without a net the signed bound is lift, viscous loss at steady speed and friction, by hand."""
    task = problem(metric="signed", duration=2.0)
    way, losses = task.goal - task.start, task.model.losses
    arm = task.scene.arm
    q = task.start + np.linspace(0, 1, 2001)[:, None] * way
    lift = float(np.trapezoid(arm.inverse_dynamics(q, 0 * q, 0 * q) @ way, dx=1 / 2000))
    friction = losses.coulomb @ (np.abs(way) - 0.2785 * 0.01 * 2.0) + losses.viscous @ way**2 / 2.0
    assert least_energy(task) == pytest.approx(lift + friction + losses.offset @ way, rel=1e-3)


def test_no_plan_is_faster_than_the_bound() -> None:
    """A time plan lies above the bound, and a task limited by speed alone takes its way by its speed."""
    task = problem(objective="time", free="both")
    best = Sequential(starts=1, kept=(1,), levels=1).run([task], ledger(), np.random.default_rng(0)).best
    bound = least_time(task)
    assert bound <= best.cost
    assert bound >= np.max(np.abs(task.goal - task.start) / task.limits.speed)


def test_copper_has_no_bound() -> None:
    """Where nothing is known nothing is claimed."""
    assert least_energy(problem(metric="copper")) is None


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
    """Angles and quaternions name the same turn; the plan's end stands there, and what was chosen from is reported."""
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
