"""The page of arms that log goal and position only: what holds each joint back, and how far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ident.servos.servo_fit import FIGURES, TEXT, ServoArm
from ident.servos.told_runs import ToldRun
from ident.show.report.numbers import with_error
from ident.show.report.page import (
    Section,
    describe_origin,
    facts_section,
    provenance_facts,
    render_page,
    save_page,
)
from ident.show.report.traces import MOST_JOINTS, MOST_RUNS, RunTraces, Traces, section_values
from ident.show.report.words import significant
from ident.show.servo_lines import (
    ALIKE,
    RECORD_MORE,
    WRITE_FILES,
    ServoRecord,
    headline,
    judged_joints,
    untold_lines,
)

CURVES = (
    "Angle as it was measured, the goal, and where the figures put the joint. Below: what both are "
    "off by. Where a joint rests or turns round the figures say nothing."
)
# Figures that people have words for.
SHOWN = tuple(name for name, figure in FIGURES.items() if "shown" in figure)


def write_servo_report(path: str | Path, result: ServoArm) -> Path:
    """Writes the page, whole or not at all.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_servo_report(result))


def render_servo_report(result: ServoArm) -> str:
    """The page as text, what was found first."""
    record = result.to_dict()
    values = {**verdict_values(record), "untold": untold_lines(result)}
    sections = [
        Section("verdict", "What was found", "servo.html", values),
        traces_section(result),
        facts_section(provenance_facts(record)),
    ]
    return render_page(
        f"{record['robot']}: why do its servos not stand where they were told?",
        sections,
        describe_origin(record),
    )


def verdict_values(record: ServoRecord) -> ServoRecord:
    """What the first section shows."""
    joints = record["joints"]
    judged = judged_joints(record)
    rows = servo_rows(record)
    told = set[str]()
    for joint in joints.values():
        told |= set(joint["figures"])
    used = [name for name in SHOWN if name in told]
    tied = any("dead_band_rad" in joint["figures"] for joint in joints.values())
    return {
        "headline": headline(judged),
        "first": WRITE_FILES if judged else RECORD_MORE,
        "columns": [(name, FIGURES[name]["name"], FIGURES[name]["shown"]) for name in used],
        "rows": rows,
        "rolled": any(row["rolled"] is not None for row in rows),
        "parted": ALIKE.format(TEXT["parted_by"]) if tied else "",
    }


def servo_rows(record: ServoRecord) -> Sequence[ServoRecord]:
    """Of each joint its error before and after, and its figures in words."""
    rows = []
    for name, joint in record["joints"].items():
        held = joint["heldout"] or {}
        rolled = joint.get("roll_out")
        rows.append(
            {
                "joint": name,
                "before": milli(held.get("rms_before_rad")),
                "after": milli(held.get("rms_after_rad")),
                "rolled": milli(rolled["held_back"]["mean_absolute_rad"]) if rolled else None,
                "cells": {key: figure_in_words(key, joint["figures"].get(key)) for key in SHOWN},
            }
        )
    return rows


def milli(value: float | None) -> str | None:
    """An angle in mrad [rad]."""
    return None if value is None else significant(1e3 * value)


def figure_in_words(key: str, figure: Mapping[str, float] | None) -> str | None:
    """A figure with the farther end of its interval, in the unit that people use."""
    if figure is None:
        return None
    scale = float(FIGURES[key]["scale"])
    return with_error({end: scale * figure[end] for end in ("value", "low", "high")})


def traces_section(result: ServoArm) -> Section | None:
    """Goal, position and what the figures say, over time."""
    traces = gather_servo_traces(result)
    if traces is None:
        return None
    return Section("traces", "Goal against position", "traces.html", section_values(traces, CURVES))


def gather_servo_traces(result: ServoArm) -> Traces | None:
    """The runs of which something was found, the joint that follows worst first."""
    errors = np.array([joint.rms_before for joint in result.joints])
    if not result.curves or not np.isfinite(errors).any():
        return None
    order = np.argsort(-np.nan_to_num(errors, nan=-1.0), kind="stable")
    shown = [int(j) for j in order if np.isfinite(errors[j])][:MOST_JOINTS]
    runs = [
        RunTraces(
            run.name, run.time, {"measured": run.position, "goal": run.goal, "told": run.told}
        )
        for run in _worst_first(result, shown[0])[:MOST_RUNS]
    ]
    names = tuple(joint.joint for joint in result.joints)
    return Traces(names, tuple(shown), ("rad",) * len(names), tuple(runs), "angle")


def _worst_first(result: ServoArm, joint: int) -> Sequence[ToldRun]:
    """Runs by how far a joint is from its goal."""
    return sorted(
        result.curves, key=lambda run: -float(np.mean((run.goal - run.position)[:, joint] ** 2))
    )
