"""Diagnosis repeated as runs come in, until the result is certain enough.

A probability that is right as often as it says is so whenever one stops to look at it: what is
recorded next depends on it, what it says of the recordings so far does not (Berger and Wolpert
1988, the stopping rule principle). So every look asks for the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil

from ident.diagnosis.result import Diagnosis
from ident.diagnosis.settings import LOOKS as LIMIT
from ident.errors import InputError
from ident.records import JsonRecord

NOISES = ("encoder", "torque")


@dataclass(frozen=True)
class RepeatedLook:
    """A diagnosis of the first runs."""

    runs: int  # number of runs
    seconds: float  # their duration together [s]
    verdict: str  # verdict of the diagnosis
    missing: tuple[str, ...]  # reasons why the result is not certain enough; empty if it is

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: `runs`, `minutes` of recording, `verdict` and `missing`."""
        record = {**vars(self), "minutes": self.seconds / 60.0, "missing": list(self.missing)}
        del record["seconds"]
        return record


@dataclass(frozen=True, eq=False)
class RepeatedLooks:
    """All looks until the result was certain enough, or all runs were used."""

    confidence: float  # required probability
    looks: tuple[RepeatedLook, ...]  # in order
    diagnosis: Diagnosis  # the last look's diagnosis

    @property
    def enough(self) -> bool:
        """Whether the last look was certain enough."""
        return not self.looks[-1].missing

    def to_dict(self) -> JsonRecord:
        """The entry `until` of the diagnosis's record.

        Returns:
            `sure` (the probability asked for), `enough`, of the last look `runs`, `minutes` and
            `missing`, and `looks` (records of all).
        """
        last = self.looks[-1].to_dict()
        return {
            "sure": self.confidence,
            "enough": self.enough,
            **{key: last[key] for key in ("runs", "minutes", "missing")},
            "looks": [look.to_dict() for look in self.looks],
        }


def diagnose_sequentially(
    look: Callable[[int], Diagnosis], total: int, level: float
) -> RepeatedLooks:
    """Diagnoses more and more runs until the result is certain enough.

    Args:
        look: Diagnoses the first so many runs.
        total: Number of runs.
        level: Least probability of each finding.

    Raises:
        InputError: No finding can have this probability.
    """
    if not 0.5 <= level < 1.0:
        raise InputError(
            "--until", f"{level:g}", "choose from 0.5 to below 1: no finding is certain"
        )
    looks: list[RepeatedLook] = []
    for runs in count_runs(total):
        diagnosis = look(runs)
        seconds = float(diagnosis.session["duration_s"])
        missing = tuple(find_missing(diagnosis, level))
        looks.append(RepeatedLook(runs, seconds, diagnosis.verdict, missing))
        if not missing:
            break
    return RepeatedLooks(level, tuple(looks), diagnosis)


def count_runs(total: int) -> Iterator[int]:
    """Numbers of runs of the successive looks, growing by a factor; the last one is `total`."""
    runs = min(LIMIT.first_runs, total)
    while runs < total:
        yield runs
        runs = ceil(LIMIT.growth * runs)
    yield total


def find_missing(diagnosis: Diagnosis, confidence: float) -> Iterator[str]:
    """Reasons why a diagnosis is not certain enough, in words; none if it is.

    Args:
        diagnosis: The diagnosis.
        confidence: Least probability of each finding.
    """
    if diagnosis.verdict == "no_gap":
        hidden = sorted(_hidden_by_noise(diagnosis))
        if hidden:
            yield f"noise still hides {', '.join(hidden)}"
        return
    if diagnosis.verdict in ("not_testable", "refused"):
        yield f"the verdict is {diagnosis.verdict}"
        return
    if diagnosis.verdict != "named":
        yield "part of the gap is unexplained" if diagnosis.findings else "the gap is unexplained"
    for finding in diagnosis.findings:
        estimate = finding.estimate
        if estimate.probability >= confidence:
            continue
        what = f"{finding.effect} of {', '.join(finding.joints)}"
        others = estimate.rivals[1:]
        rivals = f", not distinguished from {', '.join(others)}" if others else ""
        yield f"{what} has probability {estimate.probability:.2f}{rivals}"


def _hidden_by_noise(diagnosis: Diagnosis) -> set[str]:
    """Effects with their joints that noise hides, but would not in more runs.

    These lower a finite detection limit, but do not show what leaves no trace at all.
    """
    limits = () if diagnosis.details is None else diagnosis.details.detectable
    hidden = set()
    for limit in limits:
        if limit.hidden and limit.bound_by in NOISES and limit.value is not None:
            hidden.add(f"{limit.effect.id} of {diagnosis.joints[limit.joint]}")
    return hidden
