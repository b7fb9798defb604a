"""First step of a case: draw, simulate, write the recordings, seal the answer elsewhere."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.benchmark.cases import Case, Slot, draw_case, draw_world_of
from ident.benchmark.oracle import bound_of
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write
from ident.recordings.recording import Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.simulation.answer import Answer, seal
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.world import WorldRange

MOST_ATTEMPTS = 12
MADE_NAME = "made.json"


@dataclass(frozen=True)
class MakeTask:
    """What the simulating process is told.

    Attributes:
        slot, number: The case's place.
        seed: Of the check.
        base: What all cases have in common.
        session: Folder for the recordings.
        sealed: Folder for the envelope.
        stamp: Of the simulating code.
        worlds: Where the case's world is drawn from; empty for the plant's own.
        oracle: Whether the bound of single effects is worked out.
    """

    slot: Slot
    number: int
    seed: int
    base: SimulationOptions
    session: Path
    sealed: Path
    stamp: str
    worlds: tuple[WorldRange, ...] = ()
    oracle: bool = True


def case_key(seed: int, name: str) -> bytes:
    """Key of a case's envelope: follows from the check's seed, which the diagnosing processes never get."""
    return hashlib.sha256(f"{seed} {name} ident.blind/1".encode()).digest()


@dataclass(frozen=True, eq=False)
class Made:
    """A case as it came out: what is recorded, what is true, and what the diagnosis may know."""

    session: Session
    answer: Answer
    robot: str
    oracle: float | None = None


def make(task: MakeTask) -> str:
    """Makes a case and seals its answer; returns its name. Draws again where a size is impossible."""
    start, used = time.perf_counter(), time.process_time()
    for attempt in range(MOST_ATTEMPTS):
        try:
            made, excluded = _simulate(task, attempt)
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    write_session(made.session, task.session)
    with atomic_folder(task.sealed, "envelope") as folder:
        digest = seal(made.answer, folder, case_key(task.seed, task.slot.name))
        record = {
            "sha256": digest,
            "attempt": attempt,
            "excluded": list(excluded),
            "robot": made.robot,
            "starts": [float(run.time[0]) for run in made.session.runs],
            "oracle": made.oracle,
            "seconds": time.perf_counter() - start,
            "processor_seconds": time.process_time() - used,
            "stamp": task.stamp,
        }
        _write(folder / MADE_NAME, record)
    return task.slot.name


def case_of(task: MakeTask, attempt: int) -> Case:
    """A simulated case as drawn, at an attempt."""
    world = draw_world_of(task.number, task.seed, task.worlds)
    base = task.base if world is None else task.base.in_world(world)
    joints = ArmModel.load(base.robot).joint_names
    return draw_case(task.slot, task.number, task.seed, base, joints, attempt)


def _simulate(task: MakeTask, attempt: int) -> tuple[Made, tuple[str, ...]]:
    case = case_of(task, attempt)
    simulation = simulate(case.options, task.slot.name)
    bound = None
    if task.oracle and task.slot.kind == "single":
        bound = bound_of(simulation)
    return Made(
        simulation.session, simulation.answer, case.options.robot, oracle=bound.accuracy if bound else None
    ), case.excluded


def _write(path: Path, record: dict[str, Any]) -> None:
    with atomic_write(path) as part:
        part.write_text(json.dumps(record) + "\n", encoding="utf-8")
