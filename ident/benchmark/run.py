"""The check as a whole: make all cases, print their seals, diagnose, open, score.

Goes on where it was stopped.

The named cause is taken out of the patched model, and nothing else: no figure is fitted again. The
same arm is then simulated without the cause, doing other motions. Where the diagnosis told what
belongs to the cause from what belongs to the arm, the edited model foretells those torques as well
as a model that was tuned on the arm without the cause, moving as in the case. Where tuning took
part of the cause, or the figures are wrong, the edit leaves a gap that was not there.

Two models stand beside it: one tuned on the case's recordings with nothing named, and the patched
one unedited.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.benchmark.cases import FULL_MIX, MADE_NAME, MakeTask, make, plan_slots
from ident.benchmark.examining import ExamineTask, examine, write_result
from ident.benchmark.scoring import score_case
from ident.benchmark.summary import BlindReport
from ident.benchmark.truth import is_true, shown_joints
from ident.command_options import CheckOptions
from ident.diagnosis.from_reports import diagnose_reports
from ident.errors import InputError
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import LawModel, log_error
from ident.files import atomic_write, write_record
from ident.motion.motion import Motion
from ident.motion.settings import FOR_DIAGNOSIS
from ident.motion.stretches import within_band
from ident.outputs import real_path
from ident.recordings.recording import Session
from ident.records import JsonRecord, JsonTable
from ident.regression.decimation import moved_inertia
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources, open_sessions
from ident.simulation.request import Answer, open_envelope
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.world import find_worlds
from ident.workers import run_tasks

Say = Callable[[str], None]
Progress = Callable[[str, int, int], None]
# The other motions: one of each of the first kinds, about a minute together [s].
MOST_RUNS = 5
LONGEST_RUN_S = 12.0


@dataclass(frozen=True)
class EditTask:
    """What the editing process is given."""

    made: MakeTask  # how the case was made
    attempt: int  # at which draw it was possible
    result: Path  # file of what the diagnosing process wrote
    edited: Path  # file for the outcome
    stamp: str  # of the editing code, and of the result that it takes


T = TypeVar("T", MakeTask, ExamineTask, EditTask)


def edit(task: EditTask) -> str:
    """Edits a case and writes the outcome; returns the case's name.

    What can't be edited (nothing true was named, or a twin of the arm can't be diagnosed) is
    written down with why.
    """
    answer = open_envelope(task.made.sealed, task.made.key)
    result = _read(task.result)
    options, _ = task.made.drawn(task.attempt)
    record: JsonRecord = {"why": "it failed"}
    if "diagnosis" in result:
        try:
            record = edit_case(options, answer, result["diagnosis"])
        except InputError as error:
            record = {"why": str(error)}
    write_result(task.edited, {"stamp": task.stamp, **record})
    return task.made.slot.name


def edit_case(options: SimulationOptions, answer: Answer, diagnosis: JsonTable) -> JsonRecord:
    """The edit test of one case: what was simulated, what was wrong, and what was diagnosed.

    Returns:
        `joints`, at which the cause shows; by model the `rms_Nm` of each joint, and by model the
        `ratio` to the oracle's over these joints; or `why` there is no test.

    Raises:
        InputError: The arm without the cause can't be diagnosed.
    """
    true = []
    for place, finding in enumerate(diagnosis["findings"]):
        if any(is_true(effect, finding, answer) for effect in answer.effects):
            true.append(place)
    if not true:
        return {"why": "nothing true was named"}
    twin, other = twins_of(options)
    arm, reports = inspect_sources(Given([twin], options.robot)).whole
    oracle, analysis, _ = diagnose_reports(reports, arm, ())
    if analysis is None:
        raise InputError(twin.name, f"its verdict is {oracle.verdict}", "simulate another case")
    arm = arm.keeping(twin.joints)
    opened = open_sessions([other], options.robot, learning=False, motion=FOR_DIAGNOSIS)
    held_out = within_band(opened.motions, moved_inertia(arm, opened.motions))
    models = {
        "edited": edited_arm(diagnosis, arm, true),
        "oracle": tuned_arm(oracle.to_dict(), arm),
        "tuned": tuned_arm(diagnosis, arm),
        "unedited": edited_arm(diagnosis, arm),
    }
    rms = {name: rms_left(model, held_out) for name, model in models.items()}
    joints = sorted({joint for effect in answer.effects for joint in shown_joints(effect, answer)})
    shown = [arm.joint_names.index(joint) for joint in joints]
    of_oracle = rms["oracle"][shown]
    by_joint = {}
    ratio = {}
    for name, error in rms.items():
        by_joint[name] = dict(zip(arm.joint_names, map(float, error), strict=True))
        ratio[name] = error_ratio(error[shown], of_oracle)
    return {"joints": joints, "rms_Nm": by_joint, "ratio": ratio}


def edited_arm(record: JsonTable, arm: ArmModel, taken_out: Collection[int] = ()) -> IdentifiedArm:
    """The patch of a diagnosis less some of its findings, by their places.

    Nothing is fitted again.
    """
    diagnosed = Diagnosed.of_record(dict(record), needed=False)
    numbered = enumerate(diagnosed.changes)
    changes = tuple(change for place, change in numbered if place not in taken_out)
    return replace(diagnosed.candidates(arm)["after"], changes=changes)


def tuned_arm(record: JsonTable, arm: ArmModel) -> IdentifiedArm:
    """What the same recordings give where nothing is identified.

    The best tuning of links and losses.
    """
    return Diagnosed.of_record(dict(record), needed=False).candidates(arm)["tuned"]


def rms_left(identified: IdentifiedArm, motions: Sequence[Motion]) -> Float[Array, " n"]:
    """Error of the filtered torque where joints move steadily, by joint [N m]."""
    errors = [log_error(LawModel.of(identified, motion.payload), motion) for motion in motions]
    squares = sum(np.sum(error**2, axis=0) for error in errors)
    samples = sum(motion.settled.sum(axis=0) for motion in motions)
    return np.sqrt(squares / np.maximum(samples, 1.0))


def error_ratio(error: Float[Array, " k"], oracle: Float[Array, " k"]) -> float:
    """Root mean square over joints of the errors, each in units of the oracle's."""
    return float(np.sqrt(np.mean((error / np.maximum(oracle, 1e-12)) ** 2)))


