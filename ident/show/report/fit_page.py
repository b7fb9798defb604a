"""The page of a fit: how far the model is off, its numbers beside the URDF's, curves, choices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.fitting.chosen import WORDS
from ident.fitting.fit import FitResults
from ident.fitting.identified_numbers import identified_numbers
from ident.model.evaluation import RunTrace, trace_run
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.motion.stretches import choose_runs
from ident.recordings.recording import TelemetryIssue
from ident.show.fit_lines import describe_choices, describe_data, describe_foretold, foretold_of
from ident.show.report.numbers import (
    LOSSES,
    READINGS,
    STATED,
    lies_outside,
    plain,
    with_error,
    with_interval,
)
from ident.show.report.page import (
    Section,
    describe_origin,
    models_section,
    render_page,
    save_page,
    telemetry_section,
)
from ident.show.report.parameter_figures import parameters_values
from ident.show.report.traces import MOST_JOINTS, MOST_RUNS, RunTraces, Traces, section_values
from ident.show.report.words import percent, sentence, significant, with_units
from ident.units import TORQUE, unit_for

OFFSET = "offset_Nm"
# Numbers of a joint, by their keys in `identified`: name and unit.
NUMBERS = {**LOSSES, OFFSET: READINGS[OFFSET]}
# Kinds of link inertias in words; a table has the room to say what one of them means.
KINDS = {**WORDS, "base": "as the recordings have them, whatever body that would be"}
FIRST = "Try it on recordings that it has not seen: `ident evaluate MODEL SESSION…`."
CURVES = (
    "Torque as it was measured, of your URDF as a simulator loads it, and of the fitted model. "
    "Below: what each is off by. The fit has seen these runs; what it is off by on parts that it "
    "has not seen stands in the table above. Where a joint rests or turns round no model of its "
    "motion is judged."
)


def write_fit_report(
    path: str | Path,
    results: FitResults,
    motions: Sequence[Motion],
    issues: Sequence[TelemetryIssue] = (),
) -> Path:
    """Writes the page, whole or not at all.

    Args:
        path: Where.
        results: The fit.
        motions: The runs that it was fitted to.
        issues: What the telemetry check found.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_fit_report(results, motions, issues))


def render_fit_report(
    results: FitResults, motions: Sequence[Motion], issues: Sequence[TelemetryIssue] = ()
) -> str:
    """The page as text, what was found first."""
    model = results.model
    record = {"robot": model.robot.name, "provenance": results.provenance.to_dict()}
    sections = [
        Section("verdict", "What was found", "fit.html", verdict_values(results)),
        traces_section(model, motions),
        Section(
            "choices",
            "What was chosen, and what it costs",
            "fit_choices.html",
            choice_values(results),
        ),
        Section(
            "parameters",
            "Inertias, laws and net",
            "parameters.html",
            parameters_values([model], ["fitted"], 0, False),
        ),
        telemetry_section([issue.to_dict() for issue in issues]),
        models_section([(model.robot.name, model)]),
    ]
    return render_page(
        f"{model.robot.name}: its numbers, fitted", sections, describe_origin(record)
    )


def verdict_values(results: FitResults) -> Mapping[str, Any]:
    """What the first section shows."""
    model = results.model
    identified = identified_numbers(model)
    errors = {joint.joint: joint for joint in foretold_of(model)}
    known = set[str]()
    for numbers in identified.values():
        known.update(numbers)
    used = [key for key in NUMBERS if key in known]
    slides = dict(zip(model.joint_names, model.nominal.sliding_joints, strict=True))
    rows = []
    for joint, numbers in identified.items():
        error = errors.get(joint)
        cells = {key: number_cell(key, numbers.get(key), bool(slides[joint])) for key in used}
        words = None
        if error is not None:
            sizes = f"{significant(error.error)} of {significant(error.torque)}"
            words = f"{sizes} ({percent(error.share)})"
        rows.append({"joint": joint, "cells": cells, "error": words})
    kinds = sorted({bool(sliding) for sliding in slides.values()})
    return {
        "headline": describe_foretold(model) or f"{model.robot.name} was fitted.",
        "first": FIRST,
        "columns": [(key, NUMBERS[key][0], _units(NUMBERS[key][1], kinds)) for key in used],
        "torque_unit": _units(TORQUE, kinds),
        "rows": rows,
        "net": model.net is not None,
        "data": [beginning(line, model.joint_names) for line in describe_data(results)],
    }


