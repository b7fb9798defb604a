"""The page of a check, a page of each diagnosis that was confidently wrong, and the check in words and as a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from ident.benchmark.summary import EDIT_WITHIN, NUMBERS, TEXT, WORDS, BlindReport
from ident.errors import plural
from ident.show.palette import FLEXIBLE
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.page import Section, confusion_section, facts_section, write_report
from ident.show.report.words import DASH, effect_name, fixed, parameter_name, percent
from ident.show.results import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_NAME, WRONG_FOLDER = "index.html", "wrong"
COMPARED = ("strict", "joint", "false_alarm", "false_alarm_decoy", "refusal")
OF_SIZES = ("strict", "class_aware", "joint", "unnamed")
OF_WORLDS = ("strict", "class_aware", "joint", "companion", "false_alarm", "told_gap")


def write_blind_pages(report: BlindReport, diagnoses: Mapping[str, Mapping[str, Any] | None], out: Path) -> Path:
    """Writes the page, and below it the diagnoses of cases that were confidently wrong."""
    for one in report.confidently_wrong:
        if (diagnosed := diagnoses.get(one.name)) is not None:
            write_diagnosis_report(out / WRONG_FOLDER / f"{one.name}.html", diagnosed)
    record = report.to_dict()
    subtitle = f"{report.robot} · {plural(record['cases'], 'case')} · seed {report.seed}"
    rows = []  # cases with a confident name that is not true, each with a link to its diagnosis
    for one in report.confidently_wrong:
        named = [f"{effect_name(e)} at {', '.join(j)} ({percent(p)})" for e, j, p in one.named]
        true = [f"{effect_name(e)} at {j}" if j else effect_name(e) for e, j in one.truth]
        size = f"{one.amplitude:g}x, {'rich' if one.rich else 'poor'}" if one.truth else one.kind
        link = (f"{WRONG_FOLDER}/{one.name}.html", one.name)
        rows.append([link, f"{one.kind}, {size}", "; ".join(true) or "nothing", "; ".join(named)])
    sections = [
        *_tables(record),
        _table("wrong", "Wrong, and sure of it", "case|#kind|#true|#told", rows),
        Section("seals", "Seals", "blind_seals.html", {"seals": list(report.seals.items())}),
        facts_section(report.run),
    ]
    return write_report(out / PAGE_NAME, "Does the diagnosis find what was hidden?", sections, subtitle)


def _tables(record: Mapping[str, Any]) -> Iterator[Section | None]:
    """The tables of a check, the scores first."""
    scores, counts = record["scores"], record["counts"]
    headline = (
        f"{percent(scores['class_aware'])} of {plural(counts['class_aware'], 'visible effect')} found; "
        f"{percent(scores['false_alarm'])} of {plural(counts['false_alarm'], 'healthy session')} with a false alarm."
    )
    failed = record["failed"]
    alarm = f"In {plural(failed, 'case')} the diagnosis failed. They count as not named." if failed else ""
    ends, known = record["intervals"], [name for name in scores if name in counts]
    keys = ("value", "low", "high", "count")
    whole = {name: dict(zip(keys, (scores[name], *ends[name], counts[name]), strict=True)) for name in known}
    rows = [_cells(text, whole[name]) for name, text in TEXT["shares"].items()]
    rows += [_cells(text, whole[name], fixed) for name, text in TEXT["means"].items()]
    yield _table("scores", "Scores", "score|value|interval|of", rows, headline, alarm)

    rows = [
        [cell, own["strict"]["count"], *(percent(own[name]["value"]) for name in OF_SIZES)]
        + [fixed(own[name]["value"]) for name in ("mean_class_size", "extra_names")]
        for cell, own in record["strata"].items()
    ]
    columns = "size, motion|cases|named|classed|joint|no name|class size|names too many"
    yield _table("sizes", "Small and large, rich and poor motion", columns, rows)

    alarm, axes = "", {**NUMBERS, **WORDS}
    if worst := record["worst_stratum"]:
        axis, _, place = worst["world"].partition(" ")
        alarm = f"Worst: {axes[axis]} {place}, {percent(worst['strict'])} named."
    rows = []
    for axis, one in ((axis, one) for axis, strata in record["worlds"].items() for one in strata):
        place = one.get("value")  # a stratum's word, or its bounds
        if place is None:
            low, high = (f"{end:.0f}" if end >= 100.0 else f"{end:.2g}" for end in (one["low"], one["high"]))
            place = low if low == high else f"{low} to {high}"
        rows.append([axes[axis], str(place), one["cases"], *(percent(one[name]) for name in OF_WORLDS)])
    columns = "property|from, to|cases|named|classed|joint|false beside|false alarms|told a gap"
    yield _table("worlds", "In which worlds does it hold?", columns, rows, alarm=alarm)
    yield confusion_section(record["confusion"])

    methods = {"this diagnosis": scores} if record["baselines"] else {}
    methods |= {TEXT["baselines"].get(name, name): own for name, own in record["baselines"].items()}
    rows = [[name, *(percent(own[score]) for score in COMPARED), fixed(own["set_f1"])] for name, own in methods.items()]
    columns = "method|named|joint|false alarms|of decoys|refused|F1 of sets"
    yield _table("baselines", "Beside a plain method", columns, rows)

    rows = [_cells(fixed(one["said"]), one["right"]) for one in record["calibration"]]
    title = "Is a probability of 0.9 right nine times in ten?"
    yield _table("calibration", title, "probability|right|interval|of", rows)

    rows = []
    for name, score in record["coverage"].items():
        effect, parameter = name.split(".", 1)
        words, unit = parameter_name(parameter)
        rows.append([effect_name(effect), *_cells(f"{words} [{unit}]" if unit else words, score)])
    yield _table("coverage", "Are the intervals honest?", "effect|#parameter|inside|interval|of", rows)

    rows = [
        [effect_name(effect), one["cases"], *map(fixed, one["median"].values()), percent(one["within"]["value"])]
        for effect, one in record.get("edits", {}).items()
    ]
    columns = "effect|cases|cause taken out|tuned, nothing named|cause left in|passed"
    yield _table("edits", "Take the cause out again: is the arm left?", columns, rows)


def _table(
    anchor: str, title: str, columns: str, rows: Sequence[Sequence[Any]], headline: str = "", alarm: str = ""
) -> Section | None:
    """Words and a table of a check; left out where there is no row.

    A heading that begins with "#" is over text; a row's first cell is its heading, a pair of it a link and its words.
    """
    names, lead = columns.split("|"), TEXT["leads"].get(anchor, "").format(edit_within=f"{EDIT_WITHIN:g}")
    values: dict[str, Any] = {"title": title, "lead": lead, "rows": rows, "headline": headline, "alarm": alarm}
    values |= {"columns": [name.lstrip("#") for name in names], "text": [name.startswith("#") for name in names]}
    return Section(anchor, title, "blind_table.html", values) if rows else None


def _cells(text: str, score: Mapping[str, Any], written: Callable[[float | None], str] = percent) -> list[str]:
    """A row of a score: its words, value, interval and number of cases."""
    span = DASH if score["low"] is None else f"{written(score['low'])} to {written(score['high'])}"
    return [text, written(score["value"]), span, str(score["count"])]


def write(console: Console, report: BlindReport) -> None:
    """Prints every score with its 95 % interval, a line each; efficiency by size, the worst worlds."""
    record = report.to_dict()
    lines = []
    for name, value in record["scores"].items():
        if isinstance(value, dict):
            sizes = ", ".join(f"{size}x {one if one is None else round(one, 3)}" for size, one in value.items())
            lines += [f"  {name}: {sizes}"] if sizes else []
            continue
        low, high = record["intervals"].get(name, (None, None))
        interval = f" [{low:.2f}, {high:.2f}]" if low is not None and high is not None else ""
        lines.append(f"  {name}: {value if value is None else round(value, 3)}{interval}")
    if again := record["run"].get("drawn_again"):
        lines.append(f"  drawn again, a size out of reach or an arm that diverged: {plural(again, 'case')}")
    if record["worst_stratum"] is not None:
        worst = record["worst_stratum"]
        lines.append(f"  worst stratum: {worst['world']}: strict {worst['strict']:.2f} of {worst['cases']}")
    console.print("\n".join(lines), highlight=False, soft_wrap=True)


def draw(report: BlindReport) -> Figure:
    """The scores that are shares."""
    shares = {name: score.value for name, score in report.scores.items() if name != "seconds_per_case"}
    rows = {f"{len(report.outcomes)} cases": (FLEXIBLE, list(shares.values()))}
    return draw_bars(list(shares), rows, "share", f"withheld effects, seed {report.seed}")
