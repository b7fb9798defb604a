"""A diagnosis in plain lines for the terminal, and as marks on the timeline."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rich.console import Console

from ident.console import styled
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.axes import Axis, session_axes
from ident.diagnosis.result import Diagnosis, Finding
from ident.diagnosis.sequential import RepeatedLooks
from ident.errors import plural
from ident.show.limits import describe_limits
from ident.show.report.diagnosis_verdict import (
    describe_reservations,
    describe_unnamed,
    first_action,
    is_small,
    order_of,
)
from ident.show.report.numbers import pair, significant
from ident.show.report.words import axis_name, interval_words, parameters_in_words
from ident.show.timeline import Curve, Mark
from ident.show.untestable import group_silent

VERDICTS = {
    "no_gap": "no gap: the tuned model explains these recordings down to their noise",
    "named": "the gap has a name",
    "partial": "part of the gap has a name",
    "none_of_catalogue": "there is a gap, and no effect of the catalogue explains it",
    "not_testable": "these recordings can't tell",
    "refused": "the recordings are unfit; nothing was fitted",
}
MOSTLY_UNNAMED = "most of the gap has no name; what has one explains the lesser part"
SMALL_GAP = "there is a small gap: more than chance, and too little for a name"
MOST_MARKS = 60
MARK_LENGTH = 0.5  # [s]
# Mean square of a stretch that is marked, in units of the noise's.
MARK_FROM = 4.0
TUNED_COLOUR, NAMED_COLOUR = "#d55e00", "#009e73"


def print_diagnosis(console: Console, diagnosis: Diagnosis) -> None:
    """Verdict, findings, and what could not be judged."""
    facts = diagnosis.session
    runs = plural(int(facts["runs"]), "run")
    console.print(f"{diagnosis.robot}: {runs}, {facts['samples']} samples, {facts['duration_s']:.0f} s")
    for issue in diagnosis.telemetry:
        if issue.severity != "note":
            console.print(f"{issue.severity}: {issue.issue}: {issue.evidence}; {issue.remedy}", soft_wrap=True)
    record = diagnosis.to_dict()
    words = SMALL_GAP if is_small(record) else VERDICTS[diagnosis.verdict]
    if diagnosis.verdict == "none_of_catalogue" and diagnosis.findings:
        words = MOSTLY_UNNAMED
    console.print(styled((diagnosis.verdict, "bold"), f": {words}"))
    if action := first_action(record):
        console.print(f"  first: {action}", soft_wrap=True, highlight=False, markup=False)
    for finding, told in zip(diagnosis.findings, record["findings"], strict=True):
        console.print(describe(finding, int(facts["runs"])), soft_wrap=True, highlight=False)
        console.print(f"    do: {order_of(told, record)}", soft_wrap=True, highlight=False, markup=False)
    for line in describe_reservations(record):
        console.print(f"  {line}", soft_wrap=True, highlight=False)
    if unnamed := describe_unnamed(record):
        console.print(f"  {unnamed}", soft_wrap=True, highlight=False)
    for name, gap in diagnosis.gap.items():
        left = f", explainable by {gap.unexplained} but unnamed" if gap.unexplained else ""
        console.print(f"  {name}: {gap.rms:.3f} N m against {gap.noise_floor:.3f} of noise{left}")
    if diagnosis.verdict == "no_gap" and (limits := describe_limits(record)):
        console.print(f"  {limits}", soft_wrap=True, highlight=False)
    for line in group_silent(record["not_testable"]):
        console.print(f"  {line}", soft_wrap=True, highlight=False)


def print_looks(console: Console, looks: RepeatedLooks) -> None:
    """Whether enough was recorded; else what is missing, and what to record."""
    console.print(looks.words(), soft_wrap=True, highlight=False)
    following = looks.diagnosis.to_dict()["next_experiment"]
    if not looks.enough and following is not None:
        console.print(f"  record next: {following['motion']}", soft_wrap=True, highlight=False, markup=False)


def describe(finding: Finding, runs: int) -> str:
    """One finding in one line: where, what, how sure, how large, how far; of one run, energy has no spread."""
    estimate = finding.estimate
    name = estimate.group.effect.id
    others = ", ".join(f"{one} {share:.0%}" for one, share in list(estimate.shares.items())[1:])
    rivals = f"; one of its class {estimate.class_probability:.0%}: {others}" if others else ""
    figures = parameters_in_words(estimate.parameters)
    before, after = finding.energy_std if runs > 1 else (None, None)
    energy = f"energy error {pair(finding.energy_before, before)} → {pair(finding.energy_after, after)} J"
    return (
        f"  {', '.join(finding.joints)}: {name} ({estimate.probability:.0%}{rivals}), {figures}; "
        f"explains {significant(finding.gain)} N m (rms) on unseen runs, {finding.shrink:.0%} of what can be closed; "
        f"{energy}"
    )


def gap_marks(analysis: Analysis) -> list[Mark]:
    """The half seconds in which a joint's residual stands highest above its noise, and the cells that they lie in."""
    found: list[tuple[float, int, int, slice]] = []
    level = np.maximum(analysis.evidence.floor, 1e-9)
    for k, item in enumerate(analysis.series):
        width = max(1, round(MARK_LENGTH / item.step))
        power = np.where(item.counts, (item.before / level) ** 2, 0.0)
        for start in range(0, len(power) - width + 1, width):
            rows = slice(start, start + width)
            heights = power[rows].mean(axis=0)
            found += [(float(heights[j]), k, int(j), rows) for j in np.flatnonzero(heights > MARK_FROM)]
    found.sort(key=lambda one: -one[0])
    axes = session_axes(analysis.series)
    return [_mark(analysis, axes, *one) for one in found[:MOST_MARKS]]


def _mark(analysis: Analysis, axes: Mapping[str, Axis], height: float, k: int, j: int, rows: slice) -> Mark:
    """One stretch in words: how high, and which of the joint's significant cells it lies in."""
    item, name = analysis.series[k], analysis.diagnosis.joints[j]
    significant = analysis.diagnosis.settings.gap.map.significant
    cells = []
    for place in analysis.diagnosis.where:
        if place.joint == name and place.axis in axes and place.p_value <= significant:
            middle = float(np.median(axes[place.axis](item, j)[rows]))
            if place.low <= middle <= place.high:
                cells.append(f"{axis_name(place.axis)} {interval_words(place.axis, place.low, place.high)}")
    text = ", ".join([f"gap {np.sqrt(height):.1f} times the noise", *cells])
    return Mark(item.index, rows.start * item.step, rows.stop * item.step, name, text)


def gap_curves(analysis: Analysis) -> list[list[Curve]]:
    """What the tuned model leaves, run by run, with the named effects and without; the latter last: it is marked.

    Of very many runs only some have curves.
    """
    rungs = [("tuned", "after tuning", TUNED_COLOUR)]
    if analysis.diagnosis.findings:
        rungs.insert(0, ("named", "with the named effects", NAMED_COLOUR))
    curves: list[list[Curve]] = [[] for _ in analysis.session.runs]
    for item in analysis.series:
        curves[item.index] = [
            Curve(joint, ("residual", rung), words, colour, (item.after if rung == "named" else item.before)[:, j])
            for j, joint in enumerate(analysis.diagnosis.joints)
            for rung, words, colour in rungs
        ]
    return curves
