"""What tuning takes away: a load that the tuned inertias swallow is still told to be there."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis, diagnose
from ident.diagnosis.tolerance import Tolerance, measure_tolerance
from ident.diagnosis.tuned_links import measure_tuned_links, turning_moment
from ident.effects.catalogue import find_effect
from ident.effects.interval import Interval
from ident.regression.baseline import UrdfError
from ident.regression.block_sums import SymmetricSums
from ident.regression.least_squares import Prior, project
from ident.robot.arm import ArmModel
from ident.show.terminal import describe_name
from tests.ident.diagnosis.planted import MASS, analyse, healthy_torque, loaded, nothing, record
from tests.ident.made_up import made_motions


def tolerance_of(analysis: Analysis) -> Tolerance:
    """Of the baseline with all that was named."""
    evidence, prior = analysis.evidence, Prior.of(analysis.evidence, analysis.baseline.prior)
    groups = analysis.conclusion.groups
    return measure_tolerance(evidence, prior, project(evidence.gram(), evidence, prior, groups))


def test_an_arm_as_drawn_is_within_tolerance(healthy: Analysis) -> None:
    """Law: inertias that are right are tuned no farther than noise takes them."""
    tolerance = tolerance_of(healthy)
    assert not tolerance.exceeded
    assert tolerance.deviation < 4.0
    assert all(gap.tuned_away == 0.0 for gap in healthy.diagnosis.gap.values())


@pytest.mark.xfail(strict=False, reason="without a word for loads the URDF's error scale takes it")
def test_a_load_without_a_name_is_not_tuned_away(short_arm: ArmModel) -> None:
    """Law: with no word for loads the residual is noise, and yet the verdict is that something is there, at the joints
    that feel gravity.
    """
    analysis = analyse(short_arm, loaded, [find_effect("stribeck_friction"), find_effect("torque_delay")])
    tolerance = tolerance_of(analysis)
    assert tolerance.exceeded
    assert np.argmax(tolerance.torque) != 0  # the first axis is vertical
    assert analysis.diagnosis.verdict == "none_of_catalogue"
    gap = analysis.diagnosis.gap["joint_2"]
    assert gap.tuned_away > 5.0 * gap.noise_floor
    assert gap.rms < 1.2 * gap.noise_floor


def test_a_load_with_a_name_leaves_nothing_to_tune(short_arm: ArmModel) -> None:
    """Law: once the load is named, the inertias are those of the drawing again."""
    analysis = analyse(short_arm, loaded, [find_effect("payload"), find_effect("stribeck_friction")])
    assert [f.estimate.group.effect.id for f in analysis.diagnosis.findings] == ["payload"]
    assert not tolerance_of(analysis).exceeded
    mass = analysis.diagnosis.findings[0].estimate.parameters["mass_kg"]
    assert mass.value == pytest.approx(MASS, rel=0.03)
    assert mass.low <= MASS <= mass.high


@pytest.mark.parametrize("inflation", [1.0, 3.0])
def test_arms_within_tolerance_are_told_so(inflation: float) -> None:
    """Law: of arms whose inertias err as the prior says, no more than 5 % lie beyond the 5 % point, also where the
    misfit has three times the variance that the noise model knows.
    """
    rng = np.random.default_rng(8)
    rank = 6
    root = rng.normal(size=(rank, rank)) + 2.0 * np.eye(rank)
    prior = Prior(root @ root.T)
    data = np.diag([1e4, 300.0, 30.0, 5.0, 1.0, 1e-4])
    spread = np.linalg.inv(data + prior.base)
    evidence = SimpleNamespace(
        layout=SimpleNamespace(rank=rank), plain=(SymmetricSums.of(data[None]),), weights=np.ones((1, 1))
    )
    alarms = 0
    for _ in range(400):
        change = np.linalg.solve(root.T, rng.normal(size=rank))
        noise = np.sqrt(inflation * np.diag(data)) * rng.normal(size=rank)
        model = SimpleNamespace(estimate=spread @ (data @ change + noise), spread=spread)
        alarms += measure_tolerance(evidence, prior, model, inflation).p_value < 0.05  # type: ignore[arg-type]
    assert alarms <= 33


# Log evidence that is beyond doubt [nats].
CLEAR_NATS = 20.0
# Links are flagged at 95 % intervals of several numbers: each holds the truth within this many of its half-widths.
WITHIN = 1.6


def analysed(arm: ArmModel, numbers: Array) -> Analysis:
    """The analysis of a healthy arm by a URDF of other inertial numbers."""
    urdf = arm.with_inertial_parameters(numbers)
    return diagnose(record(arm, nothing), urdf, [find_effect("stribeck_friction")], common_clock=False)


def holds(one: Interval, true: float) -> bool:
    return abs(one.value - true) <= WITHIN * (one.high - one.value)


@pytest.mark.parametrize(("wrong", "factor"), [(None, 1.0), (1, 1.5), (2, 1.6), (2, 0.6)])
def test_the_link_that_is_off_is_named_and_no_other(short_arm: ArmModel, wrong: int | None, factor: float) -> None:
    """Law: every reported change holds the true one, and the links beyond tolerance are those that are off by half."""
    true = short_arm.inertial_parameters
    numbers = true.copy()
    if wrong is not None:
        numbers[10 * wrong : 10 * wrong + 10] *= factor
    diagnosis = analysed(short_arm, numbers).diagnosis
    assert diagnosis.details is not None
    links = diagnosis.details.tuned_links
    for k, (name, link) in enumerate(links.items()):
        own = (true - numbers)[10 * k : 10 * k + 4]
        reported = {"xyz".index(axis) + 1: one for axis, one in link.moment.items()}
        reported |= {} if link.mass is None else {0: link.mass}
        assert all(holds(one, own[i]) for i, one in reported.items()), (name, own, reported)
        if link.about_axis is not None:
            axis = short_arm.joint_axes[k]
            rows = (np.eye(3) - np.outer(axis, axis)) @ turning_moment(short_arm, k)
            urdf = rows @ numbers
            assert holds(link.about_axis, float(urdf @ rows @ (true - numbers) / np.linalg.norm(urdf)))
        assert link.beyond_tolerance == (k == wrong)
    doubted = [one for one in diagnosis.reservations if "URDFs are" in one.reason]
    assert [one.joints for one in doubted] == ([] if wrong is None else [(short_arm.joint_names[wrong],)])
    record_ = diagnosis.to_dict()["tuned_links"]
    assert record_["link_2"]["about_axis_share"].keys() == {"value", "low", "high"}
    assert "mass_kg" not in record_["link_1"]  # a link behind an upright axis shows none of its mass


@pytest.mark.parametrize(
    ("factors", "wrong"), [((1.0, 1.0, 1.0), set()), ((1.0, 1.0, 1.6), {2}), ((1.0, 1.1, 0.9), set())]
)
def test_a_link_that_is_off_by_itself_has_a_name(
    short_arm: ArmModel, factors: tuple[float, ...], wrong: set[int]
) -> None:
    """Law: a link that alone is off gets a name, its change within the interval, and no other does; none where all are
    right, or off by a tenth.
    """
    numbers = short_arm.inertial_parameters * np.repeat(factors, 10)
    catalogue = [find_effect("link_inertial_error"), find_effect("stribeck_friction")]
    urdf = short_arm.with_inertial_parameters(numbers)
    found = diagnose(record(short_arm, nothing), urdf, catalogue, common_clock=False).diagnosis.findings
    assert {one.estimate.group.joint for one in found} == wrong
    for one in found:
        true = (short_arm.inertial_parameters - numbers)[10 * one.estimate.group.joint]
        assert holds(one.estimate.parameters["mass_change_kg"], true)


@pytest.mark.parametrize(("factor", "carried"), [(0.6, True), (1.6, False)])
def test_what_the_last_link_has_more_may_hang_on_it(short_arm: ArmModel, factor: float, carried: bool) -> None:
    """Law: a last link that is heavier than its URDF carries a load, or is heavier; one that is lighter carries none.

    What is heavier all along a link is the link before it is a load. Neither is an offset or a spring, though torque
    is so precise that its neighbours' tolerance hides the link.
    """
    numbers = short_arm.inertial_parameters * np.repeat((1.0, 1.0, factor), 10)
    names = ("link_inertial_error", "payload", "torque_offset", "spring_torque")
    catalogue, urdf = [find_effect(one) for one in names], short_arm.with_inertial_parameters(numbers)
    motions = made_motions(short_arm, partial(healthy_torque, short_arm), range(6), 8.0, 100.0, noise=0.03)
    diagnosis = diagnose(motions, urdf, catalogue, common_clock=False).diagnosis
    (found,) = diagnosis.findings
    assert set(found.estimate.rivals) == ({*names[:2]} if carried else {names[0]})
    assert found.estimate.rivals[0] == names[0]
    # What is reported of the URDF is its own error, rotors and friction tuned: no inertia of it has moved.
    q, dq, ddq = (np.concatenate([getattr(one, name)[20:-20] for one in motions]) for name in ("q", "dq", "ddq"))
    apart = (short_arm.inverse_dynamics(q, dq, ddq) - urdf.inverse_dynamics(q, dq, ddq))[:, 1]
    tuned = np.column_stack([np.sign(dq[:, 1]), dq[:, 1], ddq[:, 1]])
    apart -= tuned @ np.linalg.lstsq(tuned, apart)[0]
    assert diagnosis.gap["joint_2"].fixed_rms == pytest.approx(np.sqrt(np.mean(apart**2)), rel=0.05)
    assert found.closed > 0.9 * np.mean(apart**2)


@pytest.mark.parametrize("doubted", [1.0, 8.0])
def test_a_link_is_named_whatever_its_neighbours_are(short_arm: ArmModel, doubted: float) -> None:
    """Law: evidence for a link is against its neighbours; a URDF that is doubted everywhere hides no link."""
    numbers = short_arm.inertial_parameters * np.repeat((1.0, 1.0, 1.6), 10)
    analysis = analysed(short_arm, numbers)
    prior = Prior.believing(analysis.evidence, analysis.baseline, UrdfError(doubted))
    model = project(analysis.evidence.gram(), analysis.evidence, prior)
    links = measure_tuned_links(analysis.baseline, analysis.evidence, model, prior, 1.0)
    apart = [link.evidence for link in links.values()]
    assert apart[2] > CLEAR_NATS
    assert max(apart[:2]) < 0.2 * apart[2]


def test_of_two_links_that_gravity_cannot_tell_apart_one_is_off_for_sure(short_arm: ArmModel) -> None:
    """Law: where only the moment about joint 2 is known, one link behind it is off for sure; which one stays open."""
    numbers = short_arm.inertial_parameters * np.repeat((1.0, 1.0, 1.6), 10)
    analysis = analysed(short_arm, numbers)
    baseline, true = analysis.baseline, short_arm.inertial_parameters - numbers
    axis = short_arm.joint_axes[1]
    moment = (np.eye(3) - np.outer(axis, axis)) @ turning_moment(short_arm, 1)
    known = np.linalg.lstsq(baseline.base.mapping.T, moment.T, rcond=None)[0] * 1e3  # to a gram metre
    prior = Prior.of(analysis.evidence, baseline.prior)
    scale = analysis.evidence.scale[: analysis.evidence.layout.rank]
    information = known @ known.T / np.outer(scale, scale)
    spread = np.linalg.inv(information + prior.base)
    estimate = spread @ information @ (scale * (baseline.base.mapping @ true))
    model = SimpleNamespace(estimate=estimate, spread=spread)
    links = measure_tuned_links(baseline, analysis.evidence, model, prior, 1.0)  # type: ignore[arg-type]
    (one,) = [link for link in links.values() if link.beyond_tolerance]
    assert one.evidence > CLEAR_NATS
    at = short_arm.joint_names.index(one.joint)
    ((others, nats),) = one.against
    assert {at, *others} == {1, 2}
    assert nats < 3.0


def test_a_link_error_that_may_stand_at_another_joint_says_so(short_arm: ArmModel) -> None:
    """Law: action, record and terminal name both joints; the probability of the class counts both."""
    urdf = short_arm.with_inertial_parameters(short_arm.inertial_parameters * np.repeat((1.0, 1.0, 1.6), 10))
    catalogue = [find_effect("link_inertial_error"), find_effect("stribeck_friction")]
    (found,) = diagnose(record(short_arm, nothing), urdf, catalogue, common_clock=False).diagnosis.findings
    shared = replace(found.estimate, probability=found.estimate.probability / 2.0, places={1: 1.0})
    either = replace(found, estimate=shared, elsewhere=((found.effect, "joint_2"),))
    assert "joint_3 or joint_2" in either.action
    assert "joint_2" not in found.action
    assert either.to_dict()["elsewhere"] == [{"effect": "link_inertial_error", "joint": "joint_2"}]
    assert either.to_dict()["class_probability"] == pytest.approx(found.estimate.class_probability)
    assert " in joint_3 (or joint_2): " in describe_name(either.to_dict(), {}, "")
