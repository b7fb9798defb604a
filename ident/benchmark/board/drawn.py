"""First tier: arms and sensors that are drawn, as the check on withheld effects draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.benchmark.board.case import DRAWN, BoardCase
from ident.benchmark.cases import (
    MOST_ATTEMPTS,
    OTHER_EFFECTS_FROM,
    draw_case,
    draw_world_of,
    oracle_accuracy,
)
from ident.benchmark.corpus_worlds import WorldCase, answer_of, plan_world_cases
from ident.benchmark.run import other_motions
from ident.benchmark.truth import WRONG_COM_M, WRONG_LINK_ERROR
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.simulation.hardware import without_geometry
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.simulation.world import World

# Sessions have each kind of motion once and are not logged faster than this, so that a board can be
# sent by mail.
MOST_RUNS = 7
FASTEST_HZ = 75.0
# Visible amplitude of a cause that would not show otherwise [noise floors].
SHOWS = 3.0
RICH_SHARE = 0.75  # of the sessions, whatever is wrong in them
UNSEEN_S = 8.0  # rough duration of the motion that is to be foretold [s]


def plan_drawn(cases: int, seed: int, worlds: str) -> list[WorldCase]:
    """The places of a tier of drawn worlds: what shows too little to be named is made larger, and
    how rich the motion is hangs on nothing that is wrong.
    """
    tasks = plan_world_cases(Path(), cases, seed, worlds)
    rich = np.random.default_rng([seed, 21]).random(len(tasks)) < RICH_SHARE
    planned: list[WorldCase] = []
    for task, is_rich in zip(tasks, rich, strict=True):
        amplitude = max(task.slot.amplitude, 1.0)
        if task.slot.amplitude < 1.0:
            amplitude = SHOWS
        slot = replace(task.slot, rich=bool(is_rich), amplitude=amplitude)
        planned.append(replace(task, slot=slot))
    return planned


def make_drawn(task: WorldCase, oracle: bool) -> BoardCase:
    """Simulates a session and another motion of the same arm without its causes.

    Raises:
        InputError: In no draw the effect could show as much as it should.
    """
    simulation = _simulated(task)
    options = simulation.options
    answer = answer_of(task, simulation)
    unseen = simulate(other_motions(options, 1, UNSEEN_S), "unseen").session.runs[0]
    accuracy = None
    if oracle and answer["kind"] == "single":
        accuracy = oracle_accuracy(simulation)
    return BoardCase(
        tier=DRAWN,
        kind=str(answer["kind"]),
        arm=options.robot,
        urdf=without_geometry(ArmModel.load(options.robot).urdf),
        runs=simulation.session.runs,
        effects=tuple(answer["effects"]),
        unseen=unseen,
        oracle=accuracy,
    )


def _simulated(task: WorldCase) -> Simulation:
    for attempt in range(MOST_ATTEMPTS):
        try:
            return simulate(_options(task, attempt), task.slot.name)
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    raise AssertionError("the last attempt either returns or raises")


def _options(task: WorldCase, attempt: int) -> SimulationOptions:
    again = max(attempt - OTHER_EFFECTS_FROM + 1, 0)
    world = draw_world_of(task.number, task.seed, task.worlds, again)
    assert world is not None
    world = believable(_smaller(world))
    base = SimulationOptions(robot=world.robot, coarse=True).in_world(world)
    joints: Sequence[str] = ArmModel.load(base.robot).joint_names
    options, _ = draw_case(task.slot, task.number, task.seed, base, joints, attempt)
    return replace(options, commands=False)


def _smaller(world: World) -> World:
    runs = min(world.runs, MOST_RUNS)
    duration = world.duration_s * runs / world.runs
    return replace(world, rate_hz=min(world.rate_hz, FASTEST_HZ), runs=runs, duration_s=duration)


def believable(world: World) -> World:
    """A world whose URDF is imprecise, not wrong: else "none" would be true of no session of it."""
    return replace(
        world,
        link_error=min(world.link_error, WRONG_LINK_ERROR),
        com_error_m=min(world.com_error_m, WRONG_COM_M),
        copied_link=False,
    )
