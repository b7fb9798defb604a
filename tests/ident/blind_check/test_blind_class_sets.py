"""Odds at which classes hold the truth 19 times in 20."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.blind_check.calibration import calibrate, write_calibration
from ident.blind_check.cases import Slot
from ident.blind_check.class_sets import conformal_quantile, fewest_cases, measure_class_sets
from ident.blind_check.pages import write_blind_pages
from ident.blind_check.scoring import Outcome, score_case
from ident.blind_check.summary import BlindReport
from ident.diagnosis.settings_file import read_settings
from tests.schemas import check_record


def outcome(odds: float | None, named: bool = True, more: float = 500.0) -> Outcome:
    """A single effect: the true one named, another with these odds against it, or without having weighed it."""
    right = finding("stribeck_friction", "joint_2", p=0.96)
    wrong = {**finding("payload", "joint_2", p=0.96), "rivals": {"backlash": more}}
    if odds is not None and odds > 1.0:
        wrong["rivals"]["stribeck_friction"] = odds
    found = [right if odds == 1.0 else wrong] if named else []
    return score_case(Slot("case", "single", amplitude=3.0), answer(truth()), result(*found))


@pytest.mark.parametrize("count", [19, 40, 100])
def test_further_cases_are_held_as_often_as_asked(count: int) -> None:
    """Law: of exchangeable scores, with ties, long tails and a few without bound, at least 95 % of further ones are no
    larger; where a rank exists that is finite, at most one in n + 1 more.
    """
    generator = np.random.default_rng(count)
    draws = np.exp(3.0 * np.abs(generator.normal(size=(20000, count + 1))))
    smooth = np.mean([one[-1] <= conformal_quantile(one[:-1]) for one in draws])
    assert 0.945 < smooth < 0.955 + 1.0 / (count + 1)
    draws = np.where(generator.uniform(size=draws.shape) < 0.7, 1.0, draws)
    draws[generator.uniform(size=draws.shape) < 0.02] = inf
    assert np.mean([one[-1] <= conformal_quantile(one[:-1]) for one in draws]) > 0.945


def test_the_rank_is_that_of_the_finite_sample() -> None:
    """Law: the least of n scores at rank ⌈0.95 (n + 1)⌉; below 19 there is none."""
    assert fewest_cases() == 19
    assert conformal_quantile(range(1, 19)) == inf
    assert conformal_quantile(range(1, 20)) == 19
    assert conformal_quantile(range(1, 40)) == 38
    assert conformal_quantile(range(1, 41)) == 39


def test_odds_are_those_of_single_effects_with_a_name() -> None:
    """Law: what is right scores 1; healthy arms and cases without a name have no class, so no score."""
    cases = [outcome(1.0)] * 35 + [outcome(4.0)] * 3 + [outcome(25.00049)] + [outcome(None)]
    healthy = score_case(Slot("case", "healthy", amplitude=0.0), answer(), result(finding("payload", "joint_2")))
    sets = measure_class_sets([*cases, healthy, outcome(1.0, named=False)])
    assert (sets.cases, sets.not_weighed) == (40, 1)
    assert sets.odds == 25.01  # rounded up: no less than the score itself
    assert sets.low == 1.0
    assert sets.high == inf
    held = {one.odds: (one.holds.value, one.size.value) for one in sets.cuts}
    assert held[1.0] == (35 / 40, 1.0)
    assert held[10.0] == (38 / 40, pytest.approx(1.0 + 3 / 40))
    assert held[25.01] == (39 / 40, pytest.approx(1.0 + 4 / 40))


def test_what_cannot_be_reached_is_told(tmp_path: Path) -> None:
    """Too few cases, or too many in which the truth was not weighed: no number is written, and the reason is."""
    few = measure_class_sets([outcome(1.0)] * 18)
    assert few.odds is None
    assert "18 named effects, and 19 are needed" in few.words
    lost = [outcome(1.0)] * 37 + [outcome(None)] * 3
    sets = measure_class_sets(lost)
    assert sets.odds is None
    assert "90 % at the most: in 3 of 40" in sets.words
    assert "class_odds" not in [one.name for one in calibrate(lost)]
    write_calibration(tmp_path / "s.toml", BlindReport("tm5-900", 7, {}, tuple(lost)))
    assert "in 3 of 40 the true effect was not weighed" in (tmp_path / "s.toml").read_text(encoding="utf-8")
    assert measure_class_sets([]).to_dict()["odds"] is None


def test_a_diagnosis_takes_the_odds_that_were_calibrated(tmp_path: Path) -> None:
    """File, record, page and lines."""
    report = BlindReport("tm5-900", 7, {}, tuple([outcome(1.0)] * 35 + [outcome(12.3456)] * 5))
    write_calibration(tmp_path / "s.toml", report)
    assert read_settings(tmp_path / "s.toml").selection.class_odds == 12.35
    record = check_record(report.to_dict())
    assert record["class_sets"]["odds"] == 12.35
    assert record["scores"]["class_holds"] == 35 / 40
    assert record["outcomes"][-1]["odds"] == {"backlash": 500.0, "stribeck_friction": 12.3456}
    assert "class sets: 95 % hold the truth at odds of 12.35 [1 and more]" in report.summary()
    page = write_blind_pages(report, {}, tmp_path).read_text(encoding="utf-8")
    assert "Does the class hold the truth?" in page
    assert "for 95 %" in page
