"""How an arm stands at a cycle's stops: routes, poses that are reached, and the whole's cost."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.command_options import SolveOptions
from plan.problem.task_file import Task, load_task
from plan.solving.cycle import split_cycle
from plan.solving.cycle_legs import leg_tasks
from plan.solving.stop_choice import cheapest_routes, choose_stops

SCENE = """robot = "tm5-900"
[task]
start_deg = [0, 0, 90, 0, 90, 0]
goal_deg = [0, 0, 90, 0, 90, 0]
duration_s = 8.5
[payload]
mass_kg = 2.0
com_m = [0, 0, 0.05]
[[leg]]
does = "grip"
{first}
[[leg]]
deg = [-60, 20, 80, -10, 90, -40]
does = "release"
"""
GIVEN = [70.0, 10.0, 100.0, -20.0, 90.0, 30.0]
QUICK = SolveOptions(evaluations=60, seconds=20.0, gap=False, beyond=True)


def write(folder: Path, first: str) -> Task:
    """The task of a cycle whose first stop is as told."""
    path = folder / "cycle.toml"
    path.write_text(SCENE.format(first=first))
    return load_task(path)


def placed(q: np.ndarray) -> pin.SE3:
    """The last link's placement [rad]."""
    arm = ArmModel.load("tm5-900")
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, q)
    return data.oMf[arm.model.getFrameId(arm.links[-1])].copy()


def pose_keys(turn: float = 0.0) -> str:
    """The pose of the given angles, turned about its own z axis [rad]."""
    placement = placed(np.radians(GIVEN))
    rotation = placement.rotation @ pin.utils.rotate("z", turn)
    quaternion = pin.Quaternion(rotation).coeffs().tolist()
    return f"xyz_m = {placement.translation.tolist()}\nquaternion_xyzw = {quaternion}"


@pytest.mark.parametrize("sizes", [(1, 3, 4, 1), (1, 5, 1), (2, 3, 3, 2)])
@pytest.mark.parametrize("most", [1, 4])
def test_the_cheapest_routes_are_those_of_all(sizes: tuple[int, ...], most: int) -> None:
    """Law: routes by dynamic programming are the first of all routes, sorted by their sums."""
    rng = np.random.default_rng(len(sizes))
    costs = [rng.uniform(size=shape) for shape in pairwise(sizes)]

    def cost(route: tuple[int, ...]) -> float:
        return sum(table[step] for table, step in zip(costs, pairwise(route), strict=True))

    every = sorted(product(*(range(size) for size in sizes)), key=cost)
    assert cheapest_routes(costs, most) == every[:most]


def test_a_stop_of_angles_stays_as_it_is(tmp_path: Path) -> None:
    """Law: where every stop is given by its angles there is nothing to choose."""
    task = write(tmp_path, f"deg = {GIVEN}")
    assert choose_stops(task, None, QUICK) is task


def test_of_rows_the_cheapest_is_taken(tmp_path: Path) -> None:
    """Law: of angles and the same with a joint turned far off, the near ones are taken."""
    far = [GIVEN[0] - 250.0, *GIVEN[1:]]
    task = choose_stops(write(tmp_path, f"any_deg = [{far}, {GIVEN}]"), None, QUICK)
    np.testing.assert_allclose(np.degrees(task.stops[0].q), GIVEN)
    assert task.stops[0].is_chosen


def test_a_pose_is_reached_by_the_way_that_costs_least(tmp_path: Path) -> None:
    """Law: the frame stands at one of its poses, and nothing else of the cycle has changed."""
    poses = "\n".join(f"[[leg.pose]]\n{pose_keys(turn)}" for turn in (0.0, np.pi))
    task = write(tmp_path, poses)
    chosen = choose_stops(task, None, QUICK)
    wanted = placed(np.radians(GIVEN))
    here = placed(chosen.stops[0].q)
    turned = pin.log3(wanted.rotation.T @ here.rotation)
    np.testing.assert_allclose(here.translation, wanted.translation, atol=1e-6)
    np.testing.assert_allclose(turned[:2], 0.0, atol=1e-5)
    assert min(abs(turned[2]), abs(abs(turned[2]) - np.pi)) < 1e-5
    assert chosen.stops[1] is not task.stops[1]
    np.testing.assert_array_equal(chosen.stops[1].q, task.stops[1].q)
    assert [stop.does for stop in chosen.stops] == ["grip", "release"]
    problems = split_cycle(chosen, None, QUICK)
    np.testing.assert_array_equal(problems[0].goal, problems[1].start)


def test_more_poses_never_cost_more_by_straight_motions(tmp_path: Path) -> None:
    """Law: among a pose's ways is the one given by hand, so the cheapest route costs no more."""
    from plan.solving import stop_choice
    from plan.solving.set_up import set_up

    task = write(tmp_path, f"[leg.pose]\n{pose_keys()}")
    by_hand = write(tmp_path, f"deg = {GIVEN}")
    problems = [set_up(leg, None, QUICK) for leg in leg_tasks(task, "energy")]
    ways = stop_choice._allowed_positions(task, task.stops[0], 1, problems[:2])
    assert any(np.allclose(np.degrees(way), GIVEN, atol=1e-3) for way in ways)
    last = [by_hand.stops[1].q]
    sums = []
    for layer in (ways, [by_hand.stops[0].q]):
        layers = [[task.start], layer, last, [task.goal]]
        ends = zip(problems, pairwise(layers), strict=True)
        costs = [stop_choice._straight_costs(problem, *pair, 2.5) for problem, pair in ends]
        (route,) = cheapest_routes(costs, 1)
        steps = zip(costs, pairwise(route), strict=True)
        sums.append(sum(table[step] for table, step in steps))
    assert sums[0] <= sums[1] * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ("", "leg 1 has neither deg nor any_deg nor pose"),
        ("pose = { xyz_m = [5, 0, 0] }", "leg 1.pose: the 6 joints that move can't bring"),
        ("pose = { xyz = [5, 0, 0] }", "leg 1.pose: unknown key 'xyz'"),
        ("any_deg = [[0, 0, 900, 0, 0, 0]]", "leg 1: none of its 1 positions is allowed"),
        (f"deg = {GIVEN}\nany_deg = [{GIVEN}]", "leg 1 has both deg and any_deg"),
    ],
)
def test_bad_stops_are_refused_by_their_keys(tmp_path: Path, first: str, words: str) -> None:
    """Law: a stop without a place, or none that is allowed, is named with its key."""
    with pytest.raises(InputError, match=words):
        choose_stops(write(tmp_path, first), None, QUICK)


def test_the_shortest_cycle_takes_the_nearest_rows(tmp_path: Path) -> None:
    """Law: with time as the objective what counts is how long the joints' ways take."""
    far = [GIVEN[0] - 250.0, *GIVEN[1:]]
    task = replace(write(tmp_path, f"any_deg = [{far}, {GIVEN}]"), duration=None)
    chosen = choose_stops(task, None, replace(QUICK, objective="time"))
    np.testing.assert_allclose(np.degrees(chosen.stops[0].q), GIVEN)
