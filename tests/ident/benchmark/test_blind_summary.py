"""All cases together: counts, intervals, calibration, and the page."""

from pathlib import Path

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.benchmark.cases import Slot
from ident.benchmark.pages import write_blind_pages
from ident.benchmark.scoring import Outcome, calibration_curve, calibration_error, mean, score_case, share
from ident.benchmark.summary import BlindReport
from tests.accessible import PHONE, find_violations, width_on_a_phone
from tests.schemas import check_record


def test_wilsons_interval() -> None:
    """8 of 10 (Wilson 1927; Newcombe 1998): 0.490 to 0.943; it stays inside [0, 1]."""
    score = share([True] * 8 + [False] * 2)
    assert (score.low, score.high) == pytest.approx((0.4902, 0.9433), abs=1e-3)
    assert share([True] * 5).high == 1.0
    assert share([]).value is None


def test_a_mean_lies_in_its_interval() -> None:
    score = mean([1.0, 2.0, 3.0])
    assert score.value == 2.0
    assert 1.0 <= score.low < 2.0 < score.high <= 3.0  # type: ignore[operator]


def test_calibration_error_is_zero_when_probabilities_are_meant() -> None:
    said = [0.75] * 100 + [0.25] * 100
    right = [True] * 75 + [False] * 25 + [True] * 25 + [False] * 75
    assert calibration_error(said, right).value == pytest.approx(0.0)
    assert calibration_error([1.0] * 10, [True] * 5 + [False] * 5).value == pytest.approx(0.5)
    assert [one.right.count for one in calibration_curve(said, right)] == [100, 100]


def outcomes() -> tuple[Outcome, ...]:
    """Two visible effects (one missed), a small one, two healthy sessions (one alarm), a refusal, a pair."""
    stribeck = answer(truth(amplitude_Nm=1.0))
    right = finding("stribeck_friction", "joint_2", amplitude_Nm=(0.9, 1.1))
    pair = answer(truth(), truth("payload", ""))
    return (
        score_case(Slot("case_0", "single", amplitude=3.0), stribeck, result(right)),
        score_case(Slot("case_1", "single", amplitude=1.0), stribeck, result(verdict="no_gap")),
        score_case(Slot("case_2", "single", amplitude=0.3), stribeck, result(right)),
        score_case(Slot("case_3", "healthy", amplitude=0.0), answer(), result(verdict="no_gap")),
        score_case(Slot("case_4", "healthy", amplitude=0.0), answer(), result(right)),
        score_case(Slot("case_5", "outside", amplitude=3.0), answer(truth("cable_drag")), result(verdict="partial")),
        score_case(Slot("case_6", "pair", amplitude=3.0), pair, result(right, finding("payload", "joint_3"))),
    )


@pytest.fixture
def report() -> BlindReport:
    cases = outcomes()
    return BlindReport("tm5-900", 7, {one.name: "ab" * 32 for one in cases}, cases, {"cases": len(cases)})


def test_scores_count_the_cases_that_they_speak_of(report: BlindReport) -> None:
    values = {name: (score.value, score.count) for name, score in report.scores.items()}
    assert values["strict"] == (0.5, 2)
    assert values["class_aware_small"] == (1.0, 1)
    assert values["false_alarm"] == (0.5, 2)
    assert values["false_alarm_decoy"] == (None, 0)
    assert values["refusal"] == (1.0, 1)
    assert values["set_f1"] == (1.0, 1)
    assert values["interval_coverage"] == (1.0, 2)


def test_the_record_is_the_contracts(report: BlindReport) -> None:
    record = check_record(report.to_dict())
    assert record["schema"] == "ident.blind/1"
    assert record["cases"] == 7
    assert record["confusion"] == {"stribeck_friction": {"stribeck_friction": 2, "no_gap": 1}}
    assert record["confidently_wrong"] == ["case_4"]
    assert record["baselines"]["lasso"]["strict"] == 0.0
    wanted = {"strict", "class_aware", "joint", "mean_class_size", "false_alarm", "refusal", "set_f1"}
    wanted |= {"shrink_vs_oracle", "calibration_error", "interval_coverage"}
    assert wanted <= record["scores"].keys()
    assert record["intervals"]["strict"] == pytest.approx([0.0945, 0.9055], abs=1e-3)
    assert np.isclose(record["seconds_per_case"], 5.0)


def test_everybody_can_read_the_page(report: BlindReport, tmp_path: Path) -> None:
    page = write_blind_pages(report, {}, tmp_path)
    assert find_violations(page, tmp_path) == []
    assert width_on_a_phone(page, tmp_path) <= PHONE


def test_the_page_tells_scores_and_links_wrong_cases(report: BlindReport, tmp_path: Path) -> None:
    page = write_blind_pages(report, {}, tmp_path).read_text(encoding="utf-8")
    assert "50 % of 2 visible effects found" in page
    assert 'href="wrong/case_4.html"' in page
    assert page.count("ab" * 32) == 7
