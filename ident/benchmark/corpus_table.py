"""What was found in a corpus as one table: a row a candidate, and a row a session.

A result is one JSON a case: `case`, `verdict`, `seconds`, `peak_mb`, `candidates`, each with its
`features`, and `diagnosis`, whose findings are rows of their own (`source` tells which).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus import Entry, read_index
from ident.benchmark.corpus_run import result_path
from ident.benchmark.labels import (
    RIGHT,
    UNKNOWN,
    WRONG,
    Name,
    is_strict,
    matching,
    measured_on,
    overlap,
    says,
)
from ident.benchmark.scores import is_inside
from ident.errors import InputError
from ident.files import atomic_write
from ident.records import JsonRecord, JsonTable, as_json

CANDIDATE = "candidate"
FINDING = "finding"
"""Sources of rows: what was weighed, and what was reported."""
CANDIDATES_FILE = "candidates.parquet"
SESSIONS_FILE = "sessions.parquet"
FEATURE = "feature."  # before a feature's name in the table
TELLING = ("named", "partial", "none_of_catalogue", "changed")
"""Verdicts that tell a gap."""
REAL = ("real", "kept")
# Other sessions of an arm that have to have a name for it to be the arm's own: one may be chance.
AGAIN = 2
Row = JsonRecord


@dataclass(frozen=True)
class SessionRow:
    """One session, and what became of it."""

    case: str
    group: str
    kind: str
    arm: str
    world: str
    control: str
    verdict: str
    told_gap: bool
    error: str
    seconds: float | None  # of the processor
    peak_mb: float | None
    truths: tuple[Row, ...]  # effect, joint, asked size of each
    length: float = 0.0  # to which it was cut [s]; 0 where it is whole

    @property
    def unit(self) -> str:
        """What is left out whole: a real arm, a drawn world, an arm of another simulator."""
        return f"{self.group}:{self.world if self.group == 'worlds' else self.arm}"


@dataclass(frozen=True, eq=False)
class Table:
    """All rows of one source, with the sessions that they are of."""

    source: str  # CANDIDATE or FINDING
    sessions: dict[str, SessionRow]
    # case, effect, joint, places, members, named, probability, matched, strict, known, intervals
    rows: list[Row]
    names: list[Name]
    features: dict[str, Float[Array, " N"]]  # by name; what a row does not say is not a number

    @property
    def probability(self) -> Float[Array, " N"]:
        """Probability of each row as it was stored, 0 to 1; NaN where none was."""
        values = [np.nan if row["probability"] is None else row["probability"] for row in self.rows]
        return np.array(values, dtype=float)

    @property
    def named(self) -> Bool[Array, " N"]:
        """Whether each row was named."""
        return np.array([row["named"] for row in self.rows], dtype=bool)

    @property
    def cases(self) -> Array:
        """Case of each row, N texts."""
        return np.array([row["case"] for row in self.rows], dtype=object)

    @property
    def units(self) -> Array:
        """What each row is left out with (`SessionRow.unit`), N texts."""
        return np.array([self.sessions[row["case"]].unit for row in self.rows], dtype=object)

    @property
    def groups(self) -> Array:
        """Group of the corpus that each row's session is of, N texts."""
        return np.array([self.sessions[row["case"]].group for row in self.rows], dtype=object)

    def matrix(self, names: Sequence[str]) -> Float[Array, "N k"]:
        """Some features, a column each.

        Raises:
            InputError: The table lacks one.
        """
        missing = [name for name in names if name not in self.features]
        if missing:
            raise InputError(
                "features",
                f"the table has no {missing[0]!r}",
                f"choose from: {', '.join(self.features)}",
            )
        columns = [self.features[name] for name in names]
        return np.column_stack(columns) if columns else np.zeros((len(self.rows), 0))

    def _names_of_arms(self, known_names: Bool[Array, " N"]) -> dict[str, dict[str, list[Name]]]:
        """By real arm and case what was named there and not put there."""
        of_arm: dict[str, dict[str, list[Name]]] = {}
        for row, name, is_known in zip(self.rows, self.names, known_names, strict=True):
            session = self.sessions[row["case"]]
            if is_known and row["matched"] < 0 and session.group in REAL:
                of_arm.setdefault(session.arm, {}).setdefault(row["case"], []).append(name)
        return of_arm

    def _is_the_arms_own(self, case: str, name: Name, named: Mapping[str, Sequence[Name]]) -> bool:
        """Whether other sessions of a real arm, in which other things were put, have a name as
        well.
        """
        others = 0
        for other, names in named.items():
            if other != case and any(overlap(name, known) for known in names):
                others += 1
        return others >= AGAIN

    def labels(self, known_names: Bool[Array, " N"]) -> Array:
        """Right, wrong or unknown of each row.

        Args:
            known_names: Rows that count as named where they are of an untouched recording: what
            such a recording of
                the same arm has as well is no news.
        """
        by_case: dict[str, list[Name]] = {}
        for row, name, is_known in zip(self.rows, self.names, known_names, strict=True):
            if is_known and self.sessions[row["case"]].kind == "control":
                by_case.setdefault(row["case"], []).append(name)
        of_arm = self._names_of_arms(known_names)
        labels: list[str] = []
        for row, name in zip(self.rows, self.names, strict=True):
            session = self.sessions[row["case"]]
            owned = by_case.get(row["case"] if session.kind == "control" else session.control, [])
            if session.group in REAL and self._is_the_arms_own(
                row["case"], name, of_arm.get(session.arm, {})
            ):
                owned = [*owned, name]
            if row["matched"] >= 0:
                labels.append(RIGHT)
            elif row["known"] or any(overlap(name, other) for other in owned):
                labels.append(UNKNOWN)
            else:
                labels.append(WRONG)
        return np.array(labels, dtype=object)


