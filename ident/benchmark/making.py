"""First step of a case: draw, simulate, write the recordings, seal the answer elsewhere."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

from ident.benchmark.cases import Slot, draw_case, draw_world_of
from ident.benchmark.oracle import oracle_accuracy
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
    """What the simulating process is told."""

    slot: Slot  # the case's place
    number: int  # and its number
    seed: int  # of the check
    base: SimulationOptions  # what all cases have in common
    session: Path  # folder for the recordings
    sealed: Path  # folder for the envelope
    stamp: str  # of the simulating code
    worlds: tuple[WorldRange, ...] = ()  # where the case's world is drawn from; empty for the plant's own
    oracle: bool = True  # whether the bound of single effects is worked out

    @property
    def key(self) -> bytes:
        """Key of the case's envelope: follows from the check's seed, which the diagnosing processes never get."""
        return hashlib.sha256(f"{self.seed} {self.slot.name} ident.blind/1".encode()).digest()

    def drawn(self, attempt: int) -> tuple[SimulationOptions, tuple[str, ...]]:
        """The case as drawn at an attempt: what is simulated, and the ids that are taken out of the catalogue."""
        world = draw_world_of(self.number, self.seed, self.worlds)
        base = self.base if world is None else self.base.in_world(world)
        joints = ArmModel.load(base.robot).joint_names
        return draw_case(self.slot, self.number, self.seed, base, joints, attempt)


def make(task: MakeTask) -> str:
    """Makes a case and seals its answer; returns its name. Draws again where a size is impossible."""
    start, used, name = time.perf_counter(), time.process_time(), task.slot.name
    for attempt in range(MOST_ATTEMPTS):
        try:
            options, excluded = task.drawn(attempt)
            made = simulate(options, name)
            accuracy = oracle_accuracy(made) if task.oracle and task.slot.kind == "single" else None
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    write_session(made.session, task.session)
    with atomic_folder(task.sealed, "envelope") as folder:
        record = {
            "sha256": seal(made.answer, folder, task.key),
            "attempt": attempt,
            "excluded": list(excluded),
            "robot": options.robot,
            "starts": [float(run.time[0]) for run in made.session.runs],
            "oracle": accuracy,
            "seconds": time.perf_counter() - start,
            "processor_seconds": time.process_time() - used,
            "stamp": task.stamp,
        }
        with atomic_write(folder / MADE_NAME) as part:
            part.write_text(json.dumps(record) + "\n", encoding="utf-8")
    return name
