"""The pages of a diagnosis and of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.diagnosis.gap.gap_map import says_where
from ident.diagnosis.gap.settings import USUAL_MAP
from ident.errors import plural
from ident.show.report import diagnosis_verdict as verdict
from ident.show.report import numbers
from ident.show.report.evaluation import ReportInput, evaluation_sections
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
    describe_spread,
    headline,
    limit_rows,
    places_of,
    silent_groups,
    without_still,
)

if TYPE_CHECKING:
    from ident.show.report.laws import LawPicture
    from ident.show.report.traces import Traces

MOST_SENTENCES = 5
TRACES = (
    "Torque as it was measured and as three models have it, on runs that the tuned models were not fitted to. "
    "Below: what each model is off by. Where a joint rests or turns round no model is judged."
)
# A cell this many times as dense as the mean has the strongest colour.
DENSEST = 3.0


def write_diagnosis_report(
    path: str | Path,
    record: Mapping[str, Any],
    evaluation: ReportInput | None = None,
    pictures: Sequence[LawPicture | None] = (),
    traces: Traces | None = None,
) -> Path:
    """Writes the page of a diagnosis, whole or not at all; arguments as for `render_diagnosis_report`.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_diagnosis_report(record, evaluation, pictures, traces))


def render_diagnosis_report(
    record: Mapping[str, Any],
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
        sections += [one for one in evaluation_sections(evaluation) if one is not None and one.anchor not in shown]
    title = f"{record['robot']}: why does the arm not move as its model says?"
    return render_page(title, sections, describe_origin(record))


def verdict_section(record: Mapping[str, Any]) -> Section:
    """Verdict, what to make of it, and the gap joint by joint."""
    session = record.get("session", {})
    own = any("model_rms_Nm" in gap for gap in record.get("gap", {}).values())
    values = {
        "headline": glue(verdict.diagnosis_headline(record)),
        "first": glue(verdict.first_action(record)),
        "lead": glue(" ".join(filter(None, (verdict.describe_findings(record), verdict.describe_unnamed(record))))),
        "telemetry": record.get("telemetry", []),
        "motion": glue(verdict.describe_motion(record)),
        "doubts": [glue(line) for line in verdict.describe_reservations(record)],
        "session": f"{plural(session.get('runs', 0), 'run')}, {session.get('samples', 0):,} samples, "
        f"{fixed(session.get('duration_s', 0.0), 0)} s",
        "gaps": gap_rows(record),
        "noise": verdict.describe_noise(record),
        "named": bool(record.get("findings")),
        "units": verdict.units_of(record),
        # The model untuned is the user's own where one was given.
        "untuned": "the model that was given" if own else "inertias of the URDF, friction tuned",
    }
    return Section("verdict", "Verdict", "diagnosis_verdict.html", values)


def numbers_section(record: Mapping[str, Any]) -> Section | None:
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

    return Section("traces", "Measured against model", "traces.html", section_values(traces, TRACES))


def gap_rows(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Residual, ceiling and noise of every joint, with bars on one scale."""
    gaps, heldout, named = record.get("gap", {}), record.get("heldout") or {}, bool(record.get("findings"))
    after = heldout.get("rms_after_Nm", {}) if named else {}
    joules, spread = (heldout.get(f"energy_error_after_{what}") or {} for what in ("J", "std_J"))
    hidden = verdict.joints_tuned_away(record)
    sizes = [gap["rms_Nm"] for gap in gaps.values()]
    sizes += [gaps[joint].get("fixed_rms_Nm", 0.0) for joint in hidden if joint in gaps]
    rows = []
    for joint, gap in gaps.items():
        energy = gap.get("energy_error_J") or {}
        shown = {
            "rms": gap["rms_Nm"],
            "after": after.get(joint),
            "noise": gap["noise_floor_Nm"],
        }
        shown["flexible"] = gap.get("ceiling_rms_Nm")
        untuned = gap.get("model_rms_Nm", gap.get("fixed_rms_Nm"))
        places = row_places([gap["rms_Nm"], gap["noise_floor_Nm"]])
        # Else a fall from what tuning made worse would look like a gain.
        worse = untuned is not None and round(untuned, places) < round(gap["rms_Nm"], places)
        shown["untuned"] = untuned if worse or joint in hidden else None
        rows.append(
            {
                "joint": joint,
                "places": places,
                "urdf": gap.get("urdf_rms_Nm"),
                "model": untuned,
                "energy": pair(energy.get("mean"), _spread(record, energy.get("std"))),
                "energy_after": pair(joules.get(joint), _spread(record, spread.get(joint))) if named else DASH,
                **shown,
                "bars": {key: None if value is None else bar(value, sizes) for key, value in shown.items()},
            }
        )
    return rows


def _spread(record: Mapping[str, Any], std: float | None) -> float | None:
    """A spread over the runs; a single run has none."""
    return None if record.get("session", {}).get("runs", 0) < 2 else std


def findings_section(record: Mapping[str, Any], pictures: Sequence[LawPicture | None] = ()) -> Section | None:
    """The named effects, a card each: how sure, how large, how far they shrink the gap, and their twins."""
    runs = record.get("session", {}).get("runs", 2)  # of a single run an energy error has no spread
    picture_of, cards = dict(zip(map(id, record.get("findings", [])), pictures, strict=False)), []
    for one in verdict.in_order_of_joints(record):
        before, after = (verdict.energy_pair(one["heldout"], when, runs) for when in ("before", "after"))
        title, order = sentence(verdict.called(one)), verdict.order_of(one, record)
        cards.append((one, title, order, f"{before} → {after} J", picture_of.get(id(one))))
    title, values = (
        "What causes it, and what to do",
        {"findings": cards, "record": record, "in_units_of": verdict.in_units_of},
    )
    return Section("findings", title, "findings.html", values) if cards else None


def where_section(record: Mapping[str, Any]) -> Section | None:
    """The cells that matter in words, then the map: against the tuned model, and against it as it is."""
    if not record.get("where") and not record.get("maps"):
        return None
    places, maps, untuned = (from_start(record, key) for key in ("where", "maps", "maps_fixed"))
    places = [one for one in places if one["p_value"] <= USUAL_MAP.significant]
    values = {
        "sentences": [
            verdict.in_units_of([one["joint"]], record, describe_place(one)) for one in places[:MOST_SENTENCES]
        ],
        "map": map_table(maps, record["joints"]),
        "fixed": map_table(untuned, record["joints"]),
    }
    return Section("where", "Where the gap lies", "where.html", values)


def from_start(record: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """A record's cells or strips of the map; times on a clock since 1970 from the first sample on."""
    stamps = (record.get("provenance") or {}).get("sessions", [])
    start = min((stamp["first"] for stamp in stamps if stamp.get("first") is not None), default=0.0)
    shift = start if start >= EPOCH_FROM else 0.0
    found = [dict(one) for one in record.get(key, [])]
    for one in found if shift else ():
        if one["axis"] == "time":
            one |= {end: np.subtract(one[end], shift).tolist() for end in ("low", "high", "edges") if end in one}
    return found


def describe_place(place: Mapping[str, Any]) -> str:
    """A cell of the map in words."""
    where = interval_words(place["axis"], place["low"], place["high"])
    where = f"in moving {where}" if place["axis"] == "direction" else f"at {axis_name(place['axis'])} {where}"
    text = f"{place['joint']}: {percent(place['share_of_gap'])} of its gap lies {where}"
    if place.get("share_of_time") is not None:
        share = percent(place["share_of_time"])
        of_noise = place["axis"] == "frequency"
        text += f", where {share} of the noise lies" if of_noise else f", in {share} of the time"
    return f"{text} (p = {significant(place['p_value'], 1)})."


def map_table(strips: Sequence[Mapping[str, Any]], joints: Sequence[str]) -> dict[str, Any]:
    """Rows of strips: a row a joint, a column an axis."""
    axes = list(dict.fromkeys(strip["axis"] for strip in strips))
    table = {(strip["joint"], strip["axis"]): strip for strip in strips}
    shown = [joint for joint in joints if any(joint == own for own, _ in table)]
    rows = [{"joint": j, "strips": [_strip(table[j, a]) if (j, a) in table else None for a in axes]} for j in shown]
    return {"axes": [{"name": axis_name(axis), "unit": axis_unit(axis)} for axis in axes], "rows": rows}


def _strip(strip: Mapping[str, Any]) -> dict[str, Any]:
    """Cells of one axis, with what a pointer over them tells."""
    edges = strip["edges"]
    columns = ("share_of_gap", "share_of_time", "energy_J", "p_value")
    cells = []
    for k, (gap, time, energy, p_value) in enumerate(zip(*(strip[name] for name in columns), strict=True)):
        words = [f"{interval_words(strip['axis'], edges[k], edges[k + 1])}: {percent(gap)} of the gap"]
        words += [f"in {percent(time)} of the {'noise' if energy is None else 'time'}"]
        words += [] if energy is None else [f"{fixed(energy)} J"]
        cells.append(
            {
                "shade": shade((gap / max(time, 1e-9) - 1.0) / (DENSEST - 1.0)),
                "sure": p_value <= USUAL_MAP.significant and gap > time and says_where(strip["axis"], edges[k]),
                "share": percent(gap),
                "words": f"{', '.join(words)}, p = {significant(p_value, 1)}",
            }
        )
    low = 0.0 if abs(edges[0]) < 1e-3 * abs(edges[-1]) else edges[0]
    ends = ("−", "+") if strip["axis"] == "direction" else (significant(low), significant(edges[-1]))
    return {"cells": cells, "low": ends[0], "high": ends[1]}


def outlook_section(record: Mapping[str, Any]) -> Section | None:
    """The next experiment first; then the effects that could not be tested."""
    if not any(record.get(key) for key in ("next_experiment", "not_testable", "detectable")):
        return None
    tied = any(len(finding["class"]) > 1 for finding in record.get("findings", []))
    values = {"tied": tied, "limits": limit_rows(record), "silent": silent_groups(record.get("not_testable", []))}
    values |= {"record": record, "in_units_of": verdict.in_units_of}
    return Section("next", "What to record next", "outlook.html", values)


def render_comparison_report(record: Mapping[str, Any]) -> str:
    """The page as text: one sentence, then each change with what to do about it."""
    words, order = headline(record)
    values = {
        "record": record,
        "headline": words,
        "order": order,
        "places_of": places_of,
        "order_of": verdict.order_of,
        "in_units_of": verdict.in_units_of,
        "units": verdict.units_of(record),
        "spread": describe_spread(record),
        "notes": [f"{sentence(line)}." for line in describe_notes(record)],
        "silent": silent_groups(without_still(record)),
    }
    sections = [
        Section("verdict", "Verdict", "changes.html", values),
        telemetry_section(record["telemetry"]),
        facts_section(provenance_facts(record)),
    ]
    sides = [
        f"{name}: {', '.join(record[name]['sessions'][:4])}{' …' if len(record[name]['sessions']) > 4 else ''} "
        f"({plural(record[name]['runs'], 'run')}, {record[name]['duration_s']:.0f} s)"
        for name in ("before", "after")
    ]
    origin = " · ".join([record["robot"], *sides, describe_known(record)])
    return render_page(f"What changed: {record['robot']}", sections, origin)
