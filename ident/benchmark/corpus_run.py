"""Diagnoses the sessions of a corpus, one process a case, and stores what each found, how long it
took and how much memory it held.

    python -m ident.benchmark.corpus_run INDEX --out RESULTS [--only 'real/*'] [--limit 50]
    [--timeout 120]

A case that has a result already is not done again: a run that was stopped goes on. The processor
time is the child's.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import math
import os
import resource
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ident.benchmark.corpus import Entry, interleaved, read_index
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.files import atomic_write
from ident.inference.rows import candidate_rows, joint_rows
from ident.records import JsonRecord, as_json
from ident.sessions import Given, inspect_sources

TIMEOUT_S = 120.0  # of the processor
Diagnose = Callable[[Entry], JsonRecord]


def diagnose_entry(entry: Entry) -> JsonRecord:
    """Diagnoses a session of the corpus, from its recordings and its URDF alone."""
    arm, reports = inspect_sources(Given([Path(entry.folder)], entry.urdf)).whole
    diagnosis, analysis, _ = diagnose_reports(reports, arm, CATALOGUE)
    record = {"verdict": diagnosis.verdict, "diagnosis": diagnosis.to_dict()}
    if analysis is None:
        return {**record, "candidates": [], "joints": []}
    names = diagnosis.joints
    candidates = candidate_rows(analysis.conclusion, analysis.session, names)
    return {**record, "candidates": candidates, "joints": joint_rows(analysis.conclusion, names)}


def result_path(out: Path, case: str) -> Path:
    """Where the result of a case lies."""
    return out / f"{case.replace('/', '__')}.json"


def run_entry(entry: Entry, out: Path, diagnose: Diagnose, timeout: float) -> JsonRecord:
    """Diagnoses a case in a process of its own and writes its result; one that takes too long is
    ended, and told so.

    Returns:
        The record's `case`, `seconds` (of the processor), `peak_mb`, and `error` if there is one.
    """
    path = result_path(out, entry.case)
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        _work(entry, path, diagnose, timeout)
    _, status, usage = os.wait4(child, 0)
    record: JsonRecord = {"case": entry.case}
    if path.is_file():
        record = json.loads(path.read_text(encoding="utf-8"))
    elif os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        record["error"] = f"not done after {timeout:g} s"
    else:
        record["error"] = f"its process ended with status {status}"
    record["seconds"] = usage.ru_utime + usage.ru_stime
    record["peak_mb"] = usage.ru_maxrss / 1024.0
    _write(path, record)
    return {
        key: record[key]
        for key in ("case", "seconds", "peak_mb", "error", "verdict")
        if key in record
    }


def _work(entry: Entry, path: Path, diagnose: Diagnose, timeout: float) -> None:
    """What the child does; it never returns. Beyond so much processor time the system ends it."""
    status = 1
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(timeout), math.ceil(timeout) + 1))
    try:
        record: JsonRecord = {"case": entry.case}
        try:
            record.update(diagnose(entry))
        except Exception as error:  # one case must not end the others, nor drop out of the scores
            record["error"] = f"{type(error).__name__}: {error}"
        _write(path, record)
        status = 0
    finally:
        os._exit(status)


def _write(path: Path, record: JsonRecord) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(as_json(_as_json(record), None) + "\n", encoding="utf-8")


def _as_json(value: Any) -> Any:
    """What JSON allows: what is no number becomes null."""
    if isinstance(value, dict):
        return {str(key): _as_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [_as_json(item) for item in value]
    if isinstance(value, (str, bool, int)) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def run_all(
    entries: Sequence[Entry],
    out: Path,
    diagnose: Diagnose = diagnose_entry,
    timeout: float = TIMEOUT_S,
    say: Callable[[str], None] = lambda line: None,
) -> None:
    """Diagnoses all cases that have no result yet; every beginning is of all kinds."""
    for entry in interleaved(entries):
        if not result_path(out, entry.case).is_file():
            record = run_entry(entry, out, diagnose, timeout)
            words = record.get("error") or record.get("verdict", "")
            say(f"{record['case']} {words} {record['seconds']:.1f} s {record['peak_mb']:.0f} MB")


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("index", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", default="*")
    parser.add_argument("--limit", type=int)
    parser.add_argument("--timeout", type=float, default=TIMEOUT_S)
    given = parser.parse_args()
    entries = [
        entry for entry in read_index(given.index) if fnmatch.fnmatch(entry.case, given.only)
    ]
    chosen = interleaved(entries)[: given.limit]

    def say(line: str) -> None:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    run_all(chosen, given.out, diagnose_entry, given.timeout, say)


if __name__ == "__main__":
    main()
