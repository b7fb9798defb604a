"""Which sections make a page of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.recordings.recording import TelemetryIssue
from ident.show.report.confusion import ConfusionSection
from ident.show.report.diagnosis_verdict import DiagnosisVerdictSection
from ident.show.report.findings import FindingsSection
from ident.show.report.next_steps import OutlookSection
from ident.show.report.page import Section, render_page, save_page
from ident.show.report.pages import evaluation_sections
from ident.show.report.provenance import FactsSection, describe_origin, provenance_facts
from ident.show.report.source import DiagnosisInput, ReportInput
from ident.show.report.telemetry import TelemetrySection
from ident.show.report.verdict import VerdictSection
from ident.show.report.where import WhereSection


def diagnosis_sections(source: DiagnosisInput) -> list[Section]:
    """All sections of a diagnosis, the verdict first."""
    issues = [
        TelemetryIssue(one["issue"], tuple(one["joints"]), one["severity"], one["evidence"], one["remedy"])
        for one in source.record.get("telemetry", [])
    ]
    return [
        DiagnosisVerdictSection(source),
        FindingsSection(source),
        WhereSection(source),
        OutlookSection(source),
        ConfusionSection(source.confusion),
        TelemetrySection(issues),
        FactsSection(source.provenance or provenance_facts(source.record)),
    ]


def write_diagnosis_report(
    path: str | Path, diagnosis: DiagnosisInput | Mapping[str, Any], evaluation: ReportInput | None = None
) -> Path:
    """Writes the page of a diagnosis, whole or not at all.

    Args:
        path: The file to be written.
        diagnosis, evaluation: As for `render_diagnosis_report`.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_diagnosis_report(diagnosis, evaluation))


def render_diagnosis_report(
    diagnosis: DiagnosisInput | Mapping[str, Any], evaluation: ReportInput | None = None
) -> str:
    """The page of a diagnosis as text.

    Args:
        diagnosis: The record of `ident.diagnosis/1`, alone or with confusion and provenance.
        evaluation: A model's evaluation, shown below the diagnosis if given.
    """
    source = diagnosis if isinstance(diagnosis, DiagnosisInput) else DiagnosisInput(diagnosis)
    sections = diagnosis_sections(source)
    if evaluation is not None:
        shown = {section.anchor for section in sections if section.is_present}
        sections += [s for s in evaluation_sections(evaluation) if _is_new(s, shown)]
    title = f"{source.record['robot']}: why does the arm not move as its model says?"
    return render_page(title, sections, describe_origin(source.record))


def _is_new(section: Section, told: set[str]) -> bool:
    return not isinstance(section, VerdictSection) and section.anchor not in told