def twins_of(options: SimulationOptions) -> tuple[Session, Session]:
    """The arm of a case without its causes: in the case's own motions, and in others."""
    runs = min(options.runs, MOST_RUNS)
    duration = min(options.duration, LONGEST_RUN_S)
    other = other_motions(options, runs, duration)
    return simulate(without_causes(options), "twin").session, simulate(other, "other").session


def without_causes(options: SimulationOptions) -> SimulationOptions:
    """Options of the same arm in the same motions, with nothing wrong with it."""
    arm = options.seed if options.arm_seed is None else options.arm_seed
    return replace(options, effects=(), measure=False, arm_seed=arm)


def other_motions(options: SimulationOptions, runs: int, duration: float) -> SimulationOptions:
    """Options of the same arm without its causes in other motions.

    Args:
        options: Of the arm with its causes.
        runs: How many.
        duration: Of each, roughly [s].
    """
    seed = int(np.random.default_rng([options.seed, 11]).integers(2**62))
    return replace(without_causes(options), seed=seed, runs=runs, duration=duration)


@dataclass(frozen=True)
class BlindOptions(CheckOptions):
    """What to check, with what Python alone can choose."""

    # Shares of the kinds of case.
    mix: Mapping[str, float] = field(default_factory=lambda: dict(FULL_MIX))
    runs: int = 10  # of each session; of a world, its own
    duration: float = 8.0  # rough duration of a run [s]; of a world, its own

    @property
    def settings(self) -> JsonRecord:
        """What decides which cases there are."""
        names = ["cases", "mix", "robot", "runs", "duration"]
        if self.worlds:
            names += ["worlds", "oracle"]
        settings = {name: getattr(self, name) for name in names}
        return {**settings, "mix": dict(self.mix)}


