"""An excitation as it is recorded at a cell: a folder of motions a step, as the arm's controller
takes them.

In: the runs of `plan excite`, a controller. Out: a folder a step (a slow test, the warm-up, the
runs to record, held-out runs for another session), and `capture.json` with what to do at each, and
size and digest of each file.

The held-out runs are recorded ones backwards: at the same places, at the same speeds, friction the
other way. They keep whatever bounds of place, speed and acceleration their originals keep.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.files import atomic_folder
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.trajectories.reference import TICK_S, ReferenceMotion, ticks
from plan.experiment.result import MOTION_KIND, Excitation
from plan.problem.controllers import (
    RAMPED_S,
    SAMPLED,
    Controller,
    choose_controller,
    require_joints,
)
from plan.problem.execution import Execution
from plan.spline import Splines

RECORD_NAME = "capture.json"
SCHEMA = "plan.capture/1"
# Files for any controller: samples with positions, velocities and accelerations.
TABLES = "csv"
# How many times as long the slow test takes.
SLOWER = 4
# Samples of a table lie so far apart [s].
SAMPLE_S = 0.004
# One in so many runs is recorded backwards, too, to be held out.
HELD_OUT = 4


@dataclass(frozen=True)
class Step:
    """What is done at the cell in one go."""

    name: str  # of its folder
    order: str  # what to do, a sentence
    motions: tuple[ReferenceMotion, ...]
    session: str = ""  # folder for what is recorded; empty where nothing is


def steps_of(runs: Sequence[ReferenceMotion]) -> tuple[Step, ...]:
    """The steps of a capture in their order."""
    slow = tuple(slowed(run, SLOWER) for run in runs)
    held_out = tuple(run.reversed(f"{run.name}_back") for run in runs[::HELD_OUT])
    return (
        Step(
            "1_slow_test",
            f"Move these, {SLOWER} times as slow, with a hand on the stop: is every path free? "
            "Record nothing.",
            slow,
        ),
        Step(
            "2_warm_up",
            "Repeat this for as long as the arm is usually warmed up: friction falls with warmth. "
            "Record nothing.",
            tuple(runs[:1]),
        ),
        Step(
            "3_record",
            "Move these and record each to a file of its own, on one clock; "
            "the arm rests a second before and after.",
            tuple(runs),
            "my_session",
        ),
        Step(
            "4_hold_out",
            "Move and record these likewise into another folder: "
            "give it to `ident evaluate`, never to a fit.",
            held_out,
            "my_session_held_out",
        ),
    )


def slowed(motion: ReferenceMotion, factor: int) -> ReferenceMotion:
    """The same path as another motion, `factor` times as slow; its name gets `_slow` at its end."""
    times = ticks(factor * motion.duration) / factor
    curve = _curve(motion)
    return ReferenceMotion(
        f"{motion.name}_slow",
        curve(times),
        curve(times, 1) / factor,
        curve(times, 2) / factor**2,
    )


def choose_format(name: str, arm: ArmModel) -> Controller | None:
    """The controller of a name; None for tables, which any takes.

    Raises:
        InputError: No such controller, or not this arm's.
    """
    if name == TABLES:
        return None
    try:
        controller = choose_controller(name, None, arm)
    except InputError as error:
        raise InputError("--capture", error.what, f"{error.remedy}, or {TABLES}") from None
    if controller is not None:
        require_joints(controller, arm.n)
    return controller


def execution_of(
    motion: ReferenceMotion,
    joints: Sequence[str],
    controller: Controller | None,
) -> tuple[Execution, float]:
    """A motion as a controller is sent it, and how far what it makes of that strays from the motion
    [rad].

    Args:
        motion: The motion to send.
        joints: The joints' names, in its columns' order.
        controller: None for a table of evenly spaced samples, which strays by nothing.
    """
    curve = _curve(motion)
    if controller is None:
        count = max(round(motion.duration / SAMPLE_S), 1)
        times = motion.duration * np.arange(count + 1) / count
        states = (curve(times), curve(times, 1), curve(times, 2))
        return Execution(tuple(joints), times, *states, longer=0.0), 0.0
    step = controller.step_s if controller.points == "even" else max(RAMPED_S, controller.step_s)
    whole = controller.whole(motion.duration)
    count = max(int(whole / step), 1)
    knots = np.unique(np.round(whole * np.arange(count + 1) / count / controller.stamp_s))
    knots = knots * controller.stamp_s
    points = curve(np.minimum(knots, motion.duration))
    splines = Splines(points[None], np.diff(knots)[None])
    times, q, dq = controller.sent(splines)
    made = controller.make_curve(splines).at(ticks(motion.duration))[0]
    miss = float(np.max(np.abs(made - motion.q)))
    return Execution(tuple(joints), times, q, dq, np.zeros_like(q), 0.0, controller), miss


def write_capture(
    excitation: Excitation, folder: str | Path, controller: Controller | None
) -> dict[str, object]:
    """Writes the motion as `Excitation.write` does, and a folder a step beside it; whole or not at
    all.

    Returns:
        The record of `capture.json`.

    Args:
        excitation: What `excite` found.
        folder: Written anew.
        controller: Whose files are written; None for tables (.csv).
    """
    joints = list(excitation.noise)
    suffix = SAMPLED[0] if controller is None else controller.suffix
    with atomic_folder(folder, MOTION_KIND) as partial:
        excitation.write_into(partial)
        steps = []
        for step in steps_of(excitation.runs):
            files = []
            for number, motion in enumerate(step.motions, start=1):
                path = partial / step.name / f"{number:02d}_{motion.name}{suffix}"
                path.parent.mkdir(exist_ok=True)
                execution, miss = execution_of(motion, joints, controller)
                execution.save(path)
                files.append(_file_record(path, partial, motion, miss))
            record = {"step": step.name, "do": step.order, "session": step.session, "files": files}
            steps.append(record)
        told = {
            "schema": SCHEMA,
            "robot": excitation.robot,
            "controller": TABLES if controller is None else controller.name,
            "joints": joints,
            "home_rad": excitation.run_set.home.tolist(),
            "steps": steps,
            "between_runs": "ident diagnose my_session --robot … --until 0.95",
        }
        (partial / RECORD_NAME).write_text(as_json(told) + "\n", encoding="utf-8")
    return told


def _file_record(
    path: Path, folder: Path, motion: ReferenceMotion, miss: float
) -> dict[str, object]:
    """What is said of a motion's file."""
    return {
        "file": path.relative_to(folder).as_posix(),
        "seconds": motion.duration,
        "strays_rad": miss,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def _curve(motion: ReferenceMotion) -> CubicHermiteSpline:
    """The motion between its ticks."""
    times: Float[Array, " K"] = TICK_S * np.arange(len(motion.q))
    return CubicHermiteSpline(times, motion.q, motion.dq)
