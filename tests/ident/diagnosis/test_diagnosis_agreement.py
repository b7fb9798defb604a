"""A constant of the arm is the same in every run."""

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.detection_limits import SizeLimit, encoder_share, find_limits
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.reservations import find_heterogeneous
from ident.diagnosis.selection.agreement import compare_sizes, measure_agreement
from ident.diagnosis.selection.search import Search
from ident.effects.catalogue import find_effect
from ident.regression.block_sums import SymmetricSums
from ident.regression.design import Group
from ident.regression.least_squares import project
from ident.regression.noise import Whitening
from ident.robot.arm import ArmModel
from ident.show.terminal import describe_limits, limit_rows
from tests.ident.diagnosis.planted import (
    analyse,
    load_friction,
    load_friction_on_2,
    named,
    named_groups,
    search_of,
    stribeck_on_1,
)
from tests.schemas import check_record


@pytest.fixture(scope="module")
def analysis(short_arm: ArmModel) -> Analysis:
    return analyse(short_arm, load_friction_on_2)


def test_what_is_in_every_run_agrees(analysis: Analysis) -> None:
    """Law: of a cause that is there the sizes differ by little, around that of the whole."""
    search, groups = search_of(analysis), named_groups(analysis)
    found = measure_agreement(search, groups, 0)
    assert found.between_fold_std < 0.15
    assert found.smallest < 1.01
    assert found.largest > 0.99
    assert not find_heterogeneous(search, groups, [0])


def test_a_run_that_hardly_moves_is_no_witness() -> None:
    """Law: −0.05 ± 3 of a size beside five runs of 1 ± 0.05 is no difference; −0.05 ± 0.05 is one, of that run."""
    blocks, seen = np.full(6, 8.0), np.full(6, 400.0)
    size = np.array([0.02, -0.03, 0.01, -0.02, 0.02, -1.05])
    still = compare_sizes(size, seen, np.where(size < -1.0, 3600.0 * seen, seen), blocks)
    assert still.p_value > 0.1
    assert still.between_fold_std < 0.1
    assert still.smallest > 0.8
    moving = compare_sizes(size, seen, seen, blocks)
    assert moving.p_value < 1e-6
    assert moving.between_fold_std > 0.3
    assert moving.smallest < 0.1


def test_what_the_urdf_is_off_by_is_no_difference() -> None:
    """Law: sizes that differ as an error of the fixed inertias makes them differ agree; any others do not."""
    blocks, seen, felt = np.full(6, 8.0), np.full(6, 400.0), np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0])
    shared = 0.25 * np.outer(felt, felt)
    assert compare_sizes(0.6 * felt, seen, seen, blocks, shared).p_value > 0.1
    assert compare_sizes(0.6 * felt, seen, seen, blocks).p_value < 1e-6
    assert compare_sizes(0.6 * np.abs(felt), seen, seen, blocks, shared).p_value < 1e-6


def without_it_in_half_of_the_runs(analysis: Analysis) -> tuple[Search, Group]:
    """The search of a session whose only name is taken out of half of its runs, and that name."""
    search, group = search_of(analysis), analysis.search.accepted[0].group
    evidence = search.evidence
    whole = project(evidence.gram(), evidence, search.prior, [group])
    local = list(evidence.layout.local[group.joint])
    sums = evidence.free[group.joint].part(np.arange(len(local)))
    without = evidence.fold_of_block < evidence.fold_of_block.max() / 2
    pieces, gone = evidence.friction.sums[group.joint].copy(), without[evidence.friction.block]
    for column in group.columns:
        at, size = local.index(column), whole.estimate[np.flatnonzero(whole.inside == column)[0]]
        sums[without, :, -1] -= size * sums[without, :, at]
        sums[without, -1, :] -= size * sums[without, at, :]
        pieces[gone, :, -1] -= size * pieces[gone, :, at]
    free = tuple(SymmetricSums.of(sums) if j == group.joint else one for j, one in enumerate(evidence.free))
    tied = tuple(pieces if j == group.joint else one for j, one in enumerate(evidence.friction.sums))
    friction = replace(evidence.friction, sums=tied)
    other = replace(search, evidence=replace(evidence, free=free, friction=friction))
    return other, group


def test_what_is_in_half_of_the_runs_does_not(analysis: Analysis) -> None:
    """Law: a size that is there in some runs and not in others is no constant, and is told so in words."""
    other, group = without_it_in_half_of_the_runs(analysis)
    found = measure_agreement(other, [group], 0)
    assert found.p_value < 1e-6
    assert found.between_fold_std > 0.5
    assert "is the same in all parts of the recordings" in find_heterogeneous(other, [group], [0])[0]


