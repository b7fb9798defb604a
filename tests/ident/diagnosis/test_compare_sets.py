"""Laws of sets of changes by log evidence, and of the probabilities that are fitted to pairs with truth."""

from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.benchmark.change_calibration import SIGNS, Rows, fit, write
from ident.diagnosis.change.change_sets import choose_set, describe_changes
from ident.diagnosis.change.compare import once_moved
from ident.diagnosis.change.name_changes import LikelyChange
from ident.diagnosis.change.paired_design import PairedDesign, build_design
from ident.inference.calibration import load_odds
from ident.inference.features import find_rivals
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import Plant, at_joint, record

OFFSET = 0.7  # [N m]


def wrong_everywhere(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return at_joint(2, 1.5 * np.sin(2 * q[:, 2])) + 0.15 * arm.inverse_dynamics(q, dq, ddq)


def with_offset(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return wrong_everywhere(arm, q, dq, ddq) + at_joint(0, np.full(len(q), OFFSET))


def designed(arm: ArmModel, plant: Plant) -> PairedDesign:
    return build_design(record(arm, wrong_everywhere, range(4)), record(arm, plant, range(50, 54)), arm)


def test_the_likeliest_set_holds_what_changed(three_joints: ArmModel) -> None:
    """Law: what changed is of the class of most evidence, at its joint; later folds gain by it, far beyond the runs.

    An offset and friction that differs by the direction are nearly one in motion.
    """
    design = designed(three_joints, with_offset)
    found = choose_set(design, once_moved(design))
    features = describe_changes(found)
    most = int(np.argmax([one["log_nats"] for one in features]))
    group = found.chosen[most]
    assert features[most]["folds_that_gain"] == 1.0
    assert features[most]["log_size_over_runs"] > np.log(4.0)
    change = LikelyChange(group, features[most], find_rivals(found.search, found.chosen, group), 0.9)
    alike = {group.key, *change.twins}
    assert ("torque_offset", 0, None) in alike
    assert {joint for _, joint, _ in alike} == {0}
    assert all(odds <= 20.0 for odds in change.twins.values())


def test_of_an_arm_that_did_not_change_the_runs_say_little(three_joints: ArmModel) -> None:
    """Law: beside the differences between runs of one set no change of an unchanged arm has more than a few nats."""
    design = designed(three_joints, wrong_everywhere)
    found = choose_set(design, once_moved(design))
    assert all(one["log_nats"] < np.log1p(10.0) for one in describe_changes(found))


def test_a_fit_learns_what_tells_right_from_wrong_and_is_read_again(tmp_path: Path) -> None:
    """Law: of arms left out what is right is likelier; a file gives the probabilities that were fitted."""
    rng, count = np.random.default_rng(2), 200
    right = rng.uniform(size=count) < 0.5
    features = rng.standard_normal((count, len(SIGNS)))
    features[:, 0] += 2.0 * right
    arms = np.array([f"arm_{k % 5}" for k in range(count)])
    rows = Rows(features, right, arms, np.arange(count).astype(str))
    model, ridge, held_out = fit(rows)
    assert held_out[right].mean() > held_out[~right].mean() + 0.3
    out = tmp_path / "calibration_changes.toml"
    write(model, ridge, rows, out)
    again = load_odds(out).probability(dict(zip(SIGNS, features[0], strict=True)))
    assert again == pytest.approx(model.probability(features[:1])[0], rel=1e-9)
