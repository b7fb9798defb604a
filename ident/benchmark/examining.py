"""Second step of a case: diagnose.

The process is told the recordings, the robot and what is not in the catalogue.

Neither this module nor what it imports knows the plant, the answers or the other cases. Two
yardsticks are measured on the same evidence: what every name alone would close (nobody has to tell
the process which one is true), and what a plain method names: forward selection by BIC, which takes
samples for independent.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.files import atomic_write
from ident.inference.held_out_views import Scorers
from ident.inference.search import SetSearch
from ident.records import JsonRecord, as_json
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, project
from ident.sessions import Given, inspect_sources

# Names of greatest evidence that are measured alone in each view (the others close nothing), and
# names by BIC.
MOST_ALONE = 24
MOST_BY_BIC = 3


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

    A diagnosis that fails is written down as such: one case must not end the others, nor drop out
    of the scores.
    """
    start = time.perf_counter()
    record: JsonRecord = {"stamp": task.stamp}
    try:
        arm, reports = inspect_sources(Given([task.session], task.robot)).whole
        catalogue = tuple(effect for effect in CATALOGUE if effect.id not in task.excluded)
        diagnosis, analysis, _ = diagnose_reports(reports, arm, catalogue)
        record["seconds"] = time.perf_counter() - start
        record["diagnosis"] = diagnosis.to_dict()
        if analysis is not None:
            evidence = analysis.conclusion.inference.best.model.sums.evidence
            prior = Prior.of(evidence, analysis.baseline.prior)
            chosen = [_name(group, diagnosis.joints) for group in forward_by_bic(evidence, prior)]
            record["heldout"] = measure_alone(analysis)
            record["rivals"] = {"bic_forward": chosen}
    except Exception as error:
        record["error"] = f"{type(error).__name__}: {error}"
    write_result(task.result, record)
    return task.session.name


def write_result(path: Path, record: JsonRecord) -> None:
    """Writes a record as JSON allows it: what is no number becomes null.

    Args:
        path: The file, written whole or not at all.
        record: What is written.
    """

    with atomic_write(path) as scratch:
        scratch.write_text(as_json(record, None) + "\n", encoding="utf-8")


def _name(group: Group, joints: Sequence[str]) -> tuple[str, str]:
    """Effect and joint; the joint is empty for an effect of the whole arm."""
    return group.effect.id, joints[group.joint] if group.effect.scope == "joint" else ""


def measure_alone(analysis: Analysis) -> JsonRecord:
    """Held-out RMS of each joint [N m] in two views.

    `tuned`, and `fixed`, in which wrong inertias can't do the same.

    Returns:
        For each view the RMS with no name (`none`) and with those of the diagnosis (`named`); and
        in `alone`, for each `effect:joint` (no joint for the whole arm), its view and the RMS with
        this name only, at its likeliest inner parameters.
    """
    conclusion = analysis.conclusion
    views = {"tuned": conclusion.scorers.tuned, "fixed": conclusion.scorers.fixed}
    both = {
        view: {"none": _rms(scorer), "named": _rms(scorer, conclusion.groups)}
        for view, scorer in views.items()
    }
    coarse = Scorers.of(conclusion.inference.best)
    alone: JsonRecord = {}
    for view, scorer in (("tuned", coarse.tuned), ("fixed", coarse.fixed)):
        for group in _likeliest(conclusion.inference.best.search, view == "fixed")[:MOST_ALONE]:
            name = ":".join(_name(group, analysis.diagnosis.joints))
            alone.setdefault(name, {"view": view, "rms": _rms(scorer, [group])})
    return {**both, "alone": alone}


def _rms(scorer: HeldOut, groups: Sequence[Group] = ()) -> list[float]:
    return [float(value) for value in scorer.score(groups).rms]


def _likeliest(search: SetSearch, inertia_like: bool) -> list[Group]:
    """Of each name that explains anything its likeliest point, the names of greatest evidence
    first.

    Args:
        search: All candidates.
        inertia_like: Whether only those count that wrong inertias can imitate, or only the others.
    """
    gains = search.gains(())
    best: dict[Key, Group] = {}
    for k in np.argsort(-gains):
        group = search.names.groups[k]
        if gains[k] > 0.0 and group.effect.inertia_like == inertia_like:
            best.setdefault(group.key, group)
    return list(best.values())


def forward_by_bic(evidence: Evidence, prior: Prior) -> list[Group]:
    """The candidate that lowers BIC most, again and again, until none lowers it.

    Samples unwhitened, each joint in
    units of its noise.
    """
    samples = float(sum(evidence.weights.sum(axis=0)))
    layout = evidence.layout
    gram = np.zeros((layout.size + 1, layout.size + 1))
    levels = evidence.whitening.level
    for local, sums, level in zip(layout.local, evidence.plain, levels, strict=True):
        gram[np.ix_(local, local)] += sums.over() / max(float(level), 1e-9) ** 2
    chosen: list[Group] = []
    while len(chosen) < MOST_BY_BIC:
        taken = {group.key for group in chosen}
        projection = project(gram, evidence, prior, chosen)
        variance = max(projection.misfit / samples, 1e-12)
        best = None
        most = 0.0
        for group in evidence.layout.groups:
            gain, *_ = projection.gain(group)
            fall = gain / variance - len(group.columns) * np.log(samples)
            if fall > most and group.key not in taken:
                best = group
                most = fall
        if best is None:
            break
        chosen.append(best)
    return chosen
