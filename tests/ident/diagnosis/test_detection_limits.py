"""Detection limits: what would have been named, and what hides the rest."""

from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.detection_limits import SizeLimit, encoder_share, find_limits
from ident.diagnosis.diagnose import Analysis
from ident.inference.components import ModelSums
from ident.inference.infer import Inference, Inferred
from ident.inference.search import SetSearch
from ident.regression.noise import Whitening
from ident.robot.arm import ArmModel
from ident.show.untested_words import describe_limits, limit_rows
from tests.ident.diagnosis.planted import analyse, load_friction, named
from tests.schemas import check_record


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


def limits(analysis: Analysis, dispersion: float) -> dict[tuple[str, int], SizeLimit]:
    """Limits where every joint's rows have so many times the variance that the noise model says."""
    conclusion = analysis.conclusion
    model = conclusion.inference.best.model
    components = replace(model.components, dispersion=np.full(len(model.whole), dispersion))
    louder = ModelSums(model.sums, model.names, model.baseline, components)
    reached = Inferred.of(louder, SetSearch.of(louder), ())
    noisy = replace(conclusion, inference=Inference((reached,), conclusion.inference.simplest), names=())
    found = find_limits(noisy, analysis.session)
    return {(one.effect.id, one.joint): one for one in found}


def test_limits_of_noise_grow_with_it(healthy: Analysis) -> None:
    """Law: four times the variance, twice the limit at the most, where noise sets it, for tuning takes the less; no
    limit falls.
    """
    quiet, loud = limits(healthy, 100.0), limits(healthy, 400.0)
    assert quiet.keys() == loud.keys()
    pairs = [(one, loud[key]) for key, one in quiet.items() if not one.effect.typical.inverse]
    pairs = [(one, after) for one, after in pairs if one.value]
    assert all(after.value is None or after.value >= one.value * (1.0 - 1e-9) for one, after in pairs if one.value)
    noisy = [(one, after) for one, after in pairs if one.bound_by == "torque" and after.value and one.value]
    growth = [after.value / one.value for one, after in noisy]  # type: ignore[operator]
    assert noisy
    assert max(growth) <= 2.0 * (1.0 + 1e-6)
    assert np.median(growth) > 1.6
