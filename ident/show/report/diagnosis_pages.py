"""The pages of a diagnosis and of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.diagnosis.gap.gap_map import says_where
from ident.diagnosis.gap.settings import USUAL_MAP
from ident.errors import plural
from ident.show.report import numbers
from ident.show.report.diagnosis_actions import first_action, order_of, second_action
from ident.show.report.diagnosis_doubts import describe_reservations, describe_unnamed
from ident.show.report.diagnosis_gap import (
    describe_findings,
    describe_motion,
    describe_noise,
    energy_pair,
    joints_tuned_away,
)
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.evaluation import ReportInput, evaluation_sections
from ident.show.report.finding_words import called, in_units_of, units_of
from ident.show.report.leading_joint import in_order_of_joints
from ident.show.report.page import (
    EPOCH_FROM,
    Section,
    describe_origin,
    facts_section,
    provenance_facts,
    render_page,
    save_page,
    telemetry_section,
)
from ident.show.report.words import (
    DASH,
    axis_name,
    axis_unit,
    bar,
    fixed,
    glue,
    interval_words,
    pair,
    percent,
    row_places,
    sentence,
    shade,
    significant,
)
from ident.show.terminal import (
    describe_known,
    describe_notes,
    describe_side,
    describe_spread,
    headline,
    places_of,
    without_still,
)
from ident.show.untested_words import limit_rows, silent_groups

if TYPE_CHECKING:
    from ident.show.report.laws import LawPicture
    from ident.show.report.traces import Traces

MOST_SENTENCES = 5
TRACES = (
    "Torque as it was measured and as each model has it, on parts that no tuned model was fitted "
    "to. Below: what each model is off by. Where a joint rests or turns round no model is judged."
)
# A cell this many times as dense as the mean has the strongest colour.
DENSEST = 3.0

Record = Mapping[str, Any]
"""A result, or a part of it, as JSON has it."""


def write_diagnosis_report(
    path: str | Path,
    record: Record,
    evaluation: ReportInput | None = None,
    pictures: Sequence[LawPicture | None] = (),
    traces: Traces | None = None,
) -> Path:
    """Writes the page of a diagnosis, whole or not at all; arguments as for
    `render_diagnosis_report`.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_diagnosis_report(record, evaluation, pictures, traces))


def render_diagnosis_report(
    record: Record,
    evaluation: ReportInput | None = None,
    pictures: Sequence[LawPicture | None] = (),
    traces: Traces | None = None,
) -> str:
    """The page of a diagnosis as text, the verdict first.

    Args:
        record: The diagnosis.
        evaluation: What the user's own model is worth on the same recordings, if there is one.
        pictures: A picture of each finding, in their order.
        traces: Torque over time, if the recordings are at hand.
    """
    sections = [
        verdict_section(record),
        numbers_section(record),
        traces_section(traces),
        findings_section(record, pictures),
        where_section(record),
        outlook_section(record),
        telemetry_section(record.get("telemetry", [])),
        facts_section(provenance_facts(record)),
    ]
    if evaluation is not None:
        shown = {"verdict", *(section.anchor for section in sections if section is not None)}
        further = [section for section in evaluation_sections(evaluation) if section is not None]
        sections += [section for section in further if section.anchor not in shown]
    title = f"{record['robot']}: why does the arm not move as its model says?"
    return render_page(title, sections, describe_origin(record))


def verdict_section(record: Record) -> Section:
    """Verdict, what to make of it, and the gap joint by joint."""
    session = record.get("session", {})
    runs = plural(session.get("runs", 0), "run")
    seconds = fixed(session.get("duration_s", 0.0), 0)
    given = any("model_rms_Nm" in gap for gap in record.get("gap", {}).values())
    lead = [describe_findings(record), describe_unnamed(record)]
    values = {
        "headline": glue(diagnosis_headline(record)),
        "first": glue(first_action(record)),
        "then": glue(second_action(record)),
        "lead": glue(" ".join(text for text in lead if text)),
        "telemetry": record.get("telemetry", []),
        "motion": glue(describe_motion(record)),
        "doubts": [glue(line) for line in describe_reservations(record)],
        "session": f"{runs}, {session.get('samples', 0):,} samples, {seconds} s",
        "gaps": gap_rows(record),
        "noise": describe_noise(record),
        "named": bool(record.get("findings")),
        "units": units_of(record),
        # The model untuned is the user's own where one was given.
        "untuned": "the model that was given" if given else "inertias of the URDF, friction tuned",
    }
    return Section("verdict", "Verdict", "diagnosis_verdict.html", values)


