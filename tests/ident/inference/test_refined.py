"""Fine grids, calibrated probabilities, and what is left at a joint."""

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.effects.effect_info import TABLE
from ident.errors import InputError
from ident.inference.calibration import Odds, Term, load_calibration
from ident.inference.feature_words import FEATURE_WORDS
from ident.inference.features import power_at
from ident.inference.profile import DROP, profile_interval
from ident.inference.scales import signed_log, squashed
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, at_joint, load_arm


def test_a_refined_point_fits_no_worse(slowed: Analysis) -> None:
    """Law: among its fine grid's points an effect is at the best one, which fits at least as well as the coarse one."""
    coarse, fine = slowed.conclusion.inference.best, slowed.conclusion.fine
    for group in fine.chosen:
        others = [other for other in fine.chosen if other is not group]
        points = [point for point in fine.search.names.groups if point.key == group.key]
        fits = [fine.search.nats([*others, point]) for point in points]
        assert fine.search.nats(fine.chosen) >= max(fits) - 1e-6
    (stribeck,) = (group for group in fine.chosen if group.effect.id == "stribeck_friction")
    alone = fine.search.nats([stribeck]) - fine.search.names.log_odds[stribeck]
    point = next(group for group in coarse.chosen if group.key == stribeck.key)
    before = coarse.search.nats([point]) - coarse.search.names.log_odds[point]
    assert alone >= 0.999 * before


def test_a_fine_grid_comes_nearer_to_the_truth(slowed: Analysis) -> None:
    """Law: a Stribeck velocity of 0.06 rad/s, between the points of the coarse grid, is met within a fifth."""
    (name,) = slowed.conclusion.names
    assert name.group.variant.inner["stribeck_velocity_rad_s"] == pytest.approx(0.06, rel=0.2)
    grid = TABLE["effects"]["stribeck_friction"]["grid"]["stribeck_velocity_rad_s"]
    assert name.described.coarse.variant.inner["stribeck_velocity_rad_s"] in grid
    interval = name.estimate.parameters["amplitude_Nm"]
    assert interval.low < 6.0 < interval.high


