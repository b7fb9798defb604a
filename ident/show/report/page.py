"""The page: sections in order, one template each, everything inline."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ident.diagnosis.settings import USUAL
from ident.errors import join_words, plural
from ident.files import atomic_write
from ident.model.hybrid import HybridModel
from ident.results import made_by
from ident.show import palette
from ident.show.report import words

# What templates colour with.
COLOURS = (
    "MEASURED",
    "NAMED",
    "NOISE",
    "RUNG_MEANINGS",
    "FLEXIBLE",
    "SKY",
    "TUNED",
    "UNTUNED",
    "model_colour",
    "rung_colours",
    "style_colours",
)
# Clocks beyond this count seconds since 1970: 2001-09-09 [s].
EPOCH_FROM = 1e9
# Sessions that are named under a title.
MOST_STAMPS = 4
UNKNOWN = "not recorded"
# What a page tells of a result's origin as it stands in its record.
PAST = ("command", "version", "commit", "units")
SEVERITIES = ("fatal", "warning", "note")
# An option of a command stays whole where a line ends: browsers would break behind each of its
# hyphens.
OPTION = re.compile(r"(?<!\S)--?[\w-]+")
WHOLE = r'<span class="whole">\g<0></span>'


@dataclass(frozen=True, eq=False)
class Section:
    """One section of a page."""

    anchor: str  # its address on the page
    title: str  # its heading
    template: str  # file name of its template
    values: Mapping[str, Any]  # what the template gets


def write_report(
    path: str | Path, title: str, sections: Sequence[Section | None], subtitle: str = ""
) -> Path:
    """Writes one self-contained HTML page, whole or not at all.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_page(title, sections, subtitle))


def save_page(path: str | Path, page: str) -> Path:
    """Writes a page's text, whole or not at all."""
    with atomic_write(Path(path)) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return Path(path)


def render_page(title: str, sections: Sequence[Section | None], subtitle: str = "") -> str:
    """The page as text."""
    environment = _make_environment()
    bodies = []
    for section in sections:
        if section is not None:
            template = environment.get_template(section.template)
            body = {
                "anchor": section.anchor,
                "title": section.title,
                "html": Markup(template.render(section.values)),
            }
            bodies.append(body)
    page = environment.get_template("page.html")
    return page.render(title=title, subtitle=subtitle, sections=bodies, made_by=made_by())