def numbers_section(record: Record) -> Section | None:
    """What the URDF says beside what was found, joint by joint."""
    rows = numbers.table_of(record)
    if not rows:
        return None
    names = {**numbers.LOSSES, **numbers.READINGS}
    columns = [(key, name, numbers.units_in(record, key)) for key, (name, _) in names.items()]
    told = record["verdict"] != "no_gap" and numbers.states_friction(record)
    values = {
        "words": numbers.describe_numbers(record) if told else "",
        "rows": rows,
        "named": bool(record.get("findings")),
        "columns": columns,
        "links": numbers.describe_links(record),
        "marks": numbers.describe_marks(record),
    }
    return Section("numbers", "Your URDF and your arm", "numbers.html", values)


def traces_section(traces: Traces | None) -> Section | None:
    """Measured against modelled torque over time."""
    if traces is None:
        return None
    from ident.show.report.traces import section_values

    values = section_values(traces, TRACES)
    return Section("traces", "Measured against model", "traces.html", values)


def gap_rows(record: Record) -> list[dict[str, Any]]:
    """Residual, ceiling and noise of every joint, with bars on one scale."""
    gaps = record.get("gap", {})
    heldout = record.get("heldout") or {}
    named = bool(record.get("findings"))
    after = heldout.get("rms_after_Nm", {}) if named else {}
    joules = heldout.get("energy_error_after_J") or {}
    spread = heldout.get("energy_error_after_std_J") or {}
    hidden = joints_tuned_away(record)
    sizes = [gap["rms_Nm"] for gap in gaps.values()]
    sizes += [gaps[joint].get("fixed_rms_Nm", 0.0) for joint in hidden if joint in gaps]
    rows = []
    for joint, gap in gaps.items():
        energy = gap.get("energy_error_J") or {}
        untuned = gap.get("model_rms_Nm", gap.get("fixed_rms_Nm"))
        places = row_places([gap["rms_Nm"], gap["noise_floor_Nm"]])
        # Else a fall from what tuning made worse would look like a gain.
        worse = untuned is not None and round(untuned, places) < round(gap["rms_Nm"], places)
        shown = {
            "rms": gap["rms_Nm"],
            "after": after.get(joint),
            "noise": gap["noise_floor_Nm"],
            "flexible": gap.get("ceiling_rms_Nm"),
            "untuned": untuned if worse or joint in hidden else None,
        }
        energy_after = DASH
        if named:
            energy_after = pair(joules.get(joint), _spread(record, spread.get(joint)))
        bars = {key: None if size is None else bar(size, sizes) for key, size in shown.items()}
        row = {
            "joint": joint,
            "places": places,
            "urdf": gap.get("urdf_rms_Nm"),
            "model": untuned,
            "energy": pair(energy.get("mean"), _spread(record, energy.get("std"))),
            "energy_after": energy_after,
            **shown,
            "bars": bars,
        }
        rows.append(row)
    return rows


def _spread(record: Record, std: float | None) -> float | None:
    """A spread over the runs; a single run has none."""
    return None if record.get("session", {}).get("runs", 0) < 2 else std


def findings_section(record: Record, pictures: Sequence[LawPicture | None] = ()) -> Section | None:
    """The named effects, a card each: how sure, how large, how far they shrink the gap, and their
    twins.
    """
    runs = record.get("session", {}).get("runs", 2)  # of a single run an energy error has no spread
    identities = map(id, record.get("findings", []))
    picture_of = dict(zip(identities, pictures, strict=False))
    cards = []
    for finding in in_order_of_joints(record):
        before = energy_pair(finding["heldout"], "before", runs)
        after = energy_pair(finding["heldout"], "after", runs)
        title = sentence(called(finding))
        order = order_of(finding, record)
        picture = picture_of.get(id(finding))
        cards.append((finding, title, order, f"{before} → {after} J", picture))
    if not cards:
        return None
    values = {"findings": cards, "record": record, "in_units_of": in_units_of}
    return Section("findings", "What causes it, and what to do", "findings.html", values)


def where_section(record: Record) -> Section | None:
    """The cells that matter in words, then the map: against the tuned model, and against it as it
    is.
    """
    if not record.get("where") and not record.get("maps"):
        return None
    places = from_start(record, "where")
    sure = [place for place in places if place["p_value"] <= USUAL_MAP.significant]
    sentences = []
    for place in sure[:MOST_SENTENCES]:
        words = describe_place(place)
        sentences.append(in_units_of([place["joint"]], record, words))
    values = {
        "sentences": sentences,
        "map": map_table(from_start(record, "maps"), record["joints"]),
        "fixed": map_table(from_start(record, "maps_fixed"), record["joints"]),
    }
    return Section("where", "Where the gap lies", "where.html", values)


