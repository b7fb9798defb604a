"""Plans as a controller takes them, and as the simulated arm is asked to follow them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.trajectories.gentle_ends import GentleEnds
from ident.trajectories.plan_record import read_plan
from plan.problem.certificate import certify
from plan.problem.execution import execute, require_writable
from plan.problem.ramps import find_time_law
from plan.problem.result import PlanResult
from plan.solving.solve import solve
from tests.plan.worlds import START, problem

HELD = {"joint_4": 0.0, "joint_5": 0.3, "joint_6": 0.0}


@pytest.fixture(scope="module")
def result() -> PlanResult:
    task = problem()
    splines = task.decode(task.initial)
    return PlanResult(
        "solved", "reference", "energy", "absolute", 0, splines=splines, certificate=certify(task, splines),
        robot="tm5_900", joints=("joint_1", "joint_2", "joint_3"), held=HELD,
    )  # fmt: skip


def test_motions_start_and_end_at_rest_with_bounded_jerk(result: PlanResult) -> None:
    """Velocity and acceleration are zero at both ends, derivatives fit, and the path is the plan's own."""
    motion = execute(result, 2000.0)
    assert motion.joints == (*result.joints, *HELD)
    for values in (motion.dq, motion.ddq):
        assert values[[0, -1]] == pytest.approx(0.0, abs=1e-9)
    assert np.gradient(motion.q, motion.times, axis=0)[1:-1] == pytest.approx(motion.dq[1:-1], abs=2e-3)
    assert np.gradient(motion.dq, motion.times, axis=0)[2:-2] == pytest.approx(motion.ddq[2:-2], abs=0.25)
    finer = execute(result, 8000.0)
    jerks = [np.abs(np.diff(one.ddq, axis=0) / np.diff(one.times)[:, None])[:-2].max() for one in (motion, finer)]
    assert jerks[1] < 1.2 * jerks[0]  # a jump of the acceleration would make it four times as large
    path = result.splines.at(np.linspace(0.0, float(result.splines.total[0]), 4000))[0]
    apart = np.abs(motion.q[::50, None, :3] - path[None]).max(axis=2).min(axis=1)
    assert apart.max() < 2e-3
    assert motion.q[-1, :3] == pytest.approx(result.splines.points[0, -1])
    assert np.all(motion.q[:, 4] == 0.3)


def test_ramps_keep_the_torque_limits() -> None:
    """A motion at its torque limit from the first instant on is executed within it, at little cost in time."""
    task = problem()
    task = replace(task, objective="time", free="both")
    splines = task.decode(task.initial)
    peak = np.abs(task.model.torque(*splines.states(np.linspace(0, 1, 400)))[0]).max(axis=0)
    task = replace(task, limits=replace(task.limits, torque=peak))
    law = find_time_law(task, splines)
    q, dq, ddq = law.states(splines, np.linspace(0.0, law.duration, 20_000))
    torque = np.abs(task.model.torque(q[None], dq[None], ddq[None])[0])
    assert law.ramp > 0.0
    assert (torque / peak).max() <= 1.0 + 1e-3
    assert torque.max(axis=0) / peak == pytest.approx(1.0, abs=0.2)
    assert law.duration < float(splines.total[0]) * 1.03 + law.ramp
    assert law.shares[0] == pytest.approx((torque / peak).max(), abs=1e-3)


@pytest.mark.parametrize(("total", "ramp"), [(0.2, 0.04), (0.65, 0.05), (8.0, 0.05)])
def test_a_time_law_adds_hardly_any_acceleration(total: float, ramp: float) -> None:
    """Under a steady acceleration the execution asks for no more than 2 % above it; its rates are its derivatives."""
    ends = GentleEnds(total, ramp)
    t = np.linspace(0.0, ends.duration, 50_001)
    s, rate, change = ends.at(t)
    assert s[[0, -1]] == pytest.approx([0.0, total], abs=1e-12)
    assert np.gradient(s, t)[1:-1] == pytest.approx(rate[1:-1], abs=1e-4)
    assert np.gradient(rate, t)[2:-2] == pytest.approx(change[2:-2], abs=1e-2)
    first = t < ends.duration / 2
    assert (s * change + rate**2)[first].min() >= 0.0
    assert (s * change + rate**2)[first].max() < 1.02
    assert rate.max() <= 1.0 + 1e-12
    assert ends.duration - total < ramp


