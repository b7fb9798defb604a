"""Looking again and again as runs come in: is enough recorded to be confidence, or what is missing?

A test that is made after every few runs, until it says what one waits for, is wrong more often than a test that is made
once. So the k-th look is given the share 6 / (π² k²) of the chance α of a false name; over all looks, however many, the
shares add up to one, and the chance that any look gives a false name is α at most (Boole's inequality). Evidence must
be greater by the share's logarithm.

Source: Lan and DeMets 1983 (error spending).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import ceil, exp, log, pi
from typing import Any

from ident.diagnosis.result import Diagnosis
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.errors import InputError
from ident.records import read_group

LIMIT = read_group(__file__, "looks")
NOISES = ("encoder", "torque")


@dataclass(frozen=True)
class RepeatedLook:
    """One look at the first runs."""

    runs: int  # how many
    seconds: float  # their duration together [s]
    verdict: str  # of the diagnosis
    family_error: float  # chance of a false name that was spent
    missing: tuple[str, ...]  # what keeps it from being sure; empty where it is

    def to_dict(self) -> dict[str, Any]:
        record = {**vars(self), "minutes": self.seconds / 60.0, "missing": list(self.missing)}
        del record["seconds"]
        return record


@dataclass(frozen=True, eq=False)
class RepeatedLooks:
    """All looks until the diagnosis was confidence, or the runs were at their end."""

    confidence: float  # how sure it was to be
    looks: tuple[RepeatedLook, ...]  # in order
    diagnosis: Diagnosis  # that of the last look

    @property
    def enough(self) -> bool:
        """Whether the last look was sure."""
        return not self.looks[-1].missing

    def to_dict(self) -> dict[str, Any]:
        """What a record of the diagnosis holds of it."""
        last = self.looks[-1].to_dict()
        return {
            "sure": self.confidence,
            "enough": self.enough,
            **{key: last[key] for key in ("runs", "minutes", "missing")},
            "looks": [look.to_dict() for look in self.looks],
        }


def diagnose_sequentially(
    look: Callable[[int, DiagnosisSettings], Diagnosis],
    total: int,
    confidence: float,
    settings: DiagnosisSettings = USUAL,
) -> RepeatedLooks:
    """Looks at more and more runs until the diagnosis is sure.

    Args:
        look: Diagnoses so many of the first runs, by some settings.
        total: How many there are.
        sure: Least probability of every name, and one less the chance of a false name over all looks.
        settings: By which a single look is made.

    Raises:
        InputError: It can't be so sure.
    """
    most = settings.selection.most_sure
    if not 0.5 <= confidence <= most:
        raise InputError("--until", f"{confidence:g}", f"choose between 0.5 and {most:g}: no name is ever surer")
    looks: list[RepeatedLook] = []
    for number, runs in enumerate(count_runs(total), start=1):
        error = min(1.0 - confidence, LIMIT.single_look)
        spent = spend(settings, error, number)
        diagnosis = look(runs, spent)
        seconds = float(diagnosis.session["duration_s"])
        missing = tuple(find_missing(diagnosis, confidence))
        looks.append(RepeatedLook(runs, seconds, diagnosis.verdict, error * share_of_look(number), missing))
        if not missing:
            break
    return RepeatedLooks(confidence, tuple(looks), diagnosis)


def count_runs(total: int) -> Iterator[int]:
    """Numbers of runs at which it is looked; all of them at last."""
    runs = min(LIMIT.first_runs, total)
    while runs < total:
        yield runs
        runs = ceil(LIMIT.growth * runs)
    yield total


def share_of_look(number: int) -> float:
    """Share of the chance of a false name that one of many looks, counted from one, may spend."""
    return 6.0 / (pi * number) ** 2


def spend(settings: DiagnosisSettings, error: float, number: int) -> DiagnosisSettings:
    """Settings of one of many looks, counted from one, that together have the chance `error` of a false name."""
    held, nats = settings.selection, -log(share_of_look(number) * error / LIMIT.single_look)
    selection = held.but(
        least_nats=held.least_nats + nats,
        inertial_odds=held.inertial_odds * exp(nats),
        event_nats=held.event_nats + nats,
    )
    return replace(settings, selection=selection)


def find_missing(diagnosis: Diagnosis, confidence: float) -> Iterator[str]:
    """What keeps a diagnosis from being sure; nothing where it is."""
    if diagnosis.verdict == "no_gap":
        limits = () if diagnosis.details is None else diagnosis.details.detectable
        # What shows nothing at all no amount of runs shows; what shows too little does with more of them.
        hidden = [one for one in limits if one.hidden and one.bound_by in NOISES and one.value is not None]
        places = sorted({f"{one.effect.id} of {diagnosis.joints[one.joint]}" for one in hidden})
        if places:
            yield f"noise still hides {', '.join(places)}"
        return
    if diagnosis.verdict in ("not_testable", "refused"):
        yield f"the verdict is {diagnosis.verdict}"
        return
    if diagnosis.verdict != "named":
        yield "part of the gap has no name" if diagnosis.findings else "the gap has no name"
    for one in diagnosis.findings:
        if one.estimate.probability < confidence:
            rivals = (
                f", not distinguished from {', '.join(one.estimate.rivals[1:])}" if len(one.estimate.rivals) > 1 else ""
            )
            yield f"{one.effect} of {', '.join(one.joints)} is sure to {one.estimate.probability:.2f}{rivals}"
