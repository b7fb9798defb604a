"""The check as a whole: make all cases, print their seals, diagnose, open, score. Goes on where it was stopped."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ident.blind_check.cases import FULL_MIX, Slot, plan_slots
from ident.blind_check.code_stamp import stamp_of
from ident.blind_check.editing import EditTask, edit
from ident.blind_check.examining import ExamineTask, examine
from ident.blind_check.making import MADE_NAME, MakeTask, case_key, make
from ident.blind_check.pages import write_blind_pages
from ident.blind_check.scoring import Outcome, score_case
from ident.blind_check.semi_real import EFFECTS, find_sources
from ident.blind_check.summary import BlindReport
from ident.errors import InputError
from ident.files import atomic_write
from ident.plant.answer import open_envelope
from ident.plant.simulate import SimulationOptions
from ident.plant.world_presets import find_worlds
from ident.provenance import Provenance
from ident.untrusted_files import read_json
from ident.workers import run_tasks

RUN_NAME, REPORT_NAME = "run.json", "blind.json"
# The kinds of process: cases are made, diagnosed or edited again when the code that they import has changed.
MAKING, EXAMINING = "ident.blind_check.making", "ident.blind_check.examining"
EDITING = "ident.blind_check.editing"

Say = Callable[[str], None]
Progress = Callable[[str, int, int], None]


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
        semi_real: Folder of real recordings to which known effects are added, instead of simulated cases.
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
    semi_real: Path | None = None
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
    seed = _begin(options)
    tasks = _make_tasks(options, seed)
    _make_all(tasks, options, progress)
    made = {task.slot.name: _read(task.sealed / MADE_NAME) for task in tasks}
    for name, record in made.items():
        say(f"{name} sealed: sha256 {record['sha256']}")
    results = _examine_all(tasks, made, options, progress)
    edits = _edit_all(tasks, made, options, progress) if options.edit else {}
    report = BlindReport(
        robot=f"arms of worlds ({options.worlds})" if options.worlds else options.robot,
        seed=seed,
        seals={name: record["sha256"] for name, record in made.items()},
        outcomes=tuple(_open(task, made[task.slot.name], results, edits) for task in tasks),
        provenance=Provenance("ident blind", settings={**_settings(options), "seed": seed}),
        run={**_settings(options), "plant": tasks[0].stamp, "diagnosis": stamp_of(EXAMINING)},
    )
    with atomic_write(options.out / REPORT_NAME) as part:
        part.write_text(json.dumps(report.to_dict(), indent=1) + "\n", encoding="utf-8")
    write_blind_pages(report, {name: result.get("diagnosis") for name, result in results.items()}, options.out)
    return report


def _begin(options: BlindOptions) -> int:
    """Checks the options, and that the folder holds no other check; returns the seed."""
    if options.cases < 1:
        raise InputError("--cases", f"{options.cases} cases", "ask for one or more")
    if options.workers < 1:
        raise InputError("--workers", f"{options.workers} processes", "give one or more")
    if options.seed is not None and not 0 <= options.seed < 2**62:
        raise InputError("--seed", f"{options.seed}", "choose a number from 0 to 2^62")
    if options.worlds:
        if options.semi_real is not None:
            raise InputError("--worlds", "worlds and real recordings", "choose --worlds or --semi-real")
        find_worlds(options.worlds)
    path, settings = options.out / RUN_NAME, _settings(options)
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
        "semi_real": str(options.semi_real) if options.semi_real else None,
        "runs": options.runs,
        "duration": options.duration,
        **({"worlds": options.worlds, "oracle": options.oracle} if options.worlds else {}),
    }


def _make_tasks(options: BlindOptions, seed: int) -> list[MakeTask]:
    stamp = stamp_of(MAKING)
    base = SimulationOptions(robot=options.robot, runs=options.runs, duration=options.duration, coarse=True)
    sources = find_sources(options.semi_real) if options.semi_real else ()
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
            sources=tuple(source.resolve() for source in sources),
            worlds=worlds,
            oracle=options.oracle,
        )
        for number, slot in enumerate(_slots(options, seed))
    ]


def _slots(options: BlindOptions, seed: int) -> tuple[Slot, ...]:
    if options.semi_real is None:
        return plan_slots(options.cases, options.mix, seed)
    slots = plan_slots(options.cases, {"single": 1.0}, seed, EFFECTS)
    return tuple(replace(slot, kind="semi_real", rich=True) for slot in slots)


def _make_all(tasks: Sequence[MakeTask], options: BlindOptions, progress: Progress) -> None:
    waiting = [task for task in tasks if not _is_done(task.sealed / MADE_NAME, task.stamp)]
    done = _counter("simulating", len(tasks) - len(waiting), len(tasks), progress)
    run_tasks(make, waiting, options.workers, options.scheduler, done)


def _examine_all(
    tasks: Sequence[MakeTask], made: Mapping[str, Mapping[str, Any]], options: BlindOptions, progress: Progress
) -> dict[str, dict[str, Any]]:
    """Results of all cases; those of an earlier version of the diagnosis, or of another seal, are had anew."""
    stamp = stamp_of(EXAMINING)
    asked = [
        ExamineTask(
            session=task.session,
            robot=made[task.slot.name]["robot"],
            excluded=tuple(made[task.slot.name]["excluded"]),
            result=(options.out / "results" / f"{task.slot.name}.json").resolve(),
            stamp=f"{stamp} {made[task.slot.name]['sha256']}",
        )
        for task in tasks
    ]
    asked += _untouched(tasks, made, options, stamp)
    waiting = [task for task in asked if not _is_done(task.result, task.stamp)]
    done = _counter("diagnosing", len(asked) - len(waiting), len(asked), progress)
    run_tasks(examine, waiting, options.workers, options.scheduler, done)
    return {task.result.stem: _read(task.result) for task in asked}


def _edit_all(
    tasks: Sequence[MakeTask], made: Mapping[str, Mapping[str, Any]], options: BlindOptions, progress: Progress
) -> dict[str, dict[str, Any]]:
    """Outcomes of the edit tests of simulated single effects."""
    code = f"{stamp_of(EDITING)} {stamp_of(EXAMINING)}"
    asked = [
        EditTask(
            made=task,
            attempt=int(made[task.slot.name]["attempt"]),
            result=(options.out / "results" / f"{task.slot.name}.json").resolve(),
            edited=(options.out / "edits" / f"{task.slot.name}.json").resolve(),
            stamp=f"{code} {made[task.slot.name]['sha256']}",
        )
        for task in tasks
        if task.slot.kind == "single"
    ]
    waiting = [task for task in asked if not _is_done(task.edited, task.stamp)]
    done = _counter("editing", len(asked) - len(waiting), len(asked), progress)
    run_tasks(edit, waiting, options.workers, options.scheduler, done)
    return {task.edited.stem: _read(task.edited) for task in asked}


def _untouched(
    tasks: Sequence[MakeTask], made: Mapping[str, Mapping[str, Any]], options: BlindOptions, stamp: str
) -> list[ExamineTask]:
    """The real recordings as they are: what is named there already was not found, but there."""
    used = {one["source"]: one["robot"] for one in made.values() if one["source"] >= 0}
    return [
        ExamineTask(
            session=tasks[0].sources[source],
            robot=robot,
            excluded=(),
            result=(options.out / "results" / f"untouched_{source}.json").resolve(),
            stamp=stamp,
        )
        for source, robot in sorted(used.items())
    ]


def _counter(step: str, already: int, total: int, progress: Progress) -> Callable[[str], None]:
    finished: set[str] = set()

    def count(name: str) -> None:
        finished.add(name)
        progress(step, already + len(finished), total)

    return count


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
    there = results.get(f"untouched_{made['source']}", {}).get("diagnosis")
    outcome = score_case(slot, answer, results[slot.name], made["starts"], there)
    return replace(outcome, oracle=made.get("oracle"), edit=edits.get(slot.name, {}).get("ratio"))


def _read(path: Path) -> dict[str, Any]:
    return read_json(path, "remove it, or choose another --out")
