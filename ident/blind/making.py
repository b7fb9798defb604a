"""First step of a case: draw, simulate, write the recordings, seal the answer elsewhere."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.arm import ArmModel
from ident.blind.cases import Case, Slot, draw_case
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write
from ident.plant.answer import seal
from ident.plant.session import SimulationOptions, simulate
from ident.writing import write_session

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
    """

    slot: Slot
    number: int
    seed: int
    base: SimulationOptions
    session: Path
    sealed: Path
    stamp: str


def case_key(seed: int, name: str) -> bytes:
    """Key of a case's envelope: follows from the check's seed, which the diagnosing processes never get."""
    return hashlib.sha256(f"{seed} {name} ident.blind/1".encode()).digest()


def make(task: MakeTask) -> str:
    """Simulates a case and seals its answer; returns its name. Draws again where a size is impossible."""
    start = time.perf_counter()
    joints = ArmModel.load(task.base.robot).joint_names
    for attempt in range(MOST_ATTEMPTS):
        case = draw_case(task.slot, task.number, task.seed, task.base, joints, attempt)
        try:
            simulation = simulate(case.options, task.slot.name)
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    with atomic_folder(task.session) as folder:
        write_session(simulation.session, folder)
    with atomic_folder(task.sealed) as folder:
        digest = seal(simulation.answer, folder, case_key(task.seed, task.slot.name))
        record = {
            "sha256": digest,
            "attempt": attempt,
            "excluded": list(case.excluded),
            "starts": [float(run.time[0]) for run in simulation.session.runs],
            "seconds": time.perf_counter() - start,
            "stamp": task.stamp,
        }
        _write(folder / MADE_NAME, record)
    return task.slot.name


def _write(path: Path, record: dict[str, Any]) -> None:
    with atomic_write(path) as part:
        part.write_text(json.dumps(record) + "\n", encoding="utf-8")


def redraw(task: MakeTask, attempt: int) -> Case:
    """The case as it was drawn in the end: for the scoring, after the seals are open."""
    joints = ArmModel.load(task.base.robot).joint_names
    return draw_case(task.slot, task.number, task.seed, task.base, joints, attempt)
