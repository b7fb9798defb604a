"""Detection limits: what would have been named is named, what would not is not; noise hides what it must."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.detection_limits import SizeLimit, encoder_share, find_limits
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.next_experiment import next_experiment
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.regression.noise import Whitening
from ident.diagnosis.selection.search import Search
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.robot.arm import ArmModel
from ident.show.terminal import describe_limits, group_silent, limit_rows
from tests.ident.diagnosis.planted import SLIP, analyse, at_joint, named
from tests.schemas import check_record


def load_friction(share: float) -> Callable[[ArmModel, Array, Array, Array], Array]:
    """τ₂ = share |τ_rigid,₂| sign(dq₂)."""

    def law(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return at_joint(1, share * np.abs(arm.inverse_dynamics(q, dq, ddq)[:, 1]) * np.tanh(dq[:, 1] / SLIP))

    return law


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


def limits(analysis: Analysis, spare: float) -> dict[tuple[str, int], SizeLimit]:
    """Limits where blocks vary more than the noise model says, by a factor."""
    evidence, groups = analysis.evidence, [item.group for item in analysis.search.named]
    prior = Prior.of(evidence, analysis.baseline.prior)
    search = Search(evidence, prior, HeldOut(evidence, prior))
    views = project(evidence.gram(), evidence, prior, groups), project(evidence.gram(), evidence, search.fixed.prior)
    found = find_limits(search, analysis.search, views, spare, analysis.session)
    return {(one.effect.id, one.joint): one for one in found}


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


def test_the_record_and_the_lines(healthy: Analysis) -> None:
    record = check_record(healthy.diagnosis.to_dict())
    assert {one["effect"] for one in record["detectable"]} >= {"payload", "torque_delay", "spring_torque"}
    assert all(one["limit"] is None or one["limit"] > 0.0 for one in record["detectable"])
    line = describe_limits(record)
    assert line.startswith("would have been named")
    assert "torque delay above" in line
    assert len(limit_rows(record)) == len(record["detectable"])
    assert describe_limits({"verdict": "refused"}) == ""


def test_what_is_hidden_is_not_testable_and_no_motion_shows_it() -> None:
    """Law: the reason names the noise and the figure; the next experiment does not ask for it."""
    hidden = SizeLimit(find_effect("torque_offset", CATALOGUE), 1, "offset_Nm", 3.2, True, "encoder")
    told = hidden.untestable(("joint_1", "joint_2")).to_dict(("joint_1", "joint_2"))
    assert told["reason"] == "encoder noise of joint_2 hides offset_Nm below 3.2, more than is plausible"
    assert next_experiment([], [told]) is None
    assert group_silent([told])[0].startswith("not testable, as noise")
    nothing = SizeLimit(find_effect("payload", CATALOGUE), 0, "mass_kg", None, True, "tolerance")
    assert nothing.untestable(("joint_1", "joint_2")).reason == "the URDF's tolerance hides it whole"


def test_the_share_of_encoder_noise() -> None:
    """Law: none where the torque's own noise is all there is; three quarters where it has half the amplitude."""
    white = np.array([[1.0, 0.0], [1.0, 0.0]])
    shares = encoder_share(Whitening(white, np.ones(2), np.array([1.0, 0.5])))
    np.testing.assert_allclose(shares, [0.0, 0.75])
    slow = Whitening(np.array([[1.0, -0.9]]), np.ones(1), np.array([1.0 / np.sqrt(1.0 - 0.81)]))
    np.testing.assert_allclose(encoder_share(slow), [0.0], atol=1e-6)
