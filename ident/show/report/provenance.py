"""Where the numbers come from: data, options, versions. Folded, for those who need it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar

from ident.diagnosis.settings import USUAL
from ident.errors import plural
from ident.model.hybrid import HybridModel
from ident.show.report.page import Section

# Clocks beyond this count seconds since 1970: 2001-09-09 [s].
EPOCH_FROM = 1e9
# Sessions that are named under a title.
MOST_STAMPS = 4
UNKNOWN = "not recorded"


@dataclass(frozen=True, eq=False)
class ProvenanceSection(Section):
    """One folded block a model."""

    models: Sequence[tuple[str, HybridModel]]
    anchor: ClassVar[str] = "provenance"
    title: ClassVar[str] = "Provenance"
    template: ClassVar[str] = "provenance.html"

    @property
    def is_present(self) -> bool:
        return bool(self.models)

    def context(self) -> dict[str, Any]:
        return {"models": [{"name": name, **_facts(model)} for name, model in self.models]}


def _facts(model: HybridModel) -> dict[str, Any]:
    past = model.provenance
    options = ", ".join(f"{name} {value}" for name, value in past.get("options", {}).items())
    facts = [
        ("robot", model.robot.name),
        ("URDF, SHA-256", model.robot.digest),
        ("options", options or UNKNOWN),
        (
            "fitted on",
            f"{plural(past['runs'], 'run')}, {past['samples']:,} samples" if "samples" in past else UNKNOWN,
        ),
        ("low-pass", f"{past['cutoff_hz']:g} Hz" if "cutoff_hz" in past else UNKNOWN),
        ("numbers in the net", f"{past.get('net_parameters', 0):,}"),
        ("data, SHA-256 of all", past.get("data_sha256", UNKNOWN)),
        ("versions", ", ".join(f"{name} {number}" for name, number in past.get("versions", {}).items())),
    ]
    if past.get("accepted"):
        told = "; ".join(f"{issue['issue']} ({issue['evidence']})" for issue in past["accepted"])
        facts.insert(3, ("refusals overruled", told))
    return {"facts": facts, "data": past.get("data", [])}


@dataclass(frozen=True, eq=False)
class FactsSection(Section):
    """Names and values, nested ones flattened."""

    facts: Mapping[str, Any]
    anchor: ClassVar[str] = "provenance"
    title: ClassVar[str] = "Provenance"
    template: ClassVar[str] = "facts.html"

    @property
    def is_present(self) -> bool:
        return bool(self.facts)

    def context(self) -> dict[str, Any]:
        return {"facts": list(_flat(self.facts))}


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        words = f"{prefix}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{words}: ")
        else:
            yield words, str(value)


def provenance_facts(record: Mapping[str, Any]) -> dict[str, Any]:
    """Where a result comes from, as its record tells it: command, version, sessions with their hashes, settings."""
    past = record.get("provenance") or {}
    facts: dict[str, Any] = {name: past[name] for name in ("command", "version") if past.get(name)}
    for stamp in past.get("sessions", []):
        facts[f"session {stamp['path']}"] = f"{session_dates(stamp)}; SHA-256 {stamp['sha256']}"
    settings = dict(past.get("settings", {}))
    if isinstance(settings.get("diagnosis"), Mapping):
        settings["diagnosis"] = _unusual(settings["diagnosis"], USUAL.to_dict())
        numbers = "numbers that decide"
        facts[numbers] = "as given, else as shipped" if settings["diagnosis"] else "as shipped"
        facts[numbers] += "; the result file (--json) holds them all"
    return {**facts, **settings}


def _unusual(values: Mapping[str, Any], usual: Mapping[str, Any]) -> dict[str, Any]:
    """Those of nested settings that are not as shipped: of a hundred numbers a reader wants the few that differ."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        shipped = usual.get(name)
        if isinstance(value, Mapping) and isinstance(shipped, Mapping):
            found |= {name: part} if (part := _unusual(value, shipped)) else {}
        elif _plain(value) != _plain(shipped):
            found[name] = value
    return found


def _plain(value: Any) -> Any:
    """Rows of numbers alike, whether they came from JSON or not."""
    return list(value) if isinstance(value, tuple | list) else value


def describe_origin(record: Mapping[str, Any]) -> str:
    """One line under a page's title: sessions with their dates, amount, command and version."""
    past, facts = record.get("provenance") or {}, record.get("session") or {}
    stamps = past.get("sessions", [])
    names = [f"{Path(stamp['path']).name} ({session_dates(stamp)})" for stamp in stamps[:MOST_STAMPS]]
    names += [f"{len(stamps) - MOST_STAMPS} more sessions"] if len(stamps) > MOST_STAMPS else []
    amount = [plural(facts["runs"], "run"), f"{facts['duration_s']:.0f} s"] if facts else []
    made = [f"{past.get('command', '')}, armgap {past.get('version', '')}"] if past.get("command") else []
    return " · ".join([record["robot"], *names, *amount, *made])


def session_dates(stamp: Mapping[str, Any]) -> str:
    """When a session was recorded, where its clock tells the date; else its first and last time."""
    first, last = stamp.get("first"), stamp.get("last")
    if first is None or last is None:
        return "no samples"
    if first < EPOCH_FROM:
        return f"{first:.1f} to {last:.1f} s on its own clock"
    days = [datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%d %H:%M") for time in (first, last)]
    return f"{days[0]} to {days[1]} UTC"
