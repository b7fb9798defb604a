"""What is done with one session: estimates by the same regression every day, and a diagnosis; all goes to the store."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.model.hybrid import HybridModel
from ident.monitor.estimates import UNITS, estimate_session
from ident.monitor.folder import FoundSession, as_text, date_of
from ident.monitor.store import DONE, Store
from ident.motion.motion import prepare
from ident.options import WatchOptions
from ident.sessions import Given, inspect_sources


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
    tables: dict[str, list[dict[str, Any]]] = {}
    end: dict[str, Any] = {"status": "done"}
    try:
        tables = _examine(found, options, row, store)
    except InputError as error:
        end = {"status": "refused", "reason": as_text(str(error))}
    except Exception as error:  # one session that we fail at must not end the watch over all others
        end = {"status": "failed", "reason": as_text(f"{type(error).__name__}: {error}")}
    if "date" not in row:
        try:
            row["date"] = date_of(found, None)
        except InputError:
            row["date"] = ""
    for kind in ("figures", "effects"):
        store.write(kind, found.arm, found.name, [{**row, **one} for one in tables.get(kind, ())])
    store.write(DONE, found.arm, found.name, [{**row, **end}])
    return found.key


def _examine(
    found: FoundSession, options: WatchOptions, row: dict[str, Any], store: Store
) -> dict[str, list[dict[str, Any]]]:
    """The rows of a session's estimates and effects; fills in its own row, and writes its diagnosis beside them."""
    arm, (report,) = inspect_sources(Given([found.path], options.robot, session_file=found.settings)).whole
    session, row["robot"] = report.session, arm.name
    first = session.runs[0].time[:1].tolist() if session.runs else []
    row["date"] = date_of(found, first[0] if first else None)
    report.require_fit()
    model = None if options.model is None else HybridModel.load(Path(options.model))
    if model is not None:
        model.require_robot(arm, "--model")
    reference = (arm if model is None else model.arm).keeping(session.joints)
    estimates = estimate_session(prepare(session), reference)
    rows = [
        {"joint": joint, "figure": name, **vars(one), "unit": UNITS[name]} for (joint, name), one in estimates.items()
    ]
    effects: list[dict[str, Any]] = []
    if options.diagnosed:
        diagnosis, _, _ = diagnose_reports([report], arm, CATALOGUE, model=model)
        record, row["verdict"] = diagnosis.to_dict(), diagnosis.verdict
        with atomic_write(store.place("diagnoses", found.arm, found.name, ".json")) as part:
            part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        effects = [
            {
                "effect": one["effect"],
                "joints": ", ".join(one["joints"]),
                "probability": one["probability"],
                "shrink": one["heldout"]["shrink"],
                "action": one.get("action"),
            }
            for one in record["findings"]
        ]
    row |= {"samples": session.samples, "duration_s": session.duration}
    return {"figures": rows, "effects": effects}