# Writing


def store(entries: Iterable[Entry], results: Path, out: Path) -> tuple[int, int]:
    """Reads the results of all sessions that have one and writes the table.

    Returns:
        Numbers of sessions and of rows.

    Raises:
        InputError: There is no result of any of them.
    """
    sessions: list[Row] = []
    rows: list[Row] = []
    for entry in entries:
        path = result_path(results, entry.case)
        if path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            sessions.append(session_row(entry, record))
            rows += candidate_rows(entry, record)
    if not sessions:
        raise InputError(
            results, "holds no result of a session of the corpus", "diagnose the corpus first"
        )
    names = sorted({name for row in rows for name in row["features"]})
    for row in rows:
        features = row.pop("features")
        row.update({FEATURE + name: features.get(name) for name in names})
    _write_rows(out / SESSIONS_FILE, sessions)
    _write_rows(out / CANDIDATES_FILE, rows)
    return len(sessions), len(rows)


def _write_rows(path: Path, rows: Sequence[Row]) -> None:
    with atomic_write(path) as temporary:
        pq.write_table(pa.Table.from_pylist(list(rows)), temporary, compression="zstd")


def session_row(entry: Entry, record: JsonTable) -> Row:
    """What became of a session."""
    verdict = str(record.get("verdict") or record.get("diagnosis", {}).get("verdict") or "error")
    truths = [
        {
            "effect": truth.effect,
            "joint": truth.joints[0] if truth.joints else "",
            "asked": truth.asked,
        }
        for truth in entry.truth
    ]
    return {
        "case": entry.case,
        "group": entry.group,
        "kind": entry.kind,
        "arm": entry.arm,
        "world": entry.world,
        "control": entry.control,
        "verdict": verdict,
        "told_gap": verdict in TELLING and "error" not in record,
        "error": str(record.get("error", "")),
        "seconds": _number(record.get("seconds")),
        "peak_mb": _number(record.get("peak_mb")),
        "truths": as_json(truths, None),
        "length": entry.seconds,
    }


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def candidate_rows(entry: Entry, record: JsonTable) -> list[Row]:
    """A row for each candidate, and one for each finding of the diagnosis.

    Args:
        entry: The session.
        record: What was stored of its diagnosis.

    Returns:
        Rows of the candidates, then of the findings, told apart by "source".
    """
    measured = measured_on(entry)
    rows: list[Row] = []
    for candidate in record.get("candidates", ()):
        row = _row(entry, Name.of_candidate(candidate), candidate.get("parameters"), measured)
        row["source"] = CANDIDATE
        row["named"] = bool(candidate.get("named", False))
        row["probability"] = _number(candidate.get("probability"))
        row["features"] = {
            name: _number(value) for name, value in candidate.get("features", {}).items()
        }
        rows.append(row)
    for finding in record.get("diagnosis", {}).get("findings", ()):
        row = _row(entry, Name.of_finding(finding), finding.get("parameters"), measured)
        row["source"] = FINDING
        row["named"] = True
        row["probability"] = _number(
            finding.get("class_probability", finding.get("probability", 1.0))
        )
        row["features"] = {}
        rows.append(row)
    return rows


