"""The check as a whole: make all cases, print their seals, diagnose, open, score. Goes on where it was stopped."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from ident.benchmark.cases import FULL_MIX, plan_slots
from ident.benchmark.editing import EditTask, edit
from ident.benchmark.examining import ExamineTask, examine
from ident.benchmark.making import MADE_NAME, MakeTask, case_key, make
from ident.benchmark.pages import write_blind_pages
from ident.benchmark.scoring import Outcome, score_case
from ident.benchmark.summary import BlindReport
from ident.errors import InputError
from ident.files import atomic_write
from ident.provenance import Provenance
from ident.safe_read import read_json
from ident.simulation.answer import open_envelope
from ident.simulation.simulate import SimulationOptions
from ident.simulation.world import find_worlds
from ident.workers import run_tasks

RUN_NAME, REPORT_NAME, ROWS_NAME = "run.json", "blind.json", "cases.parquet"
Say = Callable[[str], None]
Progress = Callable[[str, int, int], None]
T = TypeVar("T", MakeTask, ExamineTask, EditTask)


@dataclass(frozen=True)
class BlindOptions:
    """What to check.

    Attributes:
        cases: Number of cases.
        seed: Of the check; drawn from the system's entropy if None.
        out: Folder for everything; a check that was stopped there goes on.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler instead; its workers must see `out` by the same path.
        mix: Shares of the kinds of case.
        robot: URDF path or name.
        runs, duration: Number of runs of each session, and their rough duration [s]; of a world, its own.
        oracle: Whether the most that anybody can name is worked out, for single effects in worlds.
        worlds: Names of the worlds that cases are drawn from (`find_worlds`); empty for the plant's own.
        edit: Whether simulated single effects are put to the edit test; a check that is done already may go on with it.
    """

    cases: int = 40
    seed: int | None = None
    out: Path = Path("out/blind")
    workers: int = 1
    scheduler: str | None = None
    mix: Mapping[str, float] = field(default_factory=lambda: dict(FULL_MIX))
    robot: str = "tm5-900"
    runs: int = 10
    duration: float = 8.0
    worlds: str = ""
    oracle: bool = True
    edit: bool = False


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
    seed = begin_check(options, _settings(options))
    tasks = _make_tasks(options, seed)
    step = partial(_step, options, progress)
    made = step("simulating", make, {task.slot.name: (task.sealed / MADE_NAME, task) for task in tasks})
    for name, record in made.items():
        say(f"{name} sealed: sha256 {record['sha256']}")
    results = step("diagnosing", examine, _to_examine(tasks, made, options))
    edits = step("editing", edit, _to_edit(tasks, made, options)) if options.edit else {}
    report = BlindReport(
        robot=f"arms of worlds ({options.worlds})" if options.worlds else options.robot,
        seed=seed,
        seals={name: record["sha256"] for name, record in made.items()},
        outcomes=tuple(_open(task, made[task.slot.name], results, edits) for task in tasks),
        provenance=Provenance("ident blind", settings={**_settings(options), "seed": seed}),
        run={**_settings(options), "code": code_stamp()},
    )
    report.save(options.out / REPORT_NAME)
    with atomic_write(options.out / ROWS_NAME) as part:
        pq.write_table(pa.Table.from_pylist([one.to_row() for one in report.outcomes]), part)
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
    path = options.out / RUN_NAME
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


def _settings(options: BlindOptions) -> dict[str, Any]:
    """What decides which cases there are."""
    return {
        "cases": options.cases,
        "mix": dict(options.mix),
        "robot": options.robot,
        "runs": options.runs,
        "duration": options.duration,
        **({"worlds": options.worlds, "oracle": options.oracle} if options.worlds else {}),
    }


def _make_tasks(options: BlindOptions, seed: int) -> list[MakeTask]:
    stamp = code_stamp()
    base = SimulationOptions(robot=options.robot, runs=options.runs, duration=options.duration, coarse=True)
    worlds = find_worlds(options.worlds) if options.worlds else ()
    return [
        MakeTask(
            slot=slot,
            number=number,
            seed=seed,
            base=base,
            session=(options.out / "sessions" / slot.name).resolve(),
            sealed=(options.out / "sealed" / slot.name).resolve(),
            stamp=stamp,
            worlds=worlds,
            oracle=options.oracle,
        )
        for number, slot in enumerate(plan_slots(options.cases, options.mix, seed))
    ]


def _to_examine(
    tasks: Sequence[MakeTask], made: Mapping[str, Mapping[str, Any]], options: BlindOptions
) -> dict[str, tuple[Path, ExamineTask]]:
    """Diagnoses of all cases: files and tasks; those of an earlier version, or of another seal, are had anew."""
    found = {}
    for task in tasks:
        name, record = task.slot.name, made[task.slot.name]
        path, stamp = (options.out / "results" / f"{name}.json").resolve(), f"{code_stamp()} {record['sha256']}"
        found[name] = path, ExamineTask(task.session, record["robot"], tuple(record["excluded"]), path, stamp)
    return found


def _to_edit(
    tasks: Sequence[MakeTask], made: Mapping[str, Mapping[str, Any]], options: BlindOptions
) -> dict[str, tuple[Path, EditTask]]:
    """Edit tests of simulated single effects: files and tasks."""
    found = {}
    for task in (one for one in tasks if one.slot.kind == "single"):
        name, record = task.slot.name, made[task.slot.name]
        result, path = ((options.out / folder / f"{name}.json").resolve() for folder in ("results", "edits"))
        stamp = f"{code_stamp()} {record['sha256']}"
        found[name] = path, EditTask(task, int(record["attempt"]), result, path, stamp)
    return found


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


def _open(
    task: MakeTask,
    made: Mapping[str, Any],
    results: Mapping[str, Mapping[str, Any]],
    edits: Mapping[str, Mapping[str, Any]],
) -> Outcome:
    """Opens a case's envelope and scores it."""
    slot = task.slot
    answer = open_envelope(task.sealed, case_key(task.seed, slot.name))
    outcome = score_case(slot, answer, results[slot.name], made["starts"])
    return replace(outcome, oracle=made.get("oracle"), edit=edits.get(slot.name, {}).get("ratio"))


def _read(path: Path) -> dict[str, Any]:
    return read_json(path, "remove it, or choose another --out")
