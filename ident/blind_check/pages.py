"""The page of a check, and a page of each diagnosis that was confidently wrong."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.blind_check.edit_section import EditSection
from ident.blind_check.sections import (
    BaselineSection,
    BlindVerdictSection,
    CalibrationSection,
    CoverageSection,
    SealSection,
    StrataSection,
    WrongSection,
)
from ident.blind_check.summary import BlindReport
from ident.blind_check.sure_sections import ClassSetsSection, RanksSection
from ident.blind_check.worlds_section import WorldsSection
from ident.show.report.confusion import ConfusionSection
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.page import Section, write_report
from ident.show.report.provenance import FactsSection

PAGE_NAME, WRONG_FOLDER = "index.html", "wrong"


def blind_sections(report: BlindReport) -> list[Section]:
    """All sections of a check, the verdict first."""
    return [
        BlindVerdictSection(report),
        StrataSection(report),
        WorldsSection(report),
        ConfusionSection(report.confusion),
        BaselineSection(report),
        CalibrationSection(report),
        CoverageSection(report),
        RanksSection(report),
        ClassSetsSection(report),
        EditSection(report),
        WrongSection(report, WRONG_FOLDER),
        SealSection(report),
        FactsSection(report.run),
    ]


def write_blind_pages(report: BlindReport, diagnoses: Mapping[str, Mapping[str, Any] | None], out: Path) -> Path:
    """Writes the page, and below it the diagnoses of the cases that were confidently wrong.

    Args:
        report: The check.
        diagnoses: The record of `ident.diagnosis/1` of each case, None where it failed.
        out: Folder.

    Returns:
        Path of the page.
    """
    for one in report.confidently_wrong:
        record = diagnoses.get(one.name)
        if record is not None:
            write_diagnosis_report(out / WRONG_FOLDER / f"{one.name}.html", record)
    subtitle = f"{report.robot} · {len(report.outcomes)} cases · seed {report.seed}"
    return write_report(out / PAGE_NAME, "Does the diagnosis find what was hidden?", blind_sections(report), subtitle)
