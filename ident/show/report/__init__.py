"""The report: one self-contained page, the verdict first."""

from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.page import Section, write_report
from ident.show.report.pages import evaluation_sections, write_evaluation_report
from ident.show.report.source import DiagnosisInput, ReportInput

__all__ = [
    "DiagnosisInput",
    "ReportInput",
    "Section",
    "evaluation_sections",
    "write_diagnosis_report",
    "write_evaluation_report",
    "write_report",
]
