"""Second step of a case: diagnose. The process is told the recordings, the robot and what is not in the catalogue.

Neither this module nor what it imports knows the plant, the answers or the other cases. Two yardsticks are measured on
the same evidence: what every name alone would close (nobody has to tell the process which one is true), and what a
plain method names: forward selection by BIC, which takes samples for independent.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.from_reports import diagnose_reports
from ident.diagnosis.selection.search import Search
from ident.effects.catalogue import CATALOGUE
from ident.files import atomic_write
from ident.records import as_json
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, project
from ident.sessions import Given, inspect_sources

# Names of greatest evidence that are measured alone in each view (the others close nothing), and names by BIC.
MOST_ALONE, MOST_BY_BIC = 24, 3


@dataclass(frozen=True)
class ExamineTask:
    """What the diagnosing process is given."""

    session: Path  # folder of the recordings
    robot: str  # URDF path or name
    excluded: tuple[str, ...]  # ids that are taken out of the catalogue
    result: Path  # file for the results
    stamp: str  # of the diagnosing code


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
            prior, evidence = Prior.of(analysis.evidence, analysis.baseline.prior), analysis.evidence
            chosen = [_name(group, diagnosis.joints) for group in forward_by_bic(evidence, prior)]
            record["heldout"] = measure_alone(analysis, prior)
            record["rivals"] = {"bic_forward": chosen}
    except Exception as error:
        record["error"] = f"{type(error).__name__}: {error}"
    write_result(task.result, record)
    return task.session.name


def write_result(path: Path, record: dict[str, Any]) -> None:
    """Writes a record as JSON allows it: what is no number becomes null."""

    with atomic_write(path) as part:
        part.write_text(as_json(record, None) + "\n", encoding="utf-8")


def _name(group: Group, joints: Sequence[str]) -> tuple[str, str]:
    """Effect and joint; the joint is empty for an effect of the whole arm."""
    return group.effect.id, joints[group.joint] if group.effect.scope == "joint" else ""


def measure_alone(analysis: Analysis, prior: Prior) -> dict[str, Any]:
    """Held-out RMS of each joint [N m] in two views: `tuned`, and `fixed`, in which wrong inertias can't do the same.

    Returns:
        For each view the RMS with no name (`none`) and with those of the diagnosis (`named`); and in `alone`, for each
        `effect:joint` (no joint for the whole arm), its view and the RMS with this name only, at its best
        inner parameters.
    """
    search = Search(analysis.evidence, prior, HeldOut(analysis.evidence, prior))
    named = [item.group for item in analysis.search.accepted]
    views = {"tuned": search.held_out, "fixed": search.fixed}
    gram, alone = analysis.evidence.gram(), {}

    def rms(held_out: HeldOut, groups: list[Group]) -> list[float]:
        return [float(value) for value in held_out.score(groups).rms]

    for view, held_out in views.items():
        best = search.best_by_key(project(gram, analysis.evidence, held_out.prior))
        ours = [pair for pair in best.values() if pair[1].effect.inertia_like == (view == "fixed") and pair[0] > 0.0]
        for _, group in sorted(ours, key=lambda pair: -pair[0])[:MOST_ALONE]:
            name = ":".join(_name(group, analysis.diagnosis.joints))
            if name not in alone:
                alone[name] = {"view": view, "rms": rms(held_out, [group])}
    both = {view: {"none": rms(held_out, []), "named": rms(held_out, named)} for view, held_out in views.items()}
    return {**both, "alone": alone}


def forward_by_bic(evidence: Evidence, prior: Prior) -> list[Group]:
    """The candidate that lowers BIC most, again and again, until none lowers it: samples unwhitened, each joint in
    units of its noise.
    """
    samples = float(sum(evidence.weights.sum(axis=0)))
    gram = np.zeros((evidence.layout.size + 1, evidence.layout.size + 1))
    for local, sums, level in zip(evidence.layout.local, evidence.plain, evidence.whitening.level, strict=True):
        gram[np.ix_(local, local)] += sums.over() / max(float(level), 1e-9) ** 2
    chosen: list[Group] = []
    while len(chosen) < MOST_BY_BIC:
        projection = project(gram, evidence, prior, chosen)
        variance, best, most = max(projection.misfit / samples, 1e-12), None, 0.0
        for group in evidence.layout.groups:
            fall = projection.gain(group)[0] / variance - len(group.columns) * np.log(samples)
            if fall > most and group.key not in {one.key for one in chosen}:
                best, most = group, fall
        if best is None:
            break
        chosen.append(best)
    return chosen