def _row(entry: Entry, name: Name, parameters: JsonTable | None, measured: Sequence[Any]) -> Row:
    number = matching(name, entry.truth)
    truth = None if number is None else entry.truth[number]
    strict = truth is not None and is_strict(name, truth)
    intervals = (
        intervals_of(parameters or {}, truth.parameters) if truth is not None and strict else []
    )
    return {
        "case": entry.case,
        "effect": name.effect,
        "joint": name.joint,
        "places": sorted(name.places),
        "members": sorted(f"{effect}:{joint}" for effect, joint in name.members),
        "matched": -1 if number is None else number,
        "strict": strict,
        "known": name.effect in entry.excused or any(says(name, cause) for cause in measured),
        "intervals": as_json(intervals, None),
    }


def intervals_of(parameters: JsonTable, true: JsonTable) -> list[Row]:
    """What was reported of parameters whose truth is known.

    Returns:
        Rows of "parameter", "true", "value", "low", "high" and "inside".
    """
    reported: list[Row] = []
    for key, value in true.items():
        given = parameters.get(key)
        if isinstance(value, str) or key == "order" or not isinstance(given, Mapping):
            continue
        ends = [_number(given.get(word)) for word in ("value", "low", "high")]
        if None in ends:
            continue
        estimate, low, high = (float(end) for end in ends if end is not None)
        inside = is_inside(key, float(value), low, high)
        reported.append(
            {
                "parameter": key,
                "true": float(value),
                "value": estimate,
                "low": low,
                "high": high,
                "inside": inside,
            }
        )
    return reported


# Reading


def load_table(folder: Path, source: str = CANDIDATE) -> Table:
    """The stored rows of one source.

    Raises:
        InputError: No table there.
    """
    sessions = {
        values["case"]: SessionRow(**{**values, "truths": tuple(json.loads(values["truths"]))})
        for values in _read_rows(folder / SESSIONS_FILE)
    }
    rows: list[Row] = []
    names: list[Name] = []
    for values in _read_rows(folder / CANDIDATES_FILE):
        if values["source"] == source:
            members = frozenset(
                (word.partition(":")[0], word.partition(":")[2]) for word in values["members"]
            )
            names.append(
                Name(values["effect"], values["joint"], frozenset(values["places"]), members)
            )
            rows.append(values)
    keys = [key for key in (rows[0] if rows else ()) if key.startswith(FEATURE)]
    features: dict[str, Float[Array, " N"]] = {}
    for key in keys:
        column = np.array([np.nan if row[key] is None else row[key] for row in rows], dtype=float)
        if np.any(np.isfinite(column)):
            features[key.removeprefix(FEATURE)] = column
    return Table(source, sessions, rows, names, features)


def _read_rows(path: Path) -> list[Row]:
    if not path.is_file():
        raise InputError(
            path,
            "no such file",
            "store the results first: python -m ident.benchmark.calibrate store",
        )
    return list(pq.read_table(path).to_pylist())


def use_index(index: Path, results: Path, out: Path) -> tuple[int, int]:
    """Stores the table of an index's sessions, see `store`.

    Args:
        index: The index file.
        results: Folder of the stored results.
        out: Folder of the table.

    Returns:
        What `store` returns.
    """
    return store(read_index(index), results, out)
