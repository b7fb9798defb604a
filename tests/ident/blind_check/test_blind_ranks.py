"""Where the truth lies in what was told of it: flat where intervals are honest, told where they are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.arrays import Array
from ident.blind_check.cases import Slot
from ident.blind_check.pages import write_blind_pages
from ident.blind_check.ranks import RankHistogram, count_ranks, kuiper_p_value, place_of_truth
from ident.blind_check.scoring import score_case
from ident.blind_check.statistics import Z
from ident.blind_check.summary import BlindReport
from tests.schemas import check_record


def ranks_of(away: Array, width: float = 1.0) -> RankHistogram:
    """Of figures that are so far from the truth, told with so many standard deviations of one case each."""
    places = [place_of_truth(one, 0.0, -Z * width, Z * width) for one in away]
    return count_ranks([one for one in places if one is not None], [str(i) for i in range(len(places))])


def test_ends_of_an_interval_are_its_quantiles() -> None:
    """Law: 2.5, 50 and 97.5 %, whatever the two widths; without a width there is no law, and half a one is a step."""
    told = [place_of_truth(true, 1.0, 0.5, 3.0) for true in (0.5, 1.0, 3.0)]
    assert told == pytest.approx([0.025, 0.5, 0.975], abs=1e-6)
    assert place_of_truth(2.0, 1.0, 1.0, 1.0) is None
    assert [place_of_truth(true, 1.0, 1.0, 3.0) for true in (0.9, 1.0)] == [0.0, 0.5]


def test_an_angle_goes_round_the_circle() -> None:
    """Law: whole turns of the truth change nothing, and angles around a circle that is nearly filled lie evenly."""
    near, turned = (place_of_truth(true, 3.1, 2.9, 3.3, circular=True) for true in (-3.1, 2.0 * np.pi - 3.1))
    assert near == pytest.approx(turned)
    assert near == pytest.approx(place_of_truth(2.0 * np.pi - 3.1, 3.1, 2.9, 3.3))
    drawn = np.random.default_rng(1).normal(0.0, np.pi / Z, 2000)
    places = [place_of_truth(one, 0.0, -np.pi, np.pi, circular=True) for one in drawn]
    assert kuiper_p_value(np.array(places)) > 0.01
    assert place_of_truth(np.pi - 1e-9, 0.0, -np.pi, np.pi, circular=True) == pytest.approx(1.0)


def test_honest_intervals_give_flat_ranks() -> None:
    """Law: 95 % of bins lie in their band, a bit more of whole numbers, and p-values below 5 % come 5 % of the time."""
    generator = np.random.default_rng(2)
    drawn = [ranks_of(generator.normal(size=100)) for _ in range(1000)]
    inside = np.mean([one.band[0] <= count <= one.band[1] for one in drawn for count in one.bins])
    assert 0.95 <= inside < 0.975
    assert np.mean([(one.p_value or 0.0) < 0.05 for one in drawn]) == pytest.approx(0.05, abs=0.02)
    assert np.mean([one.is_odd for one in drawn]) < 0.02


@pytest.mark.parametrize(
    ("width", "shift", "words"),
    [
        (0.5, 0.0, "intervals too narrow"),
        (2.0, 0.0, "intervals too wide"),
        (1.0, 0.7, "figures told too low"),
        (1.0, -0.7, "figures told too high"),
    ],
)
def test_what_is_wrong_with_intervals_is_told(width: float, shift: float, words: str) -> None:
    """Law: intervals halved give a U, doubled a hump, figures beside the truth a slope, each with p < 0.01."""
    ranks = ranks_of(np.random.default_rng(3).normal(shift, 1.0, 200), width)
    assert ranks.p_value is not None
    assert ranks.p_value < 0.01
    assert ranks.words == words
    ends, middle = ranks.bins[0] + ranks.bins[9], ranks.bins[4] + ranks.bins[5]
    if shift == 0.0:
        assert (ends > 2 * ranks.band[1]) == (width < 1.0)
        assert (middle > 2 * ranks.band[1]) == (width > 1.0)
    else:
        assert (ranks.bins[9] > ranks.band[1], ranks.bins[0] > ranks.band[1]) == (shift > 0.0, shift < 0.0)


def test_figures_of_one_case_count_as_one() -> None:
    """Law: the same figure told five times makes no p-value smaller than once."""
    generator = np.random.default_rng(4)
    cases = [str(i // 5) for i in range(150)]
    alarms = [
        (count_ranks(list(np.repeat(generator.uniform(size=30), 5)), cases).p_value or 0.0) < 0.05 for _ in range(200)
    ]
    assert np.mean(alarms) < 0.06


def test_of_few_cases_nothing_is_said() -> None:
    assert count_ranks([0.999] * 20, ["one"] * 20).words == "too few to say"
    assert count_ranks([], []).to_dict()["count"] == 0


def test_a_check_tells_its_ranks(tmp_path: Path) -> None:
    """Record, page and lines: of all figures, and of each of which there are enough."""
    generator = np.random.default_rng(5)
    true = answer(truth(amplitude_Nm=1.0))
    ends = [(one - 0.05, one + 0.05) for one in 1.0 + 0.1 * generator.normal(size=40)]
    cases = [
        score_case(
            Slot(f"case_{i}", "single", amplitude=3.0),
            true,
            result(finding("stribeck_friction", "joint_2", amplitude_Nm=one)),
        )
        for i, one in enumerate(ends)
    ]
    report = BlindReport("tm5-900", 7, {}, tuple(cases))
    record = check_record(report.to_dict())
    for one in (record["ranks"]["all"], record["ranks"]["figures"]["stribeck_friction.amplitude_Nm"]):
        assert sum(one["bins"]) == one["count"] == one["cases"] == 40
        assert one["p_value"] < 0.01
        assert one["words"] == "intervals too narrow"
    assert 0.0 <= record["outcomes"][0]["coverage"][0]["place"] <= 1.0
    assert "intervals too narrow" in report.summary()
    page = write_blind_pages(report, {}, tmp_path).read_text(encoding="utf-8")
    assert page.count(": intervals too narrow") == 2
