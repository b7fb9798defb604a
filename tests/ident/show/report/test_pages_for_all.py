"""Pages can be read by everybody: no rule of axe-core is broken."""

from __future__ import annotations

from pathlib import Path

from ident.show.report import DiagnosisInput, ReportInput, write_diagnosis_report, write_evaluation_report
from tests.accessible import find_violations
from tests.ident.show.report.test_report_diagnosis import RECORD


def test_the_page_of_an_evaluation(source: ReportInput, tmp_path: Path) -> None:
    """Of two models, whose tables are alike."""
    page = write_evaluation_report(tmp_path / "page.html", source.models, source.evaluations, source.issues)
    assert find_violations(page, tmp_path) == []


def test_the_page_of_a_diagnosis_by_night(tmp_path: Path) -> None:
    page = write_diagnosis_report(tmp_path / "page.html", DiagnosisInput(RECORD))
    assert find_violations(page, tmp_path, dark=True) == []


def test_what_nobody_can_read_is_told(tmp_path: Path) -> None:
    """The check itself: pale words and a picture without any."""
    page = tmp_path / "page.html"
    page.write_text('<html lang="en"><body><main><img src="x"><p style="color: #bbb">pale</p></main></body></html>')
    found = {one.split(":")[0] for one in find_violations(page, tmp_path)}
    assert {"image-alt", "color-contrast"} <= found
