"""Numbers that a check speaks for: from what healthy arms leave, and from how often names are right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.blind_check.calibration import ALARMS, calibrate, write_calibration
from ident.blind_check.cases import Slot
from ident.blind_check.scoring import Outcome, score_case
from ident.blind_check.summary import BlindReport
from ident.diagnosis.settings import USUAL
from ident.diagnosis.settings_file import read_settings
from ident.errors import InputError
from ident.ownership import require_own_file


def healthy(seed: int, count: int = 200) -> list[Outcome]:
    """Arms whose largest leftover is log-normal."""
    left = np.exp(np.random.default_rng(seed).normal(-0.25, 0.05, count))
    one = score_case(Slot("case", "healthy", amplitude=0.0), answer(), result(verdict="no_gap"))
    return [replace(one, leftover=float(value)) for value in left]


def singles(right: int, wrong: int, verdict: str, p: float) -> list[Outcome]:
    """Single effects whose name is right, or wrong."""
    slot, true = Slot("case", "single", amplitude=3.0), answer(truth())
    good = score_case(slot, true, result(finding("stribeck_friction", "joint_2", p=p), verdict=verdict))
    bad = score_case(slot, true, result(finding("payload", "joint_2", p=p), verdict=verdict))
    return [good] * right + [bad] * wrong


def test_two_seeds_agree_within_what_they_tell() -> None:
    """Law: the threshold is what one healthy arm in so many exceeds; intervals of two draws overlap and hold it."""
    true = USUAL.verdict.stands_out * np.exp(-0.25 + 2.5758 * 0.05)
    assert ALARMS == 200
    first, second = (calibrate(healthy(seed))[0] for seed in (1, 2))
    for one in (first, second):
        assert one.low < true < one.high
        assert one.value == pytest.approx(true, rel=0.03)
    assert first.low < second.value < first.high


def test_names_are_believed_as_often_as_they_were_right() -> None:
    """Law: shares right, where nothing is left open, where some of the gap is and where most is; what was believed
    counts a bit.
    """
    surest = USUAL.selection.most_sure
    cases = singles(38, 2, "named", surest) + singles(10, 10, "partial", USUAL.verdict.trust_if_open * surest)
    wide = USUAL.verdict.trust_if_wide_open
    cases += singles(2, 18, "none_of_catalogue", wide * surest)
    found = {one.name: one for one in calibrate(cases)}
    assert found["most_sure"].value == pytest.approx((38 + 4 * surest) / 44)
    assert found["trust_if_open"].value == pytest.approx((10 + 4 * USUAL.verdict.trust_if_open) / 24)
    assert found["trust_if_open"].low < 0.5 < found["trust_if_open"].high
    assert found["trust_if_wide_open"].value == pytest.approx((2 + 4 * wide) / 24)
    assert calibrate(cases[:5]) == ()


def test_the_file_is_one_that_a_diagnosis_takes(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    report = BlindReport("tm5-900", 7, {}, tuple(healthy(3)), {"worlds": "all"})
    (told, *_) = write_calibration(path, report)
    assert read_settings(path).verdict.stands_out == pytest.approx(told.value, rel=1e-3)
    require_own_file(path)  # a check that goes on may write it again
    with pytest.raises(InputError, match="say too little"):
        write_calibration(path, replace(report, outcomes=report.outcomes[:3]))
    assert read_settings(path).verdict.stands_out == pytest.approx(told.value, rel=1e-3)