def test_what_acts_beyond_a_bound_may_differ(short_arm: ArmModel) -> None:
    """Law: how large a law of slow motion seems hangs on how slow a run is: nothing is said against it."""
    other, group = without_it_in_half_of_the_runs(analyse(short_arm, stribeck_on_1))
    assert measure_agreement(other, [group], 0).between_fold_std > 0.3
    assert not find_heterogeneous(other, [group], [0])


def test_a_heavier_link_is_so_in_every_run(short_arm: ArmModel) -> None:
    """Law: against the URDF fixed a link's error has one size in all runs, though tuning hides most of it."""

    def heavier(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        links = arm.inertial_parameters.reshape(arm.n, 10).copy()
        links[1] *= 1.3
        true = arm.with_inertial_parameters(links.ravel())
        return true.inverse_dynamics(q, dq, ddq) - arm.inverse_dynamics(q, dq, ddq)

    analysis = analyse(short_arm, heavier, [find_effect("link_inertial_error")])
    search, groups = search_of(analysis), [one for one in analysis.evidence.layout.groups if one.joint == 1]
    hidden, tuned = (measure_agreement(search, groups, 0, absorbed) for absorbed in (True, False))
    assert hidden.between_fold_std < 0.1
    assert abs(hidden.largest - 1.0) < 0.1
    assert hidden.largest - hidden.smallest <= tuned.largest - tuned.smallest


@pytest.mark.parametrize(("multiple", "is_named"), [(0.2, False), (1.2, True)])
def test_what_lies_beyond_the_limit_is_named(
    short_arm: ArmModel, healthy: Analysis, multiple: float, is_named: bool
) -> None:
    """Law: of an effect the limit is told by a session without it; well above it is named, well below it is not."""
    told = healthy.diagnosis.to_dict()["detectable"]
    (limit,) = [one for one in told if one["effect"] == "load_dependent_friction" and one["joints"] == ["joint_2"]]
    assert limit["figure"] == "mu"
    found = analyse(short_arm, load_friction(multiple * limit["limit"]))
    assert (("load_dependent_friction", "joint_2") in named(found)) == is_named
    after = found.diagnosis.to_dict()["detectable"]
    still = [one for one in after if one["effect"] == "load_dependent_friction" and one["joints"] == ["joint_2"]]
    assert len(still) == (not is_named)


def limits(analysis: Analysis, inflation: float) -> dict[tuple[str, int], SizeLimit]:
    """Limits where blocks vary more than the noise model says, by a factor."""
    evidence, search = analysis.evidence, search_of(analysis)
    views = (
        project(evidence.gram(), evidence, search.prior, named_groups(analysis)),
        project(evidence.gram(), evidence, search.fixed.prior),
    )
    found = find_limits(search, analysis.search, views, inflation, analysis.session)
    return {(one.effect.id, one.joint): one for one in found}


def test_the_record_and_the_lines(healthy: Analysis) -> None:
    record = check_record(healthy.diagnosis.to_dict())
    assert {one["effect"] for one in record["detectable"]} >= {"payload", "torque_delay", "spring_torque"}
    assert all(one["limit"] is None or one["limit"] > 0.0 for one in record["detectable"])
    line = describe_limits(record)
    assert line.startswith("would have been named")
    assert "torque delay above" in line
    assert len(limit_rows(record)) == len(record["detectable"])
    assert describe_limits({"verdict": "refused"}) == ""


def test_the_share_of_encoder_noise() -> None:
    """Law: none where the torque's own noise is all there is; three quarters where it has half the amplitude."""
    white = np.array([[1.0, 0.0], [1.0, 0.0]])
    shares = encoder_share(Whitening(white, np.ones(2), np.array([1.0, 0.5])))
    np.testing.assert_allclose(shares, [0.0, 0.75])
    slow = Whitening(np.array([[1.0, -0.9]]), np.ones(1), np.array([1.0 / np.sqrt(1.0 - 0.81)]))
    np.testing.assert_allclose(encoder_share(slow), [0.0], atol=1e-6)


def test_limits_of_noise_grow_with_it(healthy: Analysis) -> None:
    """Law: four times the variance, twice the limit, where noise sets it; no limit falls."""
    quiet, loud = limits(healthy, 100.0), limits(healthy, 400.0)
    assert quiet.keys() == loud.keys()
    pairs = [(one, loud[key]) for key, one in quiet.items() if not one.effect.typical.inverse and one.value]
    assert all(after.value is None or after.value >= one.value * (1.0 - 1e-9) for one, after in pairs if one.value)
    noisy = [(one, after) for one, after in pairs if one.bound_by == "torque" and after.value and one.value]
    assert noisy
    for one, after in noisy:
        assert after.value == pytest.approx(2.0 * one.value)  # type: ignore[operator]