def from_start(record: Record, key: str) -> list[dict[str, Any]]:
    """A record's cells or strips of the map; times on a clock since 1970 from the first sample
    on.
    """
    stamps = (record.get("provenance") or {}).get("sessions", [])
    firsts = [stamp["first"] for stamp in stamps if stamp.get("first") is not None]
    start = min(firsts, default=0.0)
    entries = [dict(entry) for entry in record.get(key, [])]
    if start < EPOCH_FROM:
        return entries
    for entry in entries:
        if entry["axis"] == "time":
            for end in ("low", "high", "edges"):
                if end in entry:
                    entry[end] = np.subtract(entry[end], start).tolist()
    return entries


def describe_place(place: Record) -> str:
    """A cell of the map in words."""
    axis = place["axis"]
    span = interval_words(axis, place["low"], place["high"])
    where = f"in moving {span}" if axis == "direction" else f"at {axis_name(axis)} {span}"
    text = f"{place['joint']}: {percent(place['share_of_gap'])} of its gap lies {where}"
    if place.get("share_of_time") is not None:
        share = percent(place["share_of_time"])
        of_noise = axis == "frequency"
        text += f", where {share} of the noise lies" if of_noise else f", in {share} of the time"
    return f"{text} (p = {significant(place['p_value'], 1)})."


def map_table(strips: Sequence[Record], joints: Sequence[str]) -> dict[str, Any]:
    """Rows of strips: a row a joint, a column an axis."""
    axes = list(dict.fromkeys(strip["axis"] for strip in strips))
    table = {(strip["joint"], strip["axis"]): strip for strip in strips}
    mapped = {strip["joint"] for strip in strips}
    rows = []
    for joint in joints:
        if joint in mapped:
            of_joint = [table.get((joint, axis)) for axis in axes]
            cells = [None if strip is None else _strip(strip) for strip in of_joint]
            rows.append({"joint": joint, "strips": cells})
    heads = [{"name": axis_name(axis), "unit": axis_unit(axis)} for axis in axes]
    return {"axes": heads, "rows": rows}


def _strip(strip: Record) -> dict[str, Any]:
    """Cells of one axis, with what a pointer over them tells."""
    axis = strip["axis"]
    edges = strip["edges"]
    columns = ("share_of_gap", "share_of_time", "energy_J", "p_value")
    rows = zip(*(strip[name] for name in columns), strict=True)
    cells = []
    for k, (gap, time, energy, p_value) in enumerate(rows):
        interval = interval_words(axis, edges[k], edges[k + 1])
        words = [f"{interval}: {percent(gap)} of the gap"]
        if energy is None:
            words.append(f"in {percent(time)} of the noise")
        else:
            words.append(f"in {percent(time)} of the time")
            words.append(f"{fixed(energy)} J")
        is_dense = p_value <= USUAL_MAP.significant and gap > time
        cell = {
            "shade": shade((gap / max(time, 1e-9) - 1.0) / (DENSEST - 1.0)),
            "sure": is_dense and says_where(axis, edges[k]),
            "share": percent(gap),
            "words": f"{', '.join(words)}, p = {significant(p_value, 1)}",
        }
        cells.append(cell)
    if axis == "direction":
        return {"cells": cells, "low": "−", "high": "+"}
    low = 0.0 if abs(edges[0]) < 1e-3 * abs(edges[-1]) else edges[0]
    return {"cells": cells, "low": significant(low), "high": significant(edges[-1])}


def outlook_section(record: Record) -> Section | None:
    """The next experiment first; then the effects that could not be tested."""
    if not any(record.get(key) for key in ("next_experiment", "not_testable", "detectable")):
        return None
    tied = any(len(finding["class"]) > 1 for finding in record.get("findings", []))
    values = {
        "tied": tied,
        "limits": limit_rows(record),
        "silent": silent_groups(record.get("not_testable", [])),
        "record": record,
        "in_units_of": in_units_of,
    }
    return Section("next", "What to record next", "outlook.html", values)


def render_comparison_report(record: Record) -> str:
    """The page as text: one sentence, then each change with what to do about it."""
    words, order = headline(record)
    values = {
        "record": record,
        "headline": words,
        "order": order,
        "places_of": places_of,
        "order_of": order_of,
        "in_units_of": in_units_of,
        "units": units_of(record),
        "spread": glue(describe_spread(record)),
        "notes": [glue(f"{sentence(line)}.") for line in describe_notes(record)],
        "silent": silent_groups(without_still(record)),
    }
    sections = [
        Section("verdict", "Verdict", "changes.html", values),
        telemetry_section(record["telemetry"]),
        facts_section(provenance_facts(record)),
    ]
    sides = [f"{name}: {describe_side(record[name])}" for name in ("before", "after")]
    subtitle = " · ".join([record["robot"], *sides, describe_known(record)])
    return render_page(f"What changed: {record['robot']}", sections, subtitle)
