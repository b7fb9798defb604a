"""A diagnosis in plain lines for the terminal, and as marks on the timeline."""

from __future__ import annotations

from collections import Counter

import numpy as np
from rich.console import Console

from ident.diagnosis.diagnose import Analysis, Diagnosis, Finding
from ident.timeline import Mark

VERDICTS = {
    "no_gap": "no gap: the tuned model explains these recordings down to their noise",
    "named": "the gap has a name",
    "partial": "part of the gap has a name",
    "none_of_catalogue": "there is a gap, and no effect of the catalogue explains it",
    "not_testable": "these recordings can't tell",
    "refused": "the recordings are unfit; nothing was fitted",
}
MOST_MARKS = 60
MARK_LENGTH = 0.5  # [s]


def print_diagnosis(console: Console, diagnosis: Diagnosis) -> None:
    """Verdict, findings, and what could not be judged."""
    facts = diagnosis.session
    console.print(f"{diagnosis.robot}: {facts['runs']} runs, {facts['samples']} samples, {facts['duration_s']:.0f} s")
    for issue in diagnosis.telemetry:
        if issue.severity != "note":
            console.print(f"{issue.severity}: {issue.issue}: {issue.evidence}; {issue.remedy}", soft_wrap=True)
    console.print(f"[bold]{diagnosis.verdict}[/]: {VERDICTS[diagnosis.verdict]}")
    for finding in diagnosis.findings:
        console.print(describe(finding), soft_wrap=True, highlight=False)
    for name, gap in diagnosis.gap.items():
        left = f", explainable by {gap['unexplained']} but unnamed" if gap["unexplained"] else ""
        console.print(f"  {name}: {gap['rms_Nm']:.3f} N m against {gap['noise_floor_Nm']:.3f} of noise{left}")
    silent = Counter(item["effect"] for item in diagnosis.not_testable)
    if silent:
        told = ", ".join(f"{effect} ({count} joints)" if count > 1 else effect for effect, count in silent.items())
        console.print(f"  not testable with these motions: {told}; the page says why", soft_wrap=True)


def describe(finding: Finding) -> str:
    """One finding in one line: where, what, how sure, how large, how far."""
    estimate = finding.estimate
    name = estimate.group.effect.id
    rivals = f"; can't be told from {', '.join(estimate.rivals[1:])}" if len(estimate.rivals) > 1 else ""
    figures = ", ".join(
        f"{key} {value.value:.3g} [{value.low:.3g}, {value.high:.3g}]" for key, value in estimate.parameters.items()
    )
    energy = f"energy error {finding.energy_before:.2f} → {finding.energy_after:.2f} J"
    return (
        f"  {', '.join(finding.joints)}: {name} ({estimate.probability:.0%}{rivals}), {figures}; "
        f"closes {finding.shrink:.0%} of the reducible held-out gap, {energy}"
    )


def gap_marks(analysis: Analysis) -> list[Mark]:
    """The half seconds in which a joint's residual stands highest above its noise."""
    found: list[tuple[float, Mark]] = []
    level = np.maximum(analysis.evidence.whitening.level, 1e-9)
    for item in analysis.series:
        step = item.run.motion.interval * item.run.motion.lowpass.factor
        width = max(1, round(MARK_LENGTH / step))
        for j, name in enumerate(analysis.diagnosis.joints):
            power = np.where(item.counts[:, j], (item.before[:, j] / level[j]) ** 2, 0.0)
            for start in range(0, len(power) - width + 1, width):
                height = float(power[start : start + width].mean())
                if height > 4.0:
                    text = f"gap {np.sqrt(height):.1f} times the noise"
                    found.append((height, Mark(item.index, start * step, (start + width) * step, name, text)))
    found.sort(key=lambda pair: -pair[0])
    return [mark for _, mark in found[:MOST_MARKS]]
