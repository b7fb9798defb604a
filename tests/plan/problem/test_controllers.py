"""The curve that a controller makes of a written plan is the one that was certified, and keeps the limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.command_options import SolveOptions
from plan.planners.base import Ledger
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.controllers import Controller, choose_controller, load_controllers
from plan.problem.execution import write_motion_file
from plan.problem.problem import PlanningProblem
from plan.problem.ramps import TimeLaw
from plan.problem.result import PlanResult
from plan.solving.mending import certify_best
from plan.solving.solve import solve
from plan.spline import Splines
from tests.plan.emulated_controllers import Points, by_speedj, moved
from tests.plan.worlds import MONITOR, problem

CONTROLLERS = {controller.name: controller for controller in load_controllers()}
WRIST = {"joint_4": 0.1, "joint_5": 0.3, "joint_6": 0.0}
QUICK = Sequential(starts=2, kept=(1,), levels=2)


def task(objective: str) -> PlanningProblem:
    """A task at its limits of torque, speed and acceleration, beside an obstacle."""
    start = problem(MONITOR, objective=objective, free="both" if objective == "time" else "vias", duration=0.9)
    return replace(start, limits=replace(start.limits, acceleration=np.array([25.0, 20.0, 30.0])))


def planned(controller: Controller, objective: str) -> tuple[PlanningProblem, PlanResult]:
    asked = task(objective)
    result = solve(asked, SolveOptions(gap=False, seconds=20.0), QUICK, controller=controller)
    assert result.solved, result.reason
    return asked, replace(result, held=WRIST)


@pytest.mark.parametrize("objective", ["energy", "time"])
@pytest.mark.parametrize("name", list(CONTROLLERS))
def test_what_is_executed_keeps_all_limits(name: str, objective: str, tmp_path: Path) -> None:
    """Speed, acceleration, torque, clearance and goal of the emulated execution; its energy is the certificate's."""
    controller = CONTROLLERS[name]
    asked, result = planned(controller, objective)
    path = tmp_path / f"motion{controller.suffix}"
    write_motion_file(result, path)
    run = moved(controller.name, controller.tick_s, path, np.concatenate([asked.start, list(WRIST.values())]))
    q, dq, ddq = (np.ascontiguousarray(part[:, :3]) for part in (run.q, run.dq, run.ddq))
    limits, slack = asked.limits, 1.0 + 1e-6
    assert limits.acceleration is not None
    tau = asked.model.torque(q[None], dq[None], ddq[None])[0]
    assert (np.abs(tau) / limits.torque).max() <= slack
    assert (np.abs(dq) / limits.speed).max() <= slack
    assert (np.abs(ddq) / limits.acceleration).max() <= slack
    apart = [asked.scene.distances(row).min() for row in q[::20]]
    assert min(apart) >= limits.clearance - 6e-4
    assert q[0] == pytest.approx(asked.start, abs=1e-6)
    assert q[-1] == pytest.approx(asked.goal, abs=1e-5)
    assert np.abs(dq[[0, -1]]).max() < 1e-5
    assert run.q[:, 3:] == pytest.approx(np.tile(list(WRIST.values()), (len(q), 1)), abs=1e-6)
    work = np.trapezoid(np.abs(tau * dq).sum(axis=1), run.times)
    assert result.certificate is not None
    assert result.certificate.energy["absolute"] == pytest.approx(work, rel=5e-3)
    if objective == "energy":
        assert run.times[-1] - run.times[0] == pytest.approx(0.9, abs=2.1 * controller.tick_s)


@pytest.mark.parametrize("name", ["tmscript", "ur_spline", "ur_servoj"])
def test_least_energy_at_its_acceleration_limits_can_be_executed(name: str) -> None:
    """Law: where least energy goes to its limits, it has its knots on the step and loses hardly anything by it."""
    asked = problem(duration=0.9)
    asked = replace(asked, limits=replace(asked.limits, acceleration=np.full(3, 5.0)))
    alone = solve(asked, SolveOptions(gap=False, seconds=20.0), QUICK)
    found = solve(asked, SolveOptions(gap=False, seconds=20.0), QUICK, controller=CONTROLLERS[name])
    assert alone.solved
    assert alone.certificate is not None
    assert alone.certificate.shares["acceleration"].max() > 0.99
    assert found.solved, found.reason
    assert found.cost <= 1.01 * alone.cost


def test_scripts_numbers_are_single_precision() -> None:
    """Law: what a script's controller holds is what single precision makes of the written number."""
    angles = np.random.default_rng(0).uniform(-6.0, 6.0, (50, 6))
    held = CONTROLLERS["ur_servoj"].rounded(angles)
    assert np.array_equal(held, held.astype(np.float32))
    assert np.abs(held - angles).max() < 3e-7


def test_a_curve_between_coarse_points_is_not_the_plans() -> None:
    """The same plan looked at by itself keeps its limits; on a step of 25 ms what is executed would not."""
    asked = task("time")
    asked = replace(asked, limits=replace(asked.limits, acceleration=None))
    best = solve(asked, SolveOptions(gap=False, seconds=20.0), QUICK)
    assert best.solved
    assert best.splines is not None
    assert best.certificate is not None
    controller = CONTROLLERS["tmscript"]
    moved_plan = controller.put_on_step(best.splines, best.certificate.time_law)
    curve = controller.make_curve(moved_plan)
    tau = asked.model.torque(*curve.states(np.linspace(0.0, 1.0, 50)))[0]
    assert (np.abs(tau) / asked.limits.torque).max() > 1.01
    assert np.diff(np.cumsum(moved_plan.durations[0])).min() >= 0.025 - 1e-12


