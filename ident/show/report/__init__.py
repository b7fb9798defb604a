"""The report: one self-contained page, the verdict first."""

from typing import TYPE_CHECKING

from ident.lazy import lazily

if TYPE_CHECKING:
    from ident.show.report.diagnosis_pages import write_diagnosis_report as write_diagnosis_report
    from ident.show.report.page import Section as Section
    from ident.show.report.page import write_report as write_report
    from ident.show.report.pages import evaluation_sections as evaluation_sections
    from ident.show.report.pages import write_evaluation_report as write_evaluation_report
    from ident.show.report.source import DiagnosisInput as DiagnosisInput
    from ident.show.report.source import ReportInput as ReportInput

# The words of a verdict are asked for by the terminal too, which needs no pictures.
_HOMES = {
    "DiagnosisInput": "ident.show.report.source",
    "ReportInput": "ident.show.report.source",
    "Section": "ident.show.report.page",
    "evaluation_sections": "ident.show.report.pages",
    "write_diagnosis_report": "ident.show.report.diagnosis_pages",
    "write_evaluation_report": "ident.show.report.pages",
    "write_report": "ident.show.report.page",
}
__getattr__, __dir__ = lazily(__name__, _HOMES)
