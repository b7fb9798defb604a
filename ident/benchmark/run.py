"""The check as a whole: make all cases, print their seals, diagnose, open, score. Goes on where it was stopped."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from ident.benchmark.cases import FULL_MIX, MADE_NAME, MakeTask, make, plan_slots
from ident.benchmark.editing import EditTask, edit
from ident.benchmark.examining import ExamineTask, examine
from ident.benchmark.pages import write_blind_pages
from ident.benchmark.scoring import score_case
from ident.benchmark.summary import BlindReport
from ident.errors import InputError
from ident.files import atomic_write
from ident.options import CheckOptions
from ident.provenance import Provenance
from ident.safe_read import read_json
from ident.simulation.answer import open_envelope
from ident.simulation.simulate import SimulationOptions
from ident.simulation.world import find_worlds
from ident.workers import run_tasks

Say = Callable[[str], None]
Progress = Callable[[str, int, int], None]
T = TypeVar("T", MakeTask, ExamineTask, EditTask)


@dataclass(frozen=True)
class BlindOptions(CheckOptions):
    """What to check, with what Python alone can choose."""

    mix: Mapping[str, float] = field(default_factory=lambda: dict(FULL_MIX))  # shares of the kinds of case
    runs: int = 10  # of each session; of a world, its own
    duration: float = 8.0  # rough duration of a run [s]; of a world, its own

    @property
    def settings(self) -> dict[str, Any]:
        """What decides which cases there are."""
        names = ("cases", "mix", "robot", "runs", "duration", *(("worlds", "oracle") if self.worlds else ()))
        return {name: dict(value) if isinstance(value := getattr(self, name), Mapping) else value for name in names}


def run_blind(
    options: BlindOptions, say: Say = lambda line: None, progress: Progress = lambda step, done, total: None
) -> BlindReport:
    """Runs the check.

    Args:
        options: What to check.
        say: Told the seals, line by line, before any diagnosis.
        progress: Told what is being done, how many cases are done, and of how many.

    Raises:
        InputError: Options that make no sense, or another check in the folder.
    """
    seed, out, stamp = begin_check(options, options.settings), options.out.resolve(), code_stamp()
    base = SimulationOptions(robot=options.robot, runs=options.runs, duration=options.duration, coarse=True)
    worlds = find_worlds(options.worlds) if options.worlds else ()
    tasks = {}
    for number, slot in enumerate(plan_slots(options.cases, options.mix, seed)):
        folders = out / "sessions" / slot.name, out / "sealed" / slot.name
        tasks[slot.name] = MakeTask(slot, number, seed, base, *folders, stamp, worlds, options.oracle)
    step = partial(_step, options, progress)
    made = step("simulating", make, {name: (task.sealed / MADE_NAME, task) for name, task in tasks.items()})
    for name, record in made.items():
        say(f"{name} sealed: sha256 {record['sha256']}")
    diagnoses, edits = {}, {}
    for name, task in tasks.items():
        # Those of an earlier version, or of another seal, are had anew.
        record, stamped = made[name], f"{stamp} {made[name]['sha256']}"
        path, edited = (out / folder / f"{name}.json" for folder in ("results", "edits"))
        excluded = tuple(record["excluded"])
        diagnoses[name] = path, ExamineTask(task.session, record["robot"], excluded, path, stamped)
        if options.edit and task.slot.kind == "single":
            edits[name] = edited, EditTask(task, int(record["attempt"]), path, edited, stamped)
    results = step("diagnosing", examine, diagnoses)
    ratios = step("editing", edit, edits)
    outcomes = []
    for name, task in tasks.items():
        answer = open_envelope(task.sealed, task.key)
        outcome = score_case(task.slot, answer, results[name], made[name]["starts"])
        ratio = ratios.get(name, {}).get("ratio")
        outcomes.append(replace(outcome, oracle=made[name].get("oracle"), edit=ratio))
    report = BlindReport(
        robot=f"arms of worlds ({options.worlds})" if options.worlds else options.robot,
        seed=seed,
        seals={name: record["sha256"] for name, record in made.items()},
        outcomes=tuple(outcomes),
        provenance=Provenance("ident blind", settings={**options.settings, "seed": seed}),
        run={**options.settings, "code": stamp},
    )
    report.save(options.out / "blind.json")
    with atomic_write(options.out / "cases.parquet") as part:
        pq.write_table(pa.Table.from_pylist([one.to_row() for one in outcomes]), part)
    write_blind_pages(report, {name: result.get("diagnosis") for name, result in results.items()}, options.out)
    return report


def begin_check(options: BlindOptions, settings: Mapping[str, Any]) -> int:
    """Checks the options, and that the folder holds no other check than one with these settings; returns the seed."""
    if options.cases < 1:
        raise InputError("--cases", f"{options.cases} cases", "ask for one or more")
    if options.workers < 1:
        raise InputError("--workers", f"{options.workers} processes", "give one or more")
    if options.seed is not None and not 0 <= options.seed < 2**62:
        raise InputError("--seed", f"{options.seed}", "choose a number from 0 to 2^62")
    if options.worlds:
        find_worlds(options.worlds)
    path = options.out / "run.json"
    if path.is_file():
        try:
            before = _read(path)
            seed = int(before.pop("seed"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(path, f"no record of a check ({error!r})", "choose another --out") from None
        if before != settings or options.seed not in (None, seed):
            raise InputError(path, "another check was begun in this folder", "choose another --out, or its options")
        return seed
    if options.out.is_dir() and any(options.out.iterdir()):
        raise InputError(options.out, "the folder holds something else", "choose another --out")
    seed = secrets.randbits(48) if options.seed is None else options.seed
    with atomic_write(path) as part:
        part.write_text(json.dumps({**settings, "seed": seed}, indent=1) + "\n", encoding="utf-8")
    return seed


def _step(
    options: BlindOptions,
    progress: Progress,
    name: str,
    function: Callable[[T], str],
    tasks: Mapping[str, tuple[Path, T]],
) -> dict[str, dict[str, Any]]:
    """What a step wrote of each case; what is there already is not done again."""
    waiting = [task for path, task in tasks.values() if not _is_done(path, task.stamp)]
    finished: set[str] = set()

    def count(case: str) -> None:
        finished.add(case)
        progress(name, len(tasks) - len(waiting) + len(finished), len(tasks))

    run_tasks(function, waiting, options.workers, options.scheduler, count)
    return {case: _read(path) for case, (path, _) in tasks.items()}


@cache
def code_stamp() -> str:
    """Short hash of this package's source: a result of an earlier version is had anew."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _is_done(path: Path, stamp: str) -> bool:
    """Whether a file of this version is there. A diagnosis that failed is tried again."""
    if not path.is_file():
        return False
    record = _read(path)
    return record.get("stamp") == stamp and "error" not in record


def _read(path: Path) -> dict[str, Any]:
    return read_json(path, "remove it, or choose another --out")
