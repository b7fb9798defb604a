"""Which sections make a page of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ident.errors import plural
from ident.model.evaluation import Evaluation
from ident.model.hybrid import HybridModel
from ident.recordings.recording import TelemetryIssue
from ident.show.report.comparison import ComparisonSection
from ident.show.report.fits import FitSection
from ident.show.report.ladder import LadderSection
from ident.show.report.page import Section, write_report
from ident.show.report.parameters import ParameterSection
from ident.show.report.payloads import PayloadSection
from ident.show.report.provenance import ProvenanceSection
from ident.show.report.residuals import ResidualSection
from ident.show.report.source import ReportInput
from ident.show.report.telemetry import TelemetrySection
from ident.show.report.verdict import VerdictSection

MOST_NAMES = 8


def evaluation_sections(source: ReportInput) -> list[Section]:
    """All sections of an evaluation, the verdict first."""
    names = [evaluation.model for evaluation in source.evaluations]
    return [
        VerdictSection(source),
        LadderSection(source),
        PayloadSection(source),
        ComparisonSection(source),
        FitSection(source),
        ResidualSection(source),
        ParameterSection(source),
        TelemetrySection(source.issues),
        ProvenanceSection(list(zip(names, source.models, strict=True))),
    ]


def write_evaluation_report(
    path: str | Path,
    models: Sequence[HybridModel],
    evaluations: Sequence[Evaluation],
    issues: Sequence[TelemetryIssue] = (),
) -> Path:
    """Writes the page of an evaluation.

    Args:
        path: The file to be written.
        models: Fitted models; the page speaks first of the one fitted on most samples.
        evaluations: The evaluation of each.
        issues: What the telemetry check of the evaluated sessions found.

    Raises:
        InputError: The folder can't be written to.
    """
    source = ReportInput(tuple(models), tuple(evaluations), tuple(issues))
    scores = source.evaluation.sessions
    runs = sum(len(score.runs) for score in scores)
    names = ", ".join(score.name for score in scores) if len(scores) <= MOST_NAMES else f"{len(scores)} sessions"
    subtitle = f"{source.model.robot.name} · {names} · {plural(runs, 'run')}"
    return write_report(path, "Does the model follow the arm?", evaluation_sections(source), subtitle)
