"""Laws of sets of changes by log evidence, and of the probabilities that are fitted to pairs with
truth.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.benchmark.change_calibration import Fitted, fit, write
from ident.benchmark.law_shares import Widths
from ident.benchmark.leave_out import Problem
from ident.diagnosis.change.change_features import describe_changes, later_scorers
from ident.diagnosis.change.change_sets import choose_set
from ident.diagnosis.change.laws import PLAIN_FRICTION
from ident.diagnosis.change.looks import hidden_changes
from ident.diagnosis.change.name_changes import other_places
from ident.diagnosis.change.paired_design import PairedDesign, build_design
from ident.inference.calibration import load_names
from ident.inference.estimate import CLASS_ODDS
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import COULOMB, SLIP, Plant, at_joint, record

OFFSET = 0.7  # [N m]


def wrong_everywhere(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return at_joint(2, 1.5 * np.sin(2 * q[:, 2])) + 0.15 * arm.inverse_dynamics(q, dq, ddq)


def with_offset(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return wrong_everywhere(arm, q, dq, ddq) + at_joint(0, np.full(len(q), OFFSET))


def designed(arm: ArmModel, plant: Plant) -> PairedDesign:
    return build_design(record(arm, wrong_everywhere, range(4)), record(arm, plant, range(50, 54)), arm)


def test_the_likeliest_set_holds_what_changed(three_joints: ArmModel) -> None:
    """Law: what changed is of the class of most evidence, at its joint; later folds gain by it, far
    beyond the runs.

    An offset and friction that differs by the direction are nearly one in motion.
    """
    design = designed(three_joints, with_offset)
    found = choose_set(design, hidden_changes(design))
    described = describe_changes(found, later_scorers(found))
    most = max(described, key=lambda one: one.features["log_nats"])
    assert most.features["folds_that_gain"] == 1.0
    assert most.features["log_size_over_runs"] > np.log(4.0)
    alike = {most.group.key[:2]} | set(other_places(most, 1.0))
    alike |= {key[:2] for key, deficit in most.rivals.items() if deficit < np.log(CLASS_ODDS)}
    assert ("torque_offset", 0) in alike
    assert {joint for _, joint in alike} == {0}


def test_two_laws_that_do_the_same_share_the_evidence_in_their_turns(three_joints: ArmModel) -> None:
    """Law: what all changes add in their turns is what the set adds; of two that each may do nearly all of it the
    likelier is told with it, though beside the other it adds little.
    """
    design = designed(three_joints, with_offset)
    found = choose_set(design, hidden_changes(design))
    first = describe_changes(found, later_scorers(found))[0]
    rivals = [
        group
        for group in found.search.names.groups
        if group.key in first.rivals and group.key[1] == first.group.joint and len(group.columns) <= 2
    ]
    second = max(rivals, key=lambda group: found.search.nats([group]))
    both = replace(found, chosen=(second, first.group))
    described = describe_changes(both, later_scorers(both))
    assert [one.group for one in described] == [first.group, second]
    nats = [float(np.sign(x) * np.expm1(abs(x))) for x in (one.features["log_nats"] for one in described)]
    assert sum(nats) == pytest.approx(found.search.nats(both.chosen), rel=1e-6)
    assert nats[0] == pytest.approx(found.search.nats([first.group]), rel=1e-6)
    assert nats[0] > 0.9 * sum(nats)


def test_of_an_arm_that_did_not_change_the_runs_say_little(three_joints: ArmModel) -> None:
    """Law: beside the differences between runs of one set no change of an unchanged arm has more
    than a few nats.
    """
    design = designed(three_joints, wrong_everywhere)
    found = choose_set(design, hidden_changes(design))
    described = describe_changes(found, later_scorers(found))
    assert all(one.features["log_nats"] < np.log1p(10.0) for one in described)


def rubs_more(share: float) -> Plant:
    def plant(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        more = share * COULOMB[1] * np.tanh(dq[:, 1] / SLIP)
        return wrong_everywhere(arm, q, dq, ddq) + at_joint(1, more)

    return plant


def test_friction_of_another_day_is_worth_less_the_more_days_differ(three_joints: ArmModel) -> None:
    """Law: beside friction that differs from day to day a change of friction loses evidence, by far
    most of it where it is no larger than days make it; one of half as much again keeps enough for
    any name.
    """
    left = {}
    for share in (0.03, 0.5):
        design = designed(three_joints, rubs_more(share))
        (group,) = (one for one in design.sums.evidence.layout.groups if one.key == (PLAIN_FRICTION, 1, None))
        found = choose_set(design, frozenset())
        left[share] = found.search.nats([group])
    assert left[0.03] < 3.0
    assert left[0.5] > 30.0


def test_a_fit_learns_what_tells_right_from_wrong_and_is_read_again(tmp_path: Path) -> None:
    """Law: of arms left out what is right is likelier; a file gives the probabilities that were
    fitted.
    """
    rng, count = np.random.default_rng(2), 200
    right = rng.uniform(size=count) < 0.5
    names = ("log_nats", "gain_in_errors", "others_here")
    features = rng.standard_normal((count, len(names)))
    features[:, 0] += 2.0 * right
    arms = np.array([f"arm_{k % 5}" for k in range(count)])
    rows = Problem(features, names, right, np.ones(count), arms, {"log_nats": 1, "others_here": -1})
    model, ridge, held_out = fit(rows)
    assert "log_nats" in model.names
    widths = Widths(1.1, 0.02, 0.0, 0.95, 40)
    assert held_out[right].mean() > held_out[~right].mean() + 0.3
    out = tmp_path / "calibration_changes.toml"
    write(Fitted(model, ridge, held_out, 0.2, widths, count), rows, out)
    calibration = load_names(out)
    assert calibration.temper == 0.2
    assert calibration.widths is not None
    assert calibration.widths.share == 0.02
    again = calibration.names.probability(dict(zip(names, features[0], strict=True)))
    kept = [names.index(name) for name in model.names]
    assert again == pytest.approx(model.probability(features[:1, kept])[0], rel=1e-9)