def cable_on_3(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """A cable that pulls tight in the upper half of the travel: τ₃ = 3 max(q₃ − q₀, 0)² N m."""
    start = 0.2
    return at_joint(2, 3.0 * np.maximum(q[:, 2] - start, 0.0) ** 2)


def test_a_cable_at_the_end_of_the_way_is_hardly_a_spring(sprung: Analysis) -> None:
    """Law: what pulls in a part of the travel only is told as a spring far less surely than a spring is: by a tenth of
    the odds or less.
    """
    (spring,) = sprung.conclusion.names
    tied = analyse(load_arm(), cable_on_3).conclusion
    cables = [name for name in tied.names if name.group.effect.id == "spring_torque"]
    probabilities = [spring.estimate.probability, *(cable.estimate.probability for cable in cables)]
    sure, *unsure = [probability / (1.0 - probability) for probability in probabilities]
    assert max(unsure, default=0.0) < 0.1 * sure


@pytest.mark.parametrize("middle", [0.02, 0.05, 0.08])
def test_profile_of_a_parabola(middle: float) -> None:
    """Law: a profile that is a parabola in log x has its maximum and its 95 % ends exactly, wherever the grid lies."""
    x = np.log(np.array([0.005, 0.01, 0.03, 0.06, 0.15, 0.3]))
    width = 0.7
    falls = 5.0 - 0.5 * ((x - np.log(middle)) / width) ** 2
    found = profile_interval(x, falls, DROP)
    reach = width * np.sqrt(2 * DROP)
    assert found.value == pytest.approx(middle, rel=1e-9)
    assert found.low <= middle * np.exp(-reach) * (1 + 1e-9)
    assert found.high >= middle * np.exp(reach) * (1 - 1e-9)
    assert np.log(found.high / found.low) == pytest.approx(2 * reach, rel=1e-6)


def test_the_calibration_is_there_and_says_of_what() -> None:
    """Law: the shipped file can be read, all its numbers are finite, and each feature has words for a reader."""
    calibration = load_calibration()
    for odds in (calibration.names, calibration.gaps):
        assert np.isfinite(odds.intercept)
        for term in odds.terms.values():
            assert np.all(np.isfinite([term.weight, term.centre, term.scale]))
            assert term.scale > 0.0
    assert calibration.names.terms.keys() <= FEATURE_WORDS.keys()
    assert 0.0 < calibration.temper <= 1.0
    assert calibration.even_nats > 0.0


def test_probability_follows_the_weights() -> None:
    """Law: more of a feature of positive weight is likelier, of negative weight less likely; parts are the log odds."""
    odds = load_calibration().names
    middle = {name: term.centre for name, term in odds.terms.items()}
    for name, term in odds.terms.items():
        steps = [middle | {name: term.centre + size * term.scale} for size in (-2.0, -0.5, 0.0, 1.0, 3.0)]
        likely = [odds.probability(step) for step in steps]
        changes = np.diff(likely)
        assert np.all(changes * np.sign(term.weight) >= 0.0)
        assert np.all(np.abs(changes) > 0.0) or term.weight == 0.0
        assert all(0.0 < value < 1.0 for value in likely)
    parts = odds.parts(middle | {name: term.centre + term.scale for name, term in odds.terms.items()})
    assert parts == pytest.approx({name: term.weight for name, term in odds.terms.items()})


def test_what_is_no_number_says_nothing() -> None:
    odds = Odds(0.3, {"one": Term(2.0, 1.0, 0.5), "other": Term(1.0, 0.0, 1.0)})
    unknown = odds.probability({"one": np.nan, "other": 0.0})
    assert unknown == odds.probability({"one": 1.0, "other": 0.0})


def test_a_missing_calibration_is_told(tmp_path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="calibrate"):
        load_calibration(tmp_path / "none.toml")


def test_reasons_are_the_parts_of_the_odds(sprung: Analysis) -> None:
    """Law: an effect's reasons are what each feature adds, the largest first, each in words for its side."""
    (name,) = sprung.conclusion.names
    parts = sprung.conclusion.calibration.names.parts(name.described.features)
    reasons = name.estimate.reasons
    assert {reason.feature: reason.weight for reason in reasons} == pytest.approx(parts)
    sizes = [abs(reason.weight) for reason in reasons]
    assert sizes == sorted(sizes, reverse=True)
    for reason in reasons:
        assert reason.what == FEATURE_WORDS[reason.feature][reason.weight <= 0.0]
        assert reason.to_dict()["weight"] == abs(reason.weight)


def test_shares_of_a_class_are_its_probability(sprung: Analysis) -> None:
    """Law: an effect, its rivals and its other places share what the class has; odds are ratios of shares."""
    estimate = sprung.conclusion.names[0].estimate
    twins = replace(
        estimate,
        probability=0.4,
        rivals=(estimate.rivals[0], "torque_offset"),
        odds={"torque_offset": 2.0},
        places={1: 4.0},
    )
    assert twins.shares == pytest.approx({estimate.rivals[0]: 0.4, "torque_offset": 0.2})
    assert twins.class_probability == pytest.approx(0.7)


def test_sizes_on_a_log_scale_keep_their_order() -> None:
    """Law: both scales are monotone, odd, and zero at zero."""
    values = np.array([-1e6, -10.0, -0.1, 0.0, 0.1, 10.0, 1e6])
    logs = [signed_log(float(value)) for value in values]
    gains = [squashed(float(value), 1.0) for value in values]
    for scaled in (logs, gains):
        assert np.all(np.diff(scaled) > 0.0)
        assert scaled == pytest.approx([-value for value in scaled[::-1]])
    assert squashed(1.0, 0.0) > squashed(1.0, 1.0)


def test_what_is_left_is_told_of_every_joint(sprung: Analysis) -> None:
    """Law: each joint with rows has a share between zero and one, and beside the right name it is a gap nowhere."""
    conclusion = sprung.conclusion
    assert set(conclusion.joints) == {0, 1, 2}
    for left in conclusion.joints.values():
        assert 0.0 <= left.share <= 1.0
        assert all(np.isfinite(value) for value in left.features.values())
    assert conclusion.gap_probability().max() < 0.5


def test_the_power_of_an_effect_is_that_of_its_own_columns(slowed: Analysis) -> None:
    """Law: whitened squares of its torque, wherever its columns stand among a joint's."""
    model = slowed.conclusion.inference.best.model
    layout = model.sums.evidence.layout
    rng = np.random.default_rng(8)
    one_of_each = {group.key: group for group in layout.groups}
    assert any(group.effect.rows == "all" for group in one_of_each.values())
    for group in one_of_each.values():
        scaled = rng.standard_normal(len(group.columns))
        everywhere = np.zeros(layout.size + 1)
        everywhere[group.columns] = scaled
        for joint, local in enumerate(layout.local):
            own = everywhere[local]
            expected = own @ model.whole[joint] @ own
            assert power_at(model, group, scaled, [joint]) == pytest.approx(expected, rel=1e-9, abs=1e-9)
