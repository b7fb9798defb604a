"""Cycles: one duration shared by several motions, and a load that is carried only between grip and release."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from plan.api.cycles import cycle
from plan.command_options import SolveOptions
from plan.problem.cycle_result import Leg
from plan.problem.task_file import Task, load_task
from plan.solving.cycle import PACES, PLACES, share_duration, solve_cycle, split_cycle
from plan.solving.free_duration import Look
from tests.plan.worlds import on_wheels
from tests.schemas import check_record

SCENE = """robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [50, 0, -120]
{whole}
[payload]
mass_kg = 2.0
com_m = [0, 0, 0.05]
[[attached]]
name = "part"
size_m = [0.05, 0.05, 0.05]
xyz_m = [0, 0, 0.08]
touches = ["link_6"]
[[leg]]
deg = [80, 30, -90]
dwell_s = 0.3
does = "grip"
[[leg]]
deg = [20, 20, -100]
dwell_s = 0.2
does = "{deed}"
"""
# Evaluations of all motions together: too few to look at short ones, and enough for that.
QUICK, ENOUGH = SolveOptions(evaluations=300, gap=False), SolveOptions(evaluations=1000, gap=False)


def write(folder: Path, whole: str = "duration_s = 8.5", deed: str = "release") -> Task:
    """The task of a cycle with two stops."""
    path = folder / "cycle.toml"
    path.write_text(SCENE.format(whole=whole, deed=deed))
    return load_task(path)


def test_the_load_hangs_on_the_arm_between_grip_and_release_alone(tmp_path: Path) -> None:
    """Law: mass and shape are there after the grip, and gone after the release; ends follow one another."""
    problems = split_cycle(write(tmp_path), None, QUICK)
    carried = [{row["name"] for row in problem.carried} for problem in problems]
    assert carried == [set(), {"part", "payload"}, set()]
    for before, after in pairwise(problems):
        assert np.array_equal(before.goal, after.start)
    still = np.zeros((1, 1, 3))
    held = [problem.model.torque(problem.goal[None, None], still, still) for problem in problems[:2]]
    loaded = problems[1].model.torque(problems[0].goal[None, None], still, still)
    assert np.abs(loaded - held[0]).max() > 1.0


@pytest.mark.parametrize(("powers", "free"), [((1.0, 8.0), 3.0), ((2.0, 2.0), 4.0)])
def test_durations_are_shared_where_a_second_is_worth_the_same(powers: tuple[float, float], free: float) -> None:
    """Law: of energies a / T² the least sum has T in proportion to the cube root of a, and fills the time."""
    times = np.geomspace(0.5, 4.0, 30)
    curves = [[Look(float(t), power / float(t) ** 2, None) for t in times] for power in powers]
    task = Task(source=Path("x"), robot="x", start=np.zeros(1), goal=np.zeros(1), duration=free)
    shared = share_duration(curves, np.full(2, 0.5), free, task)
    wanted = free * np.cbrt(powers) / np.cbrt(powers).sum()
    assert shared.durations == pytest.approx(wanted, rel=0.02)
    assert shared.durations.sum() == pytest.approx(free)
    assert shared.energy <= shared.even + 1e-9


@pytest.mark.parametrize("free", [1.4, 3.0, 7.0, 12.0])
def test_what_is_shared_out_fills_the_cycle_and_costs_no_more(free: float) -> None:
    """Law: durations of a fixed cycle sum to it, shorter or longer than all that was looked at, too."""
    curves = []
    for power, first in ((1.0, 0.5), (6.0, 1.5)):
        times = np.geomspace(first, 4.0, 6)
        curves.append([Look(float(t), power / float(t) ** 2, None) for t in times])
    task = Task(source=Path("x"), robot="x", start=np.zeros(1), goal=np.zeros(1), duration=free)
    shared = share_duration(curves, np.array([0.4, 0.6]), free, task)
    assert shared.durations.sum() == pytest.approx(free)
    if shared.energy is None:
        assert free < 2.0
    else:
        assert shared.energy <= shared.even + 1e-9


def test_a_duration_that_was_looked_at_twice_counts_once() -> None:
    """Law: two energies of one duration, as of two searches, change nothing but that the lower one counts."""
    times = [0.5, 1.0, 1.0 + 1e-9, 2.0, 4.0]
    curve = [Look(t, 1.0 / t**2 + 0.1 * (k == 1), None) for k, t in enumerate(times)]
    task = Task(source=Path("x"), robot="x", start=np.zeros(1), goal=np.zeros(1), duration=2.4)
    shared = share_duration([curve, curve], np.full(2, 0.5), 2.4, task)
    assert shared.durations == pytest.approx(1.2, rel=0.02)
    assert shared.even == pytest.approx(2.0 / 1.2**2, rel=0.1)


def test_standby_shortens_a_cycle_that_may_be_shorter() -> None:
    """Law: with E = a / T² and power P for each second the best is T³ = 2 a / P, where the longest lets it be."""
    times = np.geomspace(0.5, 4.0, 60)
    curves = [[Look(float(t), 8.0 / float(t) ** 2, None) for t in times] for _ in range(2)]
    task = Task(source=Path("x"), robot="x", start=np.zeros(1), goal=np.zeros(1), longest=8.0, standby=4.0)
    shared = share_duration(curves, np.full(2, 0.5), 8.0, task)
    assert shared.durations == pytest.approx(np.cbrt(2.0 * 8.0 / 4.0), rel=0.02)


def test_a_cycle_takes_its_duration_and_stays_within_torque_at_every_pace(tmp_path: Path) -> None:
    """Law: motions and dwells fill the cycle, no limit is passed, and slowed down no joint needs more than it has."""
    task = write(tmp_path)
    problems = split_cycle(task, None, QUICK)
    found = solve_cycle(task, problems, ENOUGH)
    assert found.solved, found.reason
    assert found.duration == pytest.approx(8.5, abs=1e-6)
    assert found.dwelling == pytest.approx(0.5)
    assert found.shared <= found.even + 1e-9
    for leg, problem in zip(found.legs, problems, strict=True):
        q, dq, ddq = leg.plan.splines.states(PLACES)
        for pace in PACES:
            tau = problem.model.torque(q, pace * dq, pace**2 * ddq)
            assert np.all(np.abs(tau) <= problem.limits.torque * (1.0 + 1e-9))
        assert leg.plan.certificate.broken == []
    record = check_record(found.to_dict())
    assert record["cost_J"] == pytest.approx(sum(leg["energy_J"]["absolute"] for leg in record["legs"]))


def test_too_short_a_cycle_is_told_with_what_it_needs(tmp_path: Path) -> None:
    """Law: where the motions' shortest durations do not fit there is no plan, and the reason says what they take."""
    task = write(tmp_path, "duration_s = 0.9")
    found = solve_cycle(task, split_cycle(task, None, QUICK), QUICK)
    assert not found.solved
    assert "too short" in found.reason
    record = check_record(found.to_dict())
    assert record["cost_J"] is None
    assert record["robot"] == "tm5_900"
    assert record["joints"] == ["joint_1", "joint_2", "joint_3"]