def test_where_no_time_is_left_a_slower_motion_is_taken() -> None:
    """A time plan that a coarse step would break is slowed down until its executed curve keeps all limits."""
    asked = task("time")
    asked = replace(asked, limits=replace(asked.limits, acceleration=None))
    search = Ledger(10**6, 20.0)
    best = QUICK.run([asked], search, np.random.default_rng(0)).best
    assert best is not None
    spent = Ledger(10**6, 0.0, kept_back=1e-9)
    spent.best = best
    splines, certificate = certify_best(spent, np.random.default_rng(0), CONTROLLERS["tmscript"])
    assert splines is not None
    assert certificate is not None
    assert certificate.broken == []
    assert best.cost < float(splines.total[0]) < 1.5 * best.cost


def test_a_search_on_the_step_ends_with_its_budget() -> None:
    """Law: however few trajectories may be looked at there, the search ends by itself."""
    asked = task("energy")
    start = asked.decode(asked.initial)
    moved_plan = CONTROLLERS["tmscript"].put_on_step(start, TimeLaw(float(start.total[0])))
    on_step = asked.with_initial(moved_plan, free="vias")
    for count in (0, 1, 2):
        ledger = Ledger(count, 20.0)
        descend_on_knots(on_step, ledger, 5)
        assert ledger.remaining == 0


@pytest.mark.parametrize("name", list(CONTROLLERS))
def test_a_plan_on_the_step_stays_as_it_is(name: str) -> None:
    """Put on the step a second time a plan does not change, and its points lie on multiples of it."""
    controller = CONTROLLERS[name]
    asked = task("energy")
    start = asked.decode(asked.initial)
    law = TimeLaw(float(start.total[0]))
    first = controller.put_on_step(start, law)
    again = controller.put_on_step(first, TimeLaw(float(first.total[0])))
    assert again.durations == pytest.approx(first.durations, abs=1e-12)
    assert again.points == pytest.approx(first.points, abs=1e-12)
    stamps = np.cumsum(first.durations[0]) / controller.stamp_s
    assert stamps == pytest.approx(np.round(stamps), abs=1e-6)


def test_a_motion_that_brakes_hard_is_not_slowed_down() -> None:
    """UR's script slows a long last section down that brakes at 40 rad/s²; of one tick it leaves it as it is."""
    controller = CONTROLLERS["ur_spline"]
    way = np.array([[0.0], [0.5], [1.0]])
    splines = Splines(way[None], np.array([[0.2, 0.2]]))
    assert float(splines.end_acceleration.max()) > 35.0
    knots = np.array([0.0, 0.2, 0.4])
    slowed = by_speedj(Points(knots, splines.points[0], splines.slopes[0]), controller.tick_s)
    assert slowed.times[-1] > 0.41
    times, q, dq = controller.sent(controller.put_on_step(splines, TimeLaw(0.4)))
    run = by_speedj(Points(times, q, dq), controller.tick_s)
    assert run.times[-1] == pytest.approx(0.4, abs=1e-9)
    assert np.abs(run.ddq).max() > 35.0
    assert run.q[-1] == pytest.approx(way[-1], abs=5e-6)
    curve = controller.make_curve(controller.put_on_step(splines, TimeLaw(0.4)))
    assert run.q == pytest.approx(curve.at(np.minimum(run.times, float(curve.total[0])))[0], abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_speeds_from_tick_to_tick_end_where_the_plan_ends(seed: int) -> None:
    """Law: however hard a motion accelerates, UR's lines between speeds pass by its knots, and end at its goal."""
    controller = CONTROLLERS["ur_spline"]
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (1, 7, 6))
    splines = Splines(points, rng.uniform(0.1, 0.4, (1, 6)))
    assert float(splines.top_acceleration.max()) > 100.0
    on_step = controller.put_on_step(splines, TimeLaw(float(splines.total[0])))
    times, q, dq = controller.sent(on_step)
    run = by_speedj(Points(times, q, dq), controller.tick_s)
    rounding = 0.5 * 10.0**-controller.digits * (1.0 + controller.tick_s * len(times))
    assert np.abs(run.q[-1] - points[0, -1]).max() < 2.0 * rounding
    at_knots = [run.q[np.argmin(np.abs(run.times - time))] for time in times]
    assert np.abs(np.array(at_knots) - on_step.points[0]).max() < 1e-5
    untouched = by_speedj(Points(times, on_step.points[0], dq), controller.tick_s)
    assert np.abs(untouched.q[-1] - points[0, -1]).max() > 10.0 * rounding


def test_the_arm_and_the_file_name_the_controller() -> None:
    """By the file's ending and the robot; what does not fit is refused with what does."""
    tm, ur, panda = (ArmModel.load(name) for name in ("tm5-900", "ur5", "panda"))
    assert choose_controller(None, None, tm) is None
    assert choose_controller(None, Path("m.csv"), tm) is None
    for out, arm, name in (
        ("m.yaml", tm, "tm_ros2"), ("m.yml", ur, "ros2_control"), ("m.yaml", panda, "ros2_control"),
        ("m.tmscript", tm, "tmscript"), ("m.script", ur, "ur_servoj"),
    ):  # fmt: skip
        chosen = choose_controller(None, Path(out), arm)
        assert chosen is not None
        assert chosen.name == name
    for asked, out, arm, words in (
        ("magic", None, tm, "use one of: tmscript, tm_ros2"),
        ("tmscript", None, ur, "use one of: ros2_control, ur_spline"),
        ("tmscript", Path("m.yaml"), tm, r"end it in one of: \.tmscript"),
        (None, Path("m.tmscript"), ur, "the robot is 'ur5'"),
    ):
        with pytest.raises(InputError, match=words):
            choose_controller(asked, out, arm)
