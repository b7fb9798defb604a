"""The report: one self-contained page, the verdict first."""

from typing import TYPE_CHECKING

from ident.lazy import lazily

if TYPE_CHECKING:
    from ident.show.report.diagnosis_pages import write_diagnosis_report as write_diagnosis_report
    from ident.show.report.evaluation import ReportInput as ReportInput
    from ident.show.report.evaluation import write_evaluation_report as write_evaluation_report

# The words of a verdict are asked for by the terminal too, which needs no pictures.
_HOMES = {
    "ReportInput": "ident.show.report.evaluation",
    "write_diagnosis_report": "ident.show.report.diagnosis_pages",
    "write_evaluation_report": "ident.show.report.evaluation",
}
__getattr__, __dir__ = lazily(__name__, _HOMES)