@pytest.mark.parametrize("base", ["0.5, 20, ", ""])
def test_a_base_without_a_drive_is_held_through_a_cycle(tmp_path: Path, base: str) -> None:
    """Law: a cycle of an arm whose base has no drive is the arm's, told the base's place or not."""
    places = [f"[{base}10, {turn}, -60, 0, 30, 0]" for turn in (0, 20)]
    text = f"""robot = "{on_wheels(tmp_path)}"
[task]
start_deg = {places[0]}
goal_deg = {places[0]}
duration_s = 0.02
[[leg]]
deg = {places[1]}
"""
    path = tmp_path / "cycle.toml"
    path.write_text(text)
    found = cycle(path)
    assert "too short" in found.reason
    assert found.joints == tuple(f"joint_{number}" for number in range(1, 7))
    np.testing.assert_allclose(np.degrees(found.stops[0].q), [10, 20, -60, 0, 30, 0])


@pytest.mark.parametrize(
    ("whole", "deed", "words"),
    [
        ("via_points = 2", "release", "needs task.duration_s or at_most_s"),
        ("duration_s = 0.4", "release", "dwell_s take all"),
        ("duration_s = 8.5", "grip", "twice in a row"),
        ("duration_s = 8.5", "weld", "is 'weld'"),
    ],
)
def test_bad_cycles_are_refused_by_their_keys(tmp_path: Path, whole: str, deed: str, words: str) -> None:
    """Law: what a cycle lacks or says twice is named with its key."""
    with pytest.raises(InputError, match=words):
        split_cycle(write(tmp_path, whole, deed), None, QUICK)


def test_a_cycle_is_no_single_motion_and_a_motion_no_cycle(tmp_path: Path) -> None:
    """Law: each command refuses the other's file and names the other command."""
    from plan.api.planning import open_task

    task = write(tmp_path)
    with pytest.raises(InputError, match="plan cycle"):
        open_task(task)
    with pytest.raises(InputError, match="plan solve"):
        split_cycle(replace(task, stops=()), None, QUICK)


def test_sharing_out_anew_never_costs_more_and_keeps_the_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: what is shared out on the motions' own curves is taken only where the whole costs less.

    No motion gets more of the seconds than what is left, whatever those before it took.
    """
    from plan.solving import cycle as cycle_module

    task = write(tmp_path)
    problems = split_cycle(task, None, QUICK)
    given = []
    plan_all = cycle_module._plan_all

    def watched(*arguments: object) -> list[Leg]:
        given.append(arguments[1])
        return plan_all(*arguments)

    monkeypatch.setattr(cycle_module, "_plan_all", watched)
    anew = solve_cycle(task, problems, ENOUGH)
    rounds = len(given)
    monkeypatch.setattr(cycle_module, "_promises_more", lambda *_: False)
    once = solve_cycle(task, problems, ENOUGH)
    assert once.solved
    assert anew.energy <= once.energy * (1.0 + 1e-9)
    assert rounds >= 1
    spent = solve_cycle(task, problems, replace(ENOUGH, seconds=5.0), spent=5.0)
    assert sum(leg.plan.evaluations for leg in spent.legs) < sum(leg.plan.evaluations for leg in once.legs)
