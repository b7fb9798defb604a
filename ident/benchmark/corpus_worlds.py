"""Sessions of drawn worlds with open answers: cases of the withheld-effect check, unsealed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.benchmark.cases import (
    MOST_ATTEMPTS,
    OTHER_EFFECTS_FROM,
    Slot,
    draw_case,
    draw_world_of,
    plan_slots,
)
from ident.benchmark.truth import EXCUSED_BY_URDF, KNOWN, comparable, shown_joints, urdf_is_wrong
from ident.errors import InputError
from ident.files import atomic_folder, write_record
from ident.recordings.save import fill_session
from ident.records import JsonRecord
from ident.robot.arm import ArmModel
from ident.simulation.hardware import without_geometry
from ident.simulation.request import Answer, TrueEffect
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.simulation.world import World, WorldRange, find_worlds

MIX = {"single": 70.0, "healthy": 26.0, "decoy": 6.0, "pair": 9.0, "outside": 9.0}
"""Kinds of case and their shares."""
# Rows of a session are limited, so that a corpus of hundreds can be diagnosed in an hour; every so
# many is left whole.
MOST_ROWS = 15_000
WHOLE_EVERY = 12
FEWEST_RUNS = 4  # below which rows are saved by shorter runs
SHORTEST_S = 20.0  # of all runs together


@dataclass(frozen=True)
class WorldCase:
    """What the simulating process is given."""

    slot: Slot  # the case's place
    number: int  # and its number
    seed: int  # of the corpus
    worlds: tuple[WorldRange, ...]  # which its world is drawn from
    out: Path  # folder of `cases` and `answers`


def plan_world_cases(
    out: Path, cases: int, seed: int, worlds: str = "all", mix: Mapping[str, float] = MIX
) -> list[WorldCase]:
    """The cases of a corpus of drawn worlds, their kinds mixed: a part of them is of all kinds.

    Args:
        out: Folder of `cases` and `answers`.
        cases: How many.
        seed: Of what is drawn.
        worlds: Names of the worlds, or `all`.
        mix: Kinds of case and their shares.
    """
    slots = plan_slots(cases, mix, seed)
    order = np.random.default_rng([seed, 9]).permutation(len(slots))
    ranges = find_worlds(worlds)
    return [
        WorldCase(replace(slots[int(place)], name=f"world_{number:03d}"), number, seed, ranges, out)
        for number, place in enumerate(order)
    ]


def make_world_cases(
    tasks: Sequence[WorldCase], say: Callable[[str], None] = lambda line: None
) -> None:
    """Simulates all cases that are not there yet."""
    for task in tasks:
        if not (task.out / "answers" / f"{task.slot.name}.json").is_file():
            say(make_world_case(task))


def make_world_case(task: WorldCase) -> str:
    """Simulates a case and writes session, URDF and answer; returns a line that says what it is.

    Raises:
        InputError: In no draw the effect could show as much as it should.
    """
    for attempt in range(MOST_ATTEMPTS):
        options = _drawn(task, attempt)
        try:
            simulation = simulate(options, task.slot.name)
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    urdf = without_geometry(ArmModel.load(options.robot).urdf)
    with atomic_folder(task.out / "cases" / task.slot.name, "session") as folder:
        fill_session(simulation.session.replace(robot="robot.urdf"), folder)
        (folder / "robot.urdf").write_text(urdf, encoding="utf-8")
    answer = answer_of(task, simulation)
    write_record(task.out / "answers" / f"{task.slot.name}.json", answer)
    truth = ", ".join(
        f"{effect['effect']}:{'+'.join(effect['joints'])}" for effect in answer["effects"]
    )
    return f"{task.slot.name} {answer['arm']} {answer['world']} {answer['kind']} {truth}"


def _drawn(task: WorldCase, attempt: int) -> SimulationOptions:
    again = max(attempt - OTHER_EFFECTS_FROM + 1, 0)
    world = draw_world_of(task.number, task.seed, task.worlds, again)
    assert world is not None
    if task.number % WHOLE_EVERY:
        world = shortened(world)
    base = SimulationOptions(robot=world.robot, coarse=True).in_world(world)
    joints = ArmModel.load(base.robot).joint_names
    options, _ = draw_case(task.slot, task.number, task.seed, base, joints, attempt)
    return options


def shortened(world: World) -> World:
    """A world whose sessions have fewer rows: fewer runs, then shorter ones."""
    rows = world.rate_hz * world.duration_s
    if rows <= MOST_ROWS:
        return world
    runs = min(max(int(world.runs * MOST_ROWS / rows), FEWEST_RUNS), world.runs)
    duration = min(world.duration_s * runs / world.runs, MOST_ROWS / world.rate_hz)
    return replace(world, runs=runs, duration_s=max(duration, SHORTEST_S))


def answer_of(task: WorldCase, simulation: Simulation) -> JsonRecord:
    """What was wrong, in the form of a semi-real case's answer."""
    answer = simulation.answer
    world = simulation.options.world
    assert world is not None
    starts = [float(run.time[0]) for run in simulation.session.runs]
    asked = task.slot.amplitude if task.slot.kind == "single" else None
    return {
        "schema": "ident.semi_real/1",
        "kind": {"decoy": "healthy"}.get(task.slot.kind, task.slot.kind),
        "arm": world.robot,
        "world": world.name,
        "source": world.name,
        "effects": [truth_of(effect, answer, starts, asked) for effect in answer.effects],
        "noise_Nm": answer.noise_floor_Nm,
        "decoys": list(answer.decoys),
        "rich": task.slot.rich,
        "excused": list(EXCUSED_BY_URDF) if urdf_is_wrong(answer.world) else [],
        "figures": answer.world,
        "losses": answer.losses,
    }


def truth_of(
    effect: TrueEffect, answer: Answer, starts: Sequence[float], asked: float | None
) -> JsonRecord:
    """One simulated effect: where it may be named, and its parameters by the catalogue."""
    shown = shown_joints(effect, answer)
    floors = answer.noise_floor_Nm
    visible = {
        joint: round(value / max(floors[joint], 1e-12), 3)
        for joint, value in effect.visible_Nm.items()
    }
    known = KNOWN.get(effect.effect)
    whole = known is not None and known.scope == "arm"
    joints = list(effect.joints)
    partner = effect.parameters.get(known.partner) if known is not None and known.partner else None
    places = (
        {*shown, *joints}
        if whole or not joints
        else {*joints, *([str(partner)] if partner else [])}
    )
    return {
        "effect": effect.effect,
        "in_catalogue": effect.in_catalogue,
        "joints": shown if whole or not joints else joints,
        "may_stand_at": sorted(places),
        "parameters": comparable(effect, starts),
        "size": effect.size,
        "asked": max(visible.values(), default=0.0) if asked is None else asked,
        "visible": visible,
    }
