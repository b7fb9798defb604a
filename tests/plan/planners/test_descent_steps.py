"""What each step of a descent rests on: programmes that promise something, and the nearest places in view."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plan.api.planning import open_task
from plan.command_options import TaskOptions
from plan.geometry.solids import Box
from plan.initial.line_pace import timed_line
from plan.planners.courses import SAME, begin_course, different, nodes_of
from plan.planners.descent import Course
from plan.planners.near_pairs import CLEARANCE_UNIT, EXTRA, NEAR, clearance_rows
from plan.planners.refinement import count_finer, refine
from plan.planners.subproblem import ConstraintRows, solve_step
from tests.plan.worlds import problem, random_rotation


@pytest.mark.parametrize("seed", range(20))
def test_a_step_promises_no_less_than_standing_still(seed: int) -> None:
    """Law: to take no step promises nothing, so the best one promises that or more, however badly scaled."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(5, 60))
    root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-3.0, 1.0, size)
    hessian = root.T @ root + 1e-6 * np.eye(size)
    groups = []
    for _ in range(3):
        count = int(rng.integers(1, 40))
        matrix = rng.normal(size=(count, size))
        groups.append(ConstraintRows(matrix, rng.uniform(-1e-4, 0.2, count)))
    span = np.full(size, 10.0 ** rng.uniform(-5.0, 0.0))
    found = solve_step(rng.normal(size=size), hessian, groups, np.array([4.0, 20.0, 20.0]), (-span, span))
    assert found is not None
    step, promised = found
    assert promised >= -1e-9
    assert np.all(np.abs(step) <= span)


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_place_of_a_motion_is_watched(seed: int) -> None:
    """Law: no gap of a motion falls more than a twentieth of a millimetre below the least that is watched."""
    rng = np.random.default_rng(seed)
    place = np.array([0.04, -0.47, 0.56]) + rng.uniform(-0.05, 0.05, 3)
    box = Box("box", 0, random_rotation(rng), place, rng.uniform(0.03, 0.06, 3))
    course = begin_course(problem(box, duration=1.0))
    local = course.local
    coefficients = local.split(course.x)[0]
    dense = local.grid.positions(coefficients, np.linspace(0.0, 1.0, 8001))
    least = float((local.problem.scene.gaps(dense, NEAR) - local.problem.margins).min())
    room = float(clearance_rows(local, course.x).room.min())
    watched = room * CLEARANCE_UNIT + (EXTRA if room > 0.0 else 0.5 * EXTRA)
    assert watched <= least + 5e-5


def test_of_courses_at_one_place_the_better_goes_on() -> None:
    """Law: what lies nearer than the bound to a better one is left out, what lies farther is not."""
    task = problem()
    course = begin_course(task)
    twin = begin_course(replace(task, vias=task.vias + 0.5 * SAME))
    other = begin_course(replace(task, vias=task.vias + 4.0 * SAME))
    assert different([course, twin, other], 3) == [course, other]
    assert different([course, other], 1) == [course]
    assert different([course, on_finer_grid(course)], 2) == [course]


def on_finer_grid(course: Course) -> Course:
    return refine(course, 0.01, 0.5, nodes_of(course.local.timed, count_finer(course.local)))


def test_along_a_given_way_another_grid_is_another_course() -> None:
    """Law: a tool's line leaves one way; which grid holds the quickest time law is seen on finer ones alone."""
    scene = Path(__file__).parents[3] / "examples/scenes/straight_4.toml"
    task = open_task(scene, options=TaskOptions("time")).problem
    assert task.rules is not None
    course = begin_course(timed_line(task, task.rules))
    finer = on_finer_grid(course)
    assert different([course, finer], 2) == [course, finer]
    assert different([course, course], 2) == [course]
