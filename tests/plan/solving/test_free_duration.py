"""Least energy of any duration: by a sweep, at its bounds, and as it is told."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from plan.api.planning import open_task
from plan.command_options import CompareOptions, SolveOptions, TaskOptions
from plan.planners.sequential import Sequential
from plan.problem.result import PlanResult
from plan.show.pictures import draw_energy_curve, require_curve, save_energy_curve
from plan.solving.free_duration import Look, Searched, lasting, solve_free_duration
from plan.solving.solve import solve
from tests.plan.worlds import problem

OPTIONS = SolveOptions(gap=False, seconds=4.0)
QUICK = Sequential(starts=2, kept=(1,), levels=1)
STANDBY = 40.0
TASK = 'robot = "tm5-900"\n[task]\nstart_deg = [50, 0, -120]\ngoal_deg = [80, 30, -90]\n'


@pytest.fixture(scope="module")
def found() -> PlanResult:
    task = replace(problem(duration=1.0), longest=6.0, standby=STANDBY)
    return solve_free_duration(task, OPTIONS, QUICK)


def test_no_duration_of_a_sweep_costs_a_hundredth_less(found: PlanResult) -> None:
    """Law: energy and standby of motions searched at fixed durations about the best one lie above its cost, or near."""
    assert found.solved, found.reason
    assert found.splines is not None
    assert found.certificate is not None
    best = float(found.splines.total[0])
    assert found.cost == pytest.approx(found.certificate.energy["absolute"] + STANDBY * best)
    costs = []
    for duration in best * np.array([0.8, 0.9, 1.1, 1.25]):
        other = solve(lasting(problem(), float(duration)), OPTIONS, QUICK)
        costs.append(other.cost + STANDBY * duration if other.solved else np.inf)
    assert np.isfinite(costs).any()
    assert found.cost <= 1.01 * min(costs)


def test_the_curve_is_told(found: PlanResult, tmp_path: Path) -> None:
    """Durations rise, the plan's own is among them, and record, table and picture hold the same."""
    rows = np.array(found.energy_curve)
    assert len(rows) >= 5
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert found.splines is not None
    assert np.abs(rows[:, 0] / float(found.splines.total[0]) - 1.0).min() < 1e-9
    record = found.to_dict()
    assert record["standby_W"] == STANDBY
    assert [row["energy_J"] for row in record["energy_curve"]] == pytest.approx(rows[:, 1])
    assert record["history"][-1][2] == pytest.approx(found.cost)
    save_energy_curve(found, tmp_path / "curve.csv")
    with (tmp_path / "curve.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [float(row["duration_s"]) for row in table] == pytest.approx(rows[:, 0], rel=1e-5)
    assert [float(row["cost_J"]) for row in table] == pytest.approx(rows[:, 1] + STANDBY * rows[:, 0], rel=1e-5)
    assert len(draw_energy_curve(found).axes[0].lines) == 3
    with pytest.raises(InputError, match=r"end it in one of: \.png, \.svg, \.csv"):
        require_curve(tmp_path / "curve.txt")


def test_of_two_searches_the_cheaper_is_told_with_what_both_took(found: PlanResult) -> None:
    """Law: a history ends at the plan's own cost, after both searches' evaluations where the later one was cheaper."""
    look = Look(1.0, 1.0, None)
    cost = found.cost
    early = replace(found, history=((1, 0.1, 2.0 * cost), (5, 0.5, 1.5 * cost)), standby=found.standby + 1.0)
    failed = replace(found, status="infeasible", history=((2, 0.2, 0.5 * cost),))
    for first, second in ((early, found), (found, early), (found, failed)):
        both = Searched(look, first, None).or_cheaper(Searched(look, second, None)).result
        assert both.solved
        assert both.cost == pytest.approx(cost)
        assert both.evaluations == first.evaluations + second.evaluations
        assert both.history[-1][2] == pytest.approx(cost)
        counts = [row[0] for row in both.history]
        assert counts == sorted(counts)


def test_without_standby_the_longest_duration_costs_least() -> None:
    """Where viscous losses alone rank durations, least energy takes all the time that it may."""
    task = replace(problem(duration=1.0), longest=1.6)
    result = solve_free_duration(task, OPTIONS, QUICK)
    assert result.solved
    assert result.splines is not None
    assert float(result.splines.total[0]) == pytest.approx(1.6, rel=1e-6)


@pytest.mark.parametrize(
    ("lines", "objective", "words"),
    [
        ("at_most_s = 3\nduration_s = 2", "energy", "both duration_s and at_most_s"),
        ("at_most_s = 3", "time", "task.at_most_s says nothing of least time"),
        ("standby_W = 30", "time", "task.standby_W says nothing of least time"),
        ("standby_W = 30\nduration_s = 3", "energy", "standby_W says nothing where the duration is fixed"),
        ("", "energy", "or at_most_s or standby_W"),
        ("at_most_s = 0", "energy", "task.at_most_s is 0"),
    ],
)
def test_keys_of_a_free_duration(tmp_path: Path, lines: str, objective: str, words: str) -> None:
    """What says nothing together is refused by its key."""
    (tmp_path / "scene.toml").write_text(TASK + lines)
    with pytest.raises(InputError, match=words):
        open_task(tmp_path / "scene.toml", options=TaskOptions(objective))


def test_a_scene_frees_its_duration(tmp_path: Path) -> None:
    """By its longest duration, or by standby alone; a comparison of methods needs one duration."""
    (tmp_path / "scene.toml").write_text(TASK + "at_most_s = 3")
    task = open_task(tmp_path / "scene.toml")
    assert task.problem.longest == 3.0
    with pytest.raises(InputError, match="compared at one duration"):
        task.compare(CompareOptions())
    (tmp_path / "scene.toml").write_text(TASK + "standby_W = 30")
    assert open_task(tmp_path / "scene.toml").problem.longest == np.inf


@pytest.mark.parametrize("seconds", [0.3, 0.6, 1.0])
def test_seconds_that_end_within_a_search_leave_what_was_found(seconds: float) -> None:
    """Law: however early they end, there is an answer, a plan or a reason."""
    task = replace(problem(duration=1.0), longest=6.0, standby=STANDBY)
    short = solve_free_duration(task, replace(OPTIONS, seconds=seconds), QUICK)
    assert short.solved or short.reason
