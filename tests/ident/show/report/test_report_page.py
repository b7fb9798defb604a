"""The page: whole, self-contained, well-formed; its figures are those of the evaluation."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.monitor.pages import write_pages
from ident.monitor.store import Store
from ident.monitor.watch import ArmHistory, Watch, make_history
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.evaluation import ReportInput, write_evaluation_report
from ident.show.report.laws import CURVES, _Law, draw_laws
from ident.show.report.page import coded
from ident.show.report.words import fixed
from tests.accessible import PHONE, find_violations, width_on_a_phone
from tests.ident.diagnosis.planted import analyse, gain_on_2, load_arm, stribeck_on_1
from tests.ident.show.report.reader import read
from tests.ident.show.report.test_report_diagnosis import RECORD


@pytest.fixture(scope="module")
def page(source: ReportInput, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    assert write_evaluation_report(path, source.models, source.evaluations, source.issues) == path
    return path.read_text(encoding="utf-8")


def test_page_needs_no_network(page: str) -> None:
    """Every address on the page is a place on it or data within it, and no style fetches anything."""
    reader = read(page)
    assert all(address.startswith(("#", "data:")) for address in reader.addresses)
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", page))
    assert "@import" not in page
    assert "script" not in reader.elements


def test_tables_hold_the_scores(page: str, source: ReportInput) -> None:
    """Every mean and standard deviation of the main model's ladder is on the page, rounded."""
    score = source.evaluation.pooled
    text = read(page).text
    for mean, std in zip(score.energy_mean.ravel(), score.energy_std.ravel(), strict=True):
        assert f"{fixed(mean)} ± {fixed(std)}" in text
    for mean, std in zip(score.rmse_mean.ravel(), score.rmse_std.ravel(), strict=True):
        assert f"{fixed(mean)} ± {fixed(std)}" in text


def test_page_shows_payload_models_issues_and_provenance(page: str) -> None:
    """The payload row, each model, each telemetry issue, each data hash: all there, and text from outside escaped."""
    text = read(page).text
    for shown in ("500 g", "half", "nearly all", "clipped effort", "move slower", "ab12" * 16, "numpy 2.0"):
        assert shown in text
    assert "<b>jitter</b>" not in page
    assert "2 % of <b>jitter</b>" in text


def test_no_option_of_a_command_is_broken_over_lines() -> None:
    """Law: an option is one piece, what is pasted is the command; names with hyphens may break."""
    told = coded("Run `ident patch a-b.json --json -o` --now.")
    assert told == (
        'Run <code>ident patch a-b.json <span class="whole">--json</span> <span class="whole">-o</span></code> --now.'
    )
    assert read(told).text.strip() == "Run ident patch a-b.json --json -o --now."


def test_a_run_of_the_fit_is_told(source: ReportInput, tmp_path: Path) -> None:
    """Where evaluated runs were in the fit, the page says so, and doesn't call them unseen."""
    clean = replace(source)
    assert clean.seen_runs() == 0
    model = source.model
    record = {"session": "E1", "file": "run_1.parquet", "sha256": "00"}
    seen = replace(model, provenance={**model.provenance, "data": [record]})
    models = tuple(seen if one is model else one for one in source.models)
    path = write_evaluation_report(tmp_path / "seen.html", models, source.evaluations)
    text = read(path.read_text(encoding="utf-8")).text
    assert "1 of the 4 runs judged here were in the fit" in text
    assert "never saw" not in text


def test_report_is_whole_or_not_there(source: ReportInput, tmp_path: Path) -> None:
    """A folder that can't be made leaves nothing behind, and names the remedy."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_evaluation_report(tmp_path / "file" / "r.html", source.models, source.evaluations)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_friction_is_drawn_over_speed_and_every_finding_has_a_picture() -> None:
    analysis = analyse(load_arm(), stribeck_on_1)
    pictures = draw_laws(analysis)
    assert len(pictures) == len(analysis.diagnosis.findings) > 0
    first = pictures[0]
    assert first is not None
    assert "over its speed" in first.caption
    assert "speed of joint_1 [rad/s]" in first.svg
    assert "friction [N m]" in first.svg


def test_a_gain_is_a_straight_line_over_the_torque_that_it_scales() -> None:
    """Law: whatever friction and rotor add to the load, the drawn law does not go up and down."""
    analysis = analyse(load_arm(), gain_on_2)
    (finding,) = analysis.diagnosis.findings
    assert finding.effect == "torque_gain_error"
    (picture,) = draw_laws(analysis)
    assert picture is not None
    assert "torque of joint_2 [N m]" in picture.svg
    law = _Law.of(analysis, finding)
    x = law.gathered([CURVES["torque"][2](item, law.joint) for item in law.items])
    assert np.corrcoef(x, law.gathered(law.torque))[0, 1] > 0.999


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


def test_page_is_well_formed(page: str) -> None:
    """Elements close in order, no id stands twice, and every reference finds its target."""
    reader = read(page)
    assert reader.open == []
    assert len(reader.ids) == len(set(reader.ids))
    targets = re.findall(r"url\(#([^)]*)\)", page) + [a[1:] for a in reader.addresses if a.startswith("#")]
    assert set(targets) <= set(reader.ids)
