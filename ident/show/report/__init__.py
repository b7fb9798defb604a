"""The report: one self-contained page, the verdict first."""

from ident.lazy import lazily

TYPE_CHECKING = False
if TYPE_CHECKING:
    from ident.show.report.diagnosis_pages import write_diagnosis_report as write_diagnosis_report
    from ident.show.report.evaluation import ReportInput as ReportInput
    from ident.show.report.evaluation import write_evaluation_report as write_evaluation_report

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