def _units(unit: str, kinds: Sequence[bool]) -> str:
    """A unit of joints that turn, of those that slide, or both."""
    return "; ".join(unit_for(unit, slides) for slides in kinds)


def number_cell(
    key: str, figure: Mapping[str, Any] | None, slides: bool
) -> dict[str, str | bool] | None:
    """What the URDF says and what was fitted, in words; None where nothing was.

    Args:
        key: Of the number.
        figure: Its record.
        slides: Whether its joint slides: its number has another unit than that of one that turns.
    """
    if figure is None or figure["value"] is None:
        return None
    signed = key == OFFSET
    return {
        "nominal": plain(figure["nominal"]),
        "value": with_error(figure) if signed else with_interval(figure),
        "off": lies_outside(figure, 0.0 if key in STATED else None),
        "unit": unit_for(NUMBERS[key][1], slides),
    }


def choice_values(results: FitResults) -> Mapping[str, Any]:
    """What each kind of inertias leaves of parts that no fit saw, other choices in words."""
    choice = results.choice
    kinds = [
        {
            "name": KINDS[kind],
            "torque": significant(errors.total, 3),
            "energy": significant(errors.energy, 3),
            "chosen": kind == choice.kind,
        }
        for kind, errors in choice.errors.items()
    ]
    lines = [beginning(line, results.model.joint_names) for line in describe_choices(results)]
    return {"kinds": kinds, "lines": lines}


def beginning(line: str, joints: Sequence[str]) -> str:
    """A line as a sentence; the name of a joint at its beginning stays as it is."""
    text = with_units(line)
    return text if text.startswith(tuple(joints)) else sentence(text)


def traces_section(model: HybridModel, motions: Sequence[Motion]) -> Section | None:
    """Measured and modelled torque over time."""
    traces = gather_fit_traces(model, motions)
    if traces is None:
        return None
    return Section(
        "traces", "Measured against the model", "traces.html", section_values(traces, CURVES)
    )


def gather_fit_traces(model: HybridModel, motions: Sequence[Motion]) -> Traces | None:
    """Curves of runs from all over the recordings, the worst first; None where no joint moves."""
    every = -(-len(motions) // MOST_RUNS)
    chosen = [motions[k] for k in choose_runs(len(motions), max(1, every))]
    runs = [trace_run(model, motion) for motion in chosen]
    errors = np.array([_error(run) for run in runs])
    if not errors.size or not np.isfinite(errors).any():
        return None
    by_joint = np.nan_to_num(errors).mean(axis=0)
    shares = {joint.joint: joint.share for joint in foretold_of(model)}
    order = sorted(
        range(model.arm.n), key=lambda j: (-shares.get(model.joint_names[j], 0.0), -by_joint[j])
    )
    shown = tuple(order[:MOST_JOINTS])
    worst_first = np.argsort(-np.nan_to_num(errors[:, shown[0]], nan=-1.0), kind="stable")
    units = tuple(unit_for(TORQUE, bool(sliding)) for sliding in model.nominal.sliding_joints)
    return Traces(model.joint_names, shown, units, tuple(_curves_of(runs[k]) for k in worst_first))


def _error(run: RunTrace) -> np.ndarray:
    """What the whole model is off by at each joint, root mean square where it is judged [N m]."""
    error = np.where(run.motion.settled, run.error(tuple(run.rungs)[-1]), np.nan)
    counts = np.isfinite(error).sum(axis=0)
    squares = np.nansum(error**2, axis=0)
    return np.where(counts > 0, np.sqrt(squares / np.maximum(counts, 1)), np.nan)


def _curves_of(run: RunTrace) -> RunTraces:
    """Torque as measured, of the URDF, of the fitted arm, and with a net where there is one."""
    rungs = run.filtered
    torque = {"URDF": rungs.get("urdf", rungs["analytic"])}
    torque["fitted"] = rungs.get("named", rungs["loss"])
    if "net" in rungs:
        torque["net"] = rungs["net"]
    judged = {name: np.where(run.motion.settled, values, np.nan) for name, values in torque.items()}
    time = np.asarray(run.time - run.time[0])
    return RunTraces(
        run.motion.name, time, {"measured": np.asarray(run.motion.tau_filtered), **judged}
    )
