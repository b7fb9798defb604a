"""Fourth step of a case, after its envelope was opened: the edit test.

The named cause is taken out of the patched model, and nothing else: no figure is fitted again. The same arm is then
simulated without the cause, doing other motions. Where the diagnosis told what belongs to the cause from what belongs
to the arm, the edited model foretells those torques as well as a model that was tuned on the arm without the cause,
moving as in the case. Where tuning took part of the cause, or the figures are wrong, the edit leaves a gap that was
not there.

Two models stand beside it: one tuned on the case's recordings with nothing named, and the patched one unedited.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.cases import MakeTask
from ident.benchmark.examining import finite
from ident.benchmark.scoring import is_true, shown_joints
from ident.diagnosis.from_reports import diagnose_reports
from ident.errors import InputError
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import LawModel, log_error
from ident.files import atomic_write
from ident.motion.motion import Motion
from ident.motion.out_of_core import within_band
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources, open_sessions
from ident.simulation.answer import Answer, open_envelope
from ident.simulation.simulate import SimulationOptions, simulate

# The other motions: one of each of the first kinds, about a minute together [s].
MOST_RUNS, LONGEST_RUN_S = 5, 12.0


@dataclass(frozen=True)
class EditTask:
    """What the editing process is told."""

    made: MakeTask  # how the case was made
    attempt: int  # at which draw it was possible
    result: Path  # file of what the diagnosing process wrote
    edited: Path  # file for the outcome
    stamp: str  # of the editing code, and of the result that it takes


def edit(task: EditTask) -> str:
    """Edits a case and writes the outcome; returns the case's name.

    What can't be edited (nothing true was named, or a twin of the arm can't be diagnosed) is written down with why.
    """
    answer = open_envelope(task.made.sealed, task.made.key)
    result = read_json(task.result, "remove it, or choose another --out")
    options, _ = task.made.drawn(task.attempt)
    try:
        record = edit_case(options, answer, result["diagnosis"]) if "diagnosis" in result else {"why": "it failed"}
    except InputError as error:
        record = {"why": str(error)}
    with atomic_write(task.edited) as part:
        part.write_text(json.dumps(finite({"stamp": task.stamp, **record}), default=float) + "\n", encoding="utf-8")
    return task.made.slot.name


def edit_case(options: SimulationOptions, answer: Answer, diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    """The edit test of one case: what was simulated, what was wrong, and what was diagnosed.

    Returns:
        `joints`, at which the cause shows; by model the `rms_Nm` of each joint, and by model the `ratio` to the
        oracle's over these joints; or `why` there is no test.

    Raises:
        InputError: The arm without the cause can't be diagnosed.
    """
    true = [k for k, one in enumerate(diagnosis["findings"]) if any(is_true(t, one, answer) for t in answer.effects)]
    if not true:
        return {"why": "nothing true was named"}
    twin, other = twins_of(options)
    arm, reports = inspect_sources(Given([twin], options.robot)).whole
    oracle, analysis, _ = diagnose_reports(reports, arm, ())
    if analysis is None:
        raise InputError(twin.name, f"its verdict is {oracle.verdict}", "simulate another case")
    arm = arm.keeping(twin.joints)
    opened = open_sessions([other], options.robot, cutoff=FOR_DIAGNOSIS.cutoff_hz, learning=False)
    held_out = within_band(opened.motions)
    models = {
        "edited": edited_arm(diagnosis, arm, true),
        "oracle": tuned_arm(oracle.to_dict(), arm),
        "tuned": tuned_arm(diagnosis, arm),
        "unedited": edited_arm(diagnosis, arm),
    }
    rms = {name: rms_left(model, held_out) for name, model in models.items()}
    joints = sorted({joint for one in answer.effects for joint in shown_joints(one, answer)})
    at = [arm.joint_names.index(joint) for joint in joints]
    return {
        "joints": joints,
        "rms_Nm": {name: dict(zip(arm.joint_names, map(float, one), strict=True)) for name, one in rms.items()},
        "ratio": {name: error_ratio(one[at], rms["oracle"][at]) for name, one in rms.items()},
    }


def edited_arm(record: Mapping[str, Any], arm: ArmModel, taken_out: Collection[int] = ()) -> IdentifiedArm:
    """The patch of a diagnosis less some of its findings, by their places; nothing is fitted again."""
    diagnosed = Diagnosed.of_record(dict(record), needed=False)
    kept = tuple(change for k, change in enumerate(diagnosed.changes) if k not in taken_out)
    return replace(diagnosed.candidates(arm)["after"], changes=kept)


def tuned_arm(record: Mapping[str, Any], arm: ArmModel) -> IdentifiedArm:
    """What the same recordings give where nothing is identified: the best tuning of links and losses."""
    return Diagnosed.of_record(dict(record), needed=False).candidates(arm)["tuned"]


def rms_left(identified: IdentifiedArm, motions: Sequence[Motion]) -> Float[Array, " n"]:
    """Error of the filtered torque where joints move steadily, by joint [N m]."""
    squares = sum(np.sum(log_error(LawModel.of(identified, one.payload), one) ** 2, axis=0) for one in motions)
    return np.sqrt(squares / np.maximum(sum(one.settled.sum(axis=0) for one in motions), 1.0))


def error_ratio(error: Float[Array, " k"], oracle: Float[Array, " k"]) -> float:
    """Root mean square over joints of the errors, each in units of the oracle's."""
    return float(np.sqrt(np.mean((error / np.maximum(oracle, 1e-12)) ** 2)))


def twins_of(options: SimulationOptions) -> tuple[Session, Session]:
    """The arm of a case without its causes: in the case's own motions, and in others."""
    arm = options.seed if options.arm_seed is None else options.arm_seed
    plain = replace(options, effects=(), measure=False, arm_seed=arm)
    seed = int(np.random.default_rng([options.seed, 11]).integers(2**62))
    runs, duration = min(options.runs, MOST_RUNS), min(options.duration, LONGEST_RUN_S)
    other = replace(plain, seed=seed, runs=runs, duration=duration)
    return simulate(plain, "twin").session, simulate(other, "other").session
