"""Second step of a case: diagnose. The process is told the recordings, the robot and what is not in the catalogue.

Neither this module nor what it imports knows the plant, the answers or the other cases.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.benchmark.alternatives import measure_alternatives
from ident.benchmark.rivals import name_by_rivals
from ident.diagnosis.from_reports import diagnose_reports
from ident.diagnosis.regression.least_squares import Prior
from ident.effects.catalogue import CATALOGUE
from ident.files import atomic_write
from ident.sessions import Given, inspect_sources


@dataclass(frozen=True)
class ExamineTask:
    """What the diagnosing process is told.

    Attributes:
        session: Folder of the recordings.
        robot: URDF path or name.
        excluded: Ids that are taken out of the catalogue.
        result: File for the results.
        stamp: Of the diagnosing code.
    """

    session: Path
    robot: str
    excluded: tuple[str, ...]
    result: Path
    stamp: str


def examine(task: ExamineTask) -> str:
    """Diagnoses a case and writes its result; returns the session's name.

    A diagnosis that fails is written down as such: one case must not end the others, nor drop out of the scores.
    """
    start = time.perf_counter()
    record: dict[str, Any] = {"stamp": task.stamp}
    try:
        arm, reports = inspect_sources(Given([task.session], task.robot)).whole
        catalogue = tuple(effect for effect in CATALOGUE if effect.id not in task.excluded)
        diagnosis, analysis, _ = diagnose_reports(reports, arm, catalogue)
        record["seconds"] = time.perf_counter() - start
        record["diagnosis"] = diagnosis.to_dict()
        if analysis is not None:
            prior = Prior.of(analysis.evidence, analysis.baseline.prior)
            record["heldout"] = measure_alternatives(analysis, prior)
            record["rivals"] = name_by_rivals(analysis.evidence, prior, diagnosis.joints)
    except Exception as error:
        record["error"] = f"{type(error).__name__}: {error}"
    with atomic_write(task.result) as part:
        part.write_text(json.dumps(finite(record), default=float) + "\n", encoding="utf-8")
    return task.session.name


def finite(value: Any) -> Any:
    """A record as JSON allows it: what is no number becomes null."""
    if isinstance(value, dict):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
