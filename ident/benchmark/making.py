"""First step of a case: draw, simulate, write the recordings, seal the answer elsewhere."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

from ident.benchmark.cases import Case, Slot, draw_case, draw_world_of
from ident.benchmark.oracle import bound_of
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.simulation.answer import seal
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


def make(task: MakeTask) -> str:
    """Makes a case and seals its answer; returns its name. Draws again where a size is impossible."""
    start, used, name = time.perf_counter(), time.process_time(), task.slot.name
    for attempt in range(MOST_ATTEMPTS):
        try:
            case = case_of(task, attempt)
            made = simulate(case.options, name)
            bound = bound_of(made) if task.oracle and task.slot.kind == "single" else None
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    write_session(made.session, task.session)
    with atomic_folder(task.sealed, "envelope") as folder:
        record = {
            "sha256": seal(made.answer, folder, case_key(task.seed, name)),
            "attempt": attempt,
            "excluded": list(case.excluded),
            "robot": case.options.robot,
            "starts": [float(run.time[0]) for run in made.session.runs],
            "oracle": bound.accuracy if bound else None,
            "seconds": time.perf_counter() - start,
            "processor_seconds": time.process_time() - used,
            "stamp": task.stamp,
        }
        with atomic_write(folder / MADE_NAME) as part:
            part.write_text(json.dumps(record) + "\n", encoding="utf-8")
    return name


def case_of(task: MakeTask, attempt: int) -> Case:
    """A simulated case as drawn, at an attempt."""
    world = draw_world_of(task.number, task.seed, task.worlds)
    base = task.base if world is None else task.base.in_world(world)
    joints = ArmModel.load(base.robot).joint_names
    return draw_case(task.slot, task.number, task.seed, base, joints, attempt)