def test_files_hold_the_motion(result: PlanResult, tmp_path: Path) -> None:
    """CSV, Parquet and ROS 2's JointTrajectory say the same."""
    yaml = pytest.importorskip("yaml")
    motion = execute(result, 100.0)
    for suffix in (".csv", ".parquet", ".yaml"):
        motion.save(tmp_path / f"m{suffix}")
    tables = pacsv.read_csv(tmp_path / "m.csv"), pq.read_table(tmp_path / "m.parquet")
    for table in tables:
        assert np.asarray(table["joint_2/position_command"]) == pytest.approx(motion.q[:, 1])
        assert np.asarray(table["joint_5/velocity_command"]) == pytest.approx(0.0)
    message = yaml.safe_load((tmp_path / "m.yaml").read_text())
    assert message["joint_names"] == list(motion.joints)
    assert len(message["points"]) == len(motion.times)
    stamps = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]]
    assert stamps == pytest.approx(motion.times)
    assert np.array([p["velocities"] for p in message["points"]]) == pytest.approx(motion.dq, abs=1e-8)
    # With accelerations ROS 2's controller makes quintics, which are another curve than the certified cubics.
    assert all(p["accelerations"] == [] for p in message["points"])


def test_bad_names_and_rates_are_refused() -> None:
    """An unknown format and a rate out of bounds are reported before anything is planned."""
    with pytest.raises(InputError, match=r"end it in one of: \.csv"):
        require_writable(Path("motion.txt"), 100.0)
    for rate in (0.0, float("nan"), 1e9):
        with pytest.raises(InputError, match="give 10 to 10000 Hz"):
            require_writable(Path("motion.csv"), rate)


def test_the_simulated_arm_is_asked_for_the_same_motion(result: PlanResult, tmp_path: Path) -> None:
    """A plan read back from its record is the motion that is written for a controller, held joints included."""
    result.save(tmp_path / "plan.json")
    arm = ArmModel.load("tm5-900")
    motion, wanted = read_plan(tmp_path / "plan.json", arm), execute(result, 1000.0)
    moving = motion.q[300:-300]
    assert len(moving) - len(wanted.times) in (0, 1)
    assert moving[: len(wanted.times) - 1] == pytest.approx(wanted.q[:-1], abs=1e-9)
    assert motion.ddq[300:-300][: len(wanted.times) - 1] == pytest.approx(wanted.ddq[:-1], abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": "ur10"}, "the plan is for 'ur10'"),
        ({"joints": ["joint_1", "joint_2", "joint_9"]}, "says nothing of joint_3"),
        ({"status": "infeasible"}, "not solved"),
        ({"schema": "x"}, "no record of plan.result/1"),
        ({"duration_s": -1.0}, "not a number of 0 or more"),
        ({"times_s": [0.5, 0.1]}, "do not rise"),
        ({"via_points_rad": [[0.0], [1.0]]}, "no rows of joint angles"),
        ({"via_points_rad": [[0.0, 0.0, 99.0], [0.0, 0.0, 0.0]]}, "out of the arm's limits"),
    ],
)
def test_wrong_plans_are_refused(result: PlanResult, tmp_path: Path, change: dict[str, object], words: str) -> None:
    """Another robot's plan, one without a motion, and broken records name what is wrong."""
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({**result.to_dict(), **change}))
    with pytest.raises(InputError, match=words):
        read_plan(path, ArmModel.load("tm5-900"))


def test_certificates_tell_every_limit(result: PlanResult) -> None:
    """Shares of speed, acceleration, jerk and torque; what passes a limit is named, what has none is null."""
    assert set(result.to_dict()["limits"]) == {"speed", "acceleration", "jerk", "torque"}
    assert result.to_dict()["limits"]["jerk"] is None
    task = problem()
    limits = replace(task.limits, acceleration=np.full(3, 0.5), jerk=np.full(3, 1.0))
    tight = replace(task, limits=limits)
    certificate = certify(tight, tight.decode(tight.initial))
    words = "; ".join(certificate.broken)
    assert "of its acceleration limit" in words
    assert "of its jerk limit" in words


def test_a_start_that_is_the_goal_is_a_plan_of_zero_length(tmp_path: Path) -> None:
    """Nothing is searched; the record says so, and the motion is a single point."""
    found = solve(replace(problem(), goal=START))
    assert found.solved
    record = found.to_dict()
    assert record["duration_s"] == 0.0
    assert record["energy_J"]["absolute"] == 0.0
    assert record["clearance_m"] > 0.0
    assert record["evaluations"] == 0
    assert len(execute(found).times) == 1
