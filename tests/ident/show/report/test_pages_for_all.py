"""Pages can be read by everybody: no rule of axe-core is broken."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.monitor.pages import write_pages
from ident.monitor.store import Store
from ident.monitor.watch import ArmHistory, Watch, make_history
from ident.show.report import ReportInput, write_diagnosis_report, write_evaluation_report
from tests.accessible import PHONE, find_violations, width_on_a_phone
from tests.ident.show.report.test_report_diagnosis import RECORD


def test_the_page_of_an_evaluation(source: ReportInput, tmp_path: Path) -> None:
    """Of two models, whose tables are alike."""
    page = write_evaluation_report(tmp_path / "page.html", source.models, source.evaluations, source.issues)
    assert find_violations(page, tmp_path) == []
    assert width_on_a_phone(page, tmp_path) <= PHONE


def test_the_page_of_a_diagnosis_by_night(tmp_path: Path) -> None:
    page = write_diagnosis_report(tmp_path / "page.html", RECORD)
    assert find_violations(page, tmp_path, dark=True) == []
    assert width_on_a_phone(page, tmp_path) <= PHONE


def test_the_pages_of_a_watch(tmp_path: Path) -> None:
    """One arm that may be changing, one that is not."""
    rng = np.random.default_rng(5)
    found = Watch(tuple(_watched(name, size, rng) for name, size in (("arm_1", 15.0), ("arm_2", 0.0))))
    write_pages(tmp_path, found)
    arm = Store(tmp_path).page("arm_1")
    for page in (tmp_path / "index.html", arm):
        assert find_violations(page, tmp_path, dark=page == arm) == []
        assert width_on_a_phone(page, tmp_path) <= PHONE
    assert "perhaps dry friction of joint_1 since 2026-01-05" in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "No alarm yet, but look:</strong> dry friction of joint_1 may have" in arm.read_text(encoding="utf-8")


def _watched(arm: str, size: float, rng: np.random.Generator) -> ArmHistory:
    """Eight days of an arm whose friction grows by so many spreads after the fourth."""
    days = [f"2026-01-{day:02}" for day in range(1, 9)]
    rows = [
        {"arm": arm, "session": day, "date": day, "status": "done", "verdict": None, "reason": None} for day in days
    ]
    figures = [
        {"session": day, "date": day, "joint": f"joint_{joint}", "figure": figure, "value": value}
        | {"low": value - 0.2, "high": value + 0.2, "std": 0.1}
        for joint in range(1, 7)
        for figure in ("viscous", "coulomb")
        for k, day in enumerate(days)
        for value in [10.0 + rng.standard_normal() + size * (k >= 4 and (joint, figure) == (1, "coulomb"))]
    ]
    return make_history(arm, rows, figures)


def test_what_nobody_can_read_is_told(tmp_path: Path) -> None:
    """The check itself: pale words and a picture without any."""
    page = tmp_path / "page.html"
    page.write_text('<html lang="en"><body><main><img src="x"><p style="color: #bbb">pale</p></main></body></html>')
    found = {one.split(":")[0] for one in find_violations(page, tmp_path)}
    assert {"image-alt", "color-contrast"} <= found
