"""What is done with one session: figures by the same regression every day, and a diagnosis; all goes to the store."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.checks.report import TelemetryReport
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.model.hybrid import HybridModel
from ident.monitor.alarms import LEVEL
from ident.monitor.estimates import UNITS, estimate_session
from ident.monitor.folder import FoundSession, as_text, date_of
from ident.monitor.store import DONE, Store
from ident.motion.motion import prepare
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.sessions import Given, inspect_sources


@dataclass(frozen=True)
class WatchOptions:
    """How a folder is watched.

    Attributes:
        robot: URDF path or name; None takes the one named in session.toml.
        model: Folder of a fitted model whose inertias are the reference of all figures.
        diagnosed: Whether each session is diagnosed too.
        level: Chance of any false alarm in an arm's life.
        settle: A session is looked at when nothing was written to it for so long [s].
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler instead.
    """

    robot: str | None = None
    model: str | None = None
    diagnosed: bool = True
    level: float = LEVEL
    settle: float = 10.0
    workers: int = 1
    scheduler: str | None = None


def examine_session(task: tuple[FoundSession, Path, WatchOptions]) -> str:
    """Looks at one session and writes what is found; a session that is unfit is noted as such.

    Args:
        task: The session, the folder of the store, and how it is looked at; as it goes to another process.

    Returns:
        Its name, `arm/session`.
    """
    found, folder, options = task
    store = Store(folder)
    row: dict[str, Any] = {"arm": found.arm, "session": found.name, "stamp": found.stamp, "path": as_text(found.path)}
    try:
        arm, (report,) = inspect_sources(Given([found.path], options.robot, session_file=found.settings)).whole
        session, row["robot"] = report.session, arm.name
        row["date"] = date_of(found, _first_stamp(session))
        report.require_fit()
        model = None if options.model is None else HybridModel.load(Path(options.model))
        figures = _figures(report, arm, model)
        if options.diagnosed:
            row["verdict"] = _write_diagnosis(store, found, report, arm, model, row)
        store.write("figures", found.arm, found.name, [{**row, **one} for one in figures])
        size = {"samples": session.samples, "duration_s": session.duration}
        store.write(DONE, found.arm, found.name, [{**row, **size, "status": "done"}])
    except InputError as error:
        _write_unfit(store, found, row, "refused", str(error))
    except Exception as error:  # one session that we fail at must not end the watch over all others
        _write_unfit(store, found, row, "failed", f"{type(error).__name__}: {error}")
    return found.key


def _write_unfit(store: Store, found: FoundSession, row: dict[str, Any], status: str, reason: str) -> None:
    row.setdefault("date", _date_of_unfit(found))
    for kind in ("figures", "effects"):
        store.write(kind, found.arm, found.name, [])
    store.write(DONE, found.arm, found.name, [{**row, "status": status, "reason": as_text(reason)}])


def _first_stamp(session: Session) -> float | None:
    return float(session.runs[0].time[0]) if session.runs and len(session.runs[0]) else None


def _date_of_unfit(found: FoundSession) -> str:
    try:
        return date_of(found, None)
    except InputError:
        return ""


def _figures(report: TelemetryReport, arm: ArmModel, model: HybridModel | None) -> list[dict[str, Any]]:
    reference = arm
    if model is not None:
        model.require_robot(arm, "--model")
        reference = model.arm
    found = estimate_session(prepare(report.session), reference.keeping(report.session.joints))
    return [{"joint": joint, "figure": name, **vars(one), "unit": UNITS[name]} for (joint, name), one in found.items()]


def _write_diagnosis(
    store: Store,
    found: FoundSession,
    report: TelemetryReport,
    arm: ArmModel,
    model: HybridModel | None,
    row: dict[str, Any],
) -> str:
    """Diagnoses the session, writes its record beside the tables, and returns the verdict."""
    diagnosis, _, _ = diagnose_reports([report], arm, CATALOGUE, model=model)
    record = diagnosis.to_dict()
    with atomic_write(store.place("diagnoses", found.arm, found.name, ".json")) as part:
        part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    store.write("effects", found.arm, found.name, [{**row, **one} for one in _effects(record)])
    return diagnosis.verdict


def _effects(record: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "effect": one["effect"],
            "joints": ", ".join(one["joints"]),
            "probability": one["probability"],
            "shrink": one["heldout"]["shrink"],
            "action": one.get("action"),
        }
        for one in record["findings"]
    ]