def _make_environment() -> Environment:
    """Where templates are found, and what they may call."""
    environment = Environment(
        loader=PackageLoader("ident.show.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
    )
    for name, value in vars(words).items():
        if getattr(value, "__module__", "") == words.__name__:
            environment.filters[name] = value
    environment.filters |= {
        "breakable": breakable,
        "coded": coded,
        "plural": plural,
        "join_words": join_words,
        "rung": palette.rung_name,
    }
    environment.globals |= {name: getattr(palette, name) for name in COLOURS}
    environment.globals["pairs"] = words.pairs
    return environment


def breakable(name: str) -> Markup:
    """A name that may break after its underscores: joint names are long, phones are narrow."""
    return Markup(escape(name).replace("_", Markup("_<wbr>")))


def coded(text: str) -> Markup:
    """A sentence with what stands between backticks as code: commands to be run as they stand."""
    parts = str(escape(text)).split("`")
    # A last backtick without its mate ends nothing.
    pairs = len(parts) // 2
    whole = []
    for k, words_between in enumerate(parts[: 2 * pairs + 1]):
        if k % 2:
            whole.append(f"<code>{OPTION.sub(WHOLE, words_between)}</code>")
        else:
            whole.append(words_between)
    return Markup("".join(whole))


def telemetry_section(issues: Sequence[Mapping[str, Any]]) -> Section:
    """A table of issues, the worst first."""
    ordered = sorted(issues, key=lambda issue: SEVERITIES.index(issue["severity"]))
    return Section("telemetry", "Telemetry", "telemetry.html", {"issues": ordered})


def facts_section(facts: Mapping[str, Any]) -> Section | None:
    """Names and values, nested ones flattened; folded, for those who need it."""
    if not facts:
        return None
    return Section("provenance", "Provenance", "facts.html", {"facts": list(_flat(facts))})


def models_section(models: Sequence[tuple[str, HybridModel]]) -> Section:
    """Where models come from: data, options, versions; one folded block a model."""
    told = []
    for name, model in models:
        past = model.provenance
        entry = {"name": name, "facts": _facts_of(model), "data": past.get("data", [])}
        told.append(entry)
    return Section("provenance", "Provenance", "provenance.html", {"models": told})


def _facts_of(model: HybridModel) -> list[tuple[str, str]]:
    """Where a model comes from, in names and words."""
    past = model.provenance
    runs = UNKNOWN
    if "samples" in past:
        runs = f"{plural(past['runs'], 'run')}, {past['samples']:,} samples"
    corner = f"{past['cutoff_hz']:g} Hz" if "cutoff_hz" in past else UNKNOWN
    options = ", ".join(f"{name} {value}" for name, value in past.get("options", {}).items())
    versions = ", ".join(f"{name} {number}" for name, number in past.get("versions", {}).items())
    facts = [
        ("robot", model.robot.name),
        ("URDF, SHA-256", model.robot.digest),
        ("options", options or UNKNOWN),
        ("fitted on", runs),
        ("low-pass", corner),
        ("numbers in the net", f"{past.get('net_parameters', 0):,}"),
        ("data, SHA-256 of all", past.get("data_sha256", UNKNOWN)),
        ("commit of the code", past.get("commit", UNKNOWN)),
        ("versions", versions),
    ]
    if past.get("accepted"):
        issues = past["accepted"]
        accepted = "; ".join(f"{issue['issue']} ({issue['evidence']})" for issue in issues)
        facts.insert(3, ("refusals overruled", accepted))
    return facts


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names in words with their values as text; what was not given is left out."""
    for name, value in values.items():
        words = f"{prefix}{_fact_name(name)}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{words}: ")
        elif isinstance(value, list | tuple):
            if value:
                yield words, ", ".join(map(_fact_text, value))
        elif value is not None:
            yield words, _fact_text(value)


def _fact_name(name: str) -> str:
    """A key as words; what has spaces is in words, or holds a path."""
    if " " in name:
        return name
    return str(words.TABLES["facts"].get(name, name.replace("_", " ")))


def _fact_text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def provenance_facts(record: Mapping[str, Any]) -> dict[str, Any]:
    """Where a result comes from, as its record tells it: command, version, sessions with their
    hashes, settings.
    """
    past = record.get("provenance") or {}
    facts: dict[str, Any] = {name: past[name] for name in PAST if past.get(name)}
    if past.get("engines"):
        facts["engines"] = ", ".join(f"{name} {number}" for name, number in past["engines"].items())
    for stamp in past.get("sessions", []):
        told = [session_dates(stamp), f"SHA-256 {stamp['sha256']}"]
        if stamp.get("content"):
            told.append(f"of its content {stamp['content']}")
        if stamp.get("scale"):
            told.append(f"torque's scale {stamp['scale']}")
        facts[f"session {stamp['path']}"] = "; ".join(told)
    settings = dict(past.get("settings", {}))
    if isinstance(settings.get("diagnosis"), Mapping):
        settings["diagnosis"] = _unusual(settings["diagnosis"], USUAL.to_dict())
        numbers = "as given, else as shipped" if settings["diagnosis"] else "as shipped"
        facts["numbers that decide"] = f"{numbers}; the result file (--json) holds them all"
    return {**facts, **settings}


def _unusual(values: Mapping[str, Any], usual: Mapping[str, Any]) -> dict[str, Any]:
    """Those of nested settings that are not as shipped: of a hundred numbers a reader wants the few
    that differ.
    """
    unusual: dict[str, Any] = {}
    for name, value in values.items():
        shipped = usual.get(name)
        if isinstance(value, Mapping) and isinstance(shipped, Mapping):
            inner = _unusual(value, shipped)
            if inner:
                unusual[name] = inner
        elif _plain(value) != _plain(shipped):
            unusual[name] = value
    return unusual


def _plain(value: Any) -> Any:
    """Rows of numbers alike, whether they came from JSON or not."""
    return list(value) if isinstance(value, tuple | list) else value


def describe_origin(record: Mapping[str, Any]) -> str:
    """One line under a page's title: sessions with their dates, amount, command and version."""
    past = record.get("provenance") or {}
    facts = record.get("session") or {}
    stamps = past.get("sessions", [])
    named = [(Path(stamp["path"]).name, session_dates(stamp)) for stamp in stamps[:MOST_STAMPS]]
    told = [record["robot"], *(f"{name} ({dates})" for name, dates in named)]
    if len(stamps) > MOST_STAMPS:
        told.append(f"{len(stamps) - MOST_STAMPS} more sessions")
    if facts:
        told.append(plural(facts["runs"], "run"))
        told.append(f"{facts['duration_s']:.0f} s")
    if past.get("command"):
        told.append(f"{past['command']}, armgap {past.get('version', '')}")
    return " · ".join(told)


def session_dates(stamp: Mapping[str, Any]) -> str:
    """When a session was recorded, where its clock tells the date; else its first and last time."""
    first = stamp.get("first")
    last = stamp.get("last")
    if first is None or last is None:
        return "no samples"
    if first < EPOCH_FROM:
        return f"{first:.1f} to {last:.1f} s on its own clock"
    days = [datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%d %H:%M") for time in (first, last)]
    return f"{days[0]} to {days[1]} UTC"