def run_blind(
    options: BlindOptions,
    say: Say = lambda line: None,
    progress: Progress = lambda step, done, total: None,
) -> BlindReport:
    """Runs the check; seals are said before any diagnosis, progress is a step's name and how many
    of all cases.

    Raises:
        InputError: Options that make no sense, or another check in the folder.
    """
    seed = begin_check(options, options.settings)
    stamp = code_stamp()
    tasks = _tasks_of_cases(options, seed, stamp)
    step = partial(_step, options, progress)
    waiting = {name: (task.sealed / MADE_NAME, task) for name, task in tasks.items()}
    made = step("simulating", make, waiting)
    for name, record in made.items():
        say(f"{name} sealed: sha256 {record['sha256']}")
    diagnoses = {}
    edits = {}
    out = real_path(options.out)
    for name, task in tasks.items():
        # Those of an earlier version, or of another seal, are had anew.
        record = made[name]
        stamped = f"{stamp} {record['sha256']}"
        result = out / "results" / f"{name}.json"
        excluded = tuple(record["excluded"])
        examined = ExamineTask(task.session, record["robot"], excluded, result, stamped)
        diagnoses[name] = (result, examined)
        if options.edit and task.slot.kind == "single":
            edited = out / "edits" / f"{name}.json"
            attempt = int(record["attempt"])
            edits[name] = (edited, EditTask(task, attempt, result, edited, stamped))
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
        # Cases drawn again, as a size was out of reach or the arm diverged.
        run={
            **options.settings,
            "code": stamp,
            "drawn_again": sum(record["attempt"] > 0 for record in made.values()),
        },
    )
    report.save(options.out / "blind.json")
    rows = [outcome.to_row() for outcome in outcomes]
    with atomic_write(options.out / "cases.parquet") as scratch:
        pq.write_table(pa.Table.from_pylist(rows), scratch)
    return report


def _tasks_of_cases(options: BlindOptions, seed: int, stamp: str) -> dict[str, MakeTask]:
    """What the simulating processes are given, by case."""
    out = real_path(options.out)
    worlds = find_worlds(options.worlds) if options.worlds else ()
    base = SimulationOptions(
        robot=options.robot, runs=options.runs, duration=options.duration, coarse=True
    )
    tasks = {}
    for number, slot in enumerate(plan_slots(options.cases, options.mix, seed)):
        session = out / "sessions" / slot.name
        sealed = out / "sealed" / slot.name
        tasks[slot.name] = MakeTask(
            slot, number, seed, base, session, sealed, stamp, worlds, options.oracle
        )
    return tasks


def begin_check(options: BlindOptions, settings: JsonTable) -> int:
    """Checks that the folder holds no other check than one with these settings.

    Returns the seed.
    """
    if options.worlds:
        find_worlds(options.worlds)
    path = options.out / "run.json"
    if path.is_file():
        try:
            before = _read(path)
            seed = int(before.pop("seed"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(
                path, f"no record of a check ({error!r})", "choose another --out"
            ) from None
        if before != settings or options.seed not in (None, seed):
            raise InputError(
                path,
                "another check was begun in this folder",
                "choose another --out, or its options",
            )
        return seed
    if options.out.is_dir() and any(options.out.iterdir()):
        raise InputError(options.out, "the folder holds something else", "choose another --out")
    seed = secrets.randbits(48) if options.seed is None else options.seed
    write_record(path, {**settings, "seed": seed})
    return seed


def _step(
    options: BlindOptions,
    progress: Progress,
    name: str,
    function: Callable[[T], str],
    tasks: Mapping[str, tuple[Path, T]],
) -> dict[str, JsonRecord]:
    """What a step wrote of each case; what is there already is not done again."""

    def is_done(path: Path, stamp: str) -> bool:
        """Whether a file of this version is there. A diagnosis that failed is tried again."""
        record = _read(path) if path.is_file() else {"error": "not begun"}
        return record.get("stamp") == stamp and "error" not in record

    waiting = [task for path, task in tasks.values() if not is_done(path, task.stamp)]
    finished: set[str] = set()

    def count(case: str) -> None:
        finished.add(case)
        progress(name, len(tasks) - len(waiting) + len(finished), len(tasks))

    run_tasks(function, waiting, options.workers, options.scheduler, count)
    return {case: _read(path) for case, (path, _) in tasks.items()}


@cache
def code_stamp() -> str:
    """Short hash of this package's source: a result of an earlier version is had anew."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _read(path: Path) -> JsonRecord:
    return read_json(path, "remove it, or choose another --out")
