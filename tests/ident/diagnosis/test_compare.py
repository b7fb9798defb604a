"""Laws of comparing: what was done between two sets is found, where it was done; what was not done is not."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.change.body_places import place_bodies
from ident.diagnosis.change.candidates import CHANGES
from ident.diagnosis.change.change_sets import choose_set
from ident.diagnosis.change.compare import compare
from ident.diagnosis.change.daily_friction import daily_variance
from ident.diagnosis.change.gain_uncertainty import BY_CURRENT, STATED
from ident.diagnosis.change.paired_design import build_design
from ident.diagnosis.change.permuted_sets import parts_of
from ident.diagnosis.change.result import ArmComparison, Side
from ident.diagnosis.change.risen_residual import find_risen
from ident.diagnosis.change.settings import CHANGE, PRIOR
from ident.effects.added_body import PLACE
from ident.effects.contact import ExternalContact
from ident.effects.pushes import Push
from ident.effects.rigid_body import LIKE_LINK
from ident.effects.sensing import LARGEST_OFFSET_SHARE
from ident.effects.session_context import rated_torque
from ident.laws.acting import point_mass
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.regression.cross_validation import HeldOut
from ident.regression.least_squares import project
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.show.report.diagnosis_pages import render_comparison_report
from ident.show.terminal import describe_name, describe_sizes, headline
from tests.ident.diagnosis.planted import (
    COULOMB,
    NOISE,
    SLIP,
    Plant,
    at_joint,
    carrying,
    healthy_torque,
    record,
)
from tests.ident.made_up import Law, made_motions, sliding_arm
from tests.schemas import check_record

RUBBING = 0.06
LOAD = Payload(1.2, (0.05, 0.0, 0.06))
FEW = range(50, 54), range(4)


def wrong_everywhere(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """What the URDF and the baseline know nothing of, before and after: a spring, an offset, heavier links."""
    spring = at_joint(2, 1.5 * np.sin(2 * q[:, 2])) + at_joint(0, np.full(len(q), 0.8))
    return spring + 0.15 * arm.inverse_dynamics(q, dq, ddq)


def on_top(plant: Plant) -> Plant:
    """A plant beside what is wrong before and after."""
    return lambda arm, *states: wrong_everywhere(arm, *states) + plant(arm, *states)


def rubs_more(share: float) -> Plant:
    return on_top(lambda arm, q, dq, ddq: at_joint(1, share * COULOMB[1] * np.tanh(dq[:, 1] / SLIP)))


with_load, with_friction, with_warmth = on_top(carrying(LOAD)), rubs_more(0.25), rubs_more(0.05)
with_gain = on_top(lambda *states: at_joint(1, 0.1 * (healthy_torque(*states) + wrong_everywhere(*states))[:, 1]))
with_offset = on_top(lambda arm, q, dq, ddq: at_joint(0, np.full(len(q), 0.7)))
# Many times what an offset usually is: a spring with a rest far beyond any turn would do as well.
with_large_offset = on_top(lambda arm, q, dq, ddq: at_joint(1, np.full(len(q), 60.0)))


# A link between that is a tenth denser: not far from what a tool does.
with_denser_link = on_top(lambda arm, *s: 0.1 * arm.regressor(*s)[..., 10:20] @ arm.inertial_parameters[10:20])


@pytest.fixture(scope="module")
def before(three_joints: ArmModel) -> list[Motion]:
    return record(three_joints, wrong_everywhere, range(4))


def compared(arm: ArmModel, before: list[Motion], plant: Plant, seeds: range = range(10, 14)) -> ArmComparison:
    return compare(before, record(arm, plant, seeds), arm, (Side(), Side()))


def test_nothing_changed_is_no_change_though_the_model_is_wrong(three_joints: ArmModel, before: list[Motion]) -> None:
    found = compared(three_joints, before, wrong_everywhere)
    assert found.verdict == "no_change"
    assert not found.changes


@pytest.mark.parametrize(
    ("plant", "effect", "joint", "figure", "size"),
    [
        (with_friction, "friction_change", "joint_2", "coulomb_change_Nm", 0.25 * COULOMB[1]),
        (with_gain, "torque_gain_error", "joint_2", "gain", 0.1),
        (with_offset, "torque_offset", "joint_1", "offset_Nm", 0.7),
        (with_large_offset, "torque_offset", "joint_2", "offset_Nm", 60.0),
    ],
)
def test_what_changed_is_found_where_it_changed(
    three_joints: ArmModel, before: list[Motion], plant: Plant, effect: str, joint: str, figure: str, size: float
) -> None:
    found = compared(three_joints, before, plant)
    assert [(one.effect, one.joints) for one in found.changes] == [(effect, (joint,))]
    told = found.changes[0].estimate.parameters[figure]
    assert told.value == pytest.approx(size, rel=0.1)
    assert told.low <= 1.05 * size
    assert told.high >= 0.95 * size
    assert joint in found.changes[0].action


def test_what_shakes_is_a_change_though_no_law_is(three_joints: ArmModel, before: list[Motion]) -> None:
    """Law: a joint that vibrates in the later set alone has changed, by no law; the result says where and how much."""
    rng, after = np.random.default_rng(3), []
    for motion in record(three_joints, wrong_everywhere, range(10, 14)):
        shakes = 4.0 * np.sin(2.0 * np.pi * 3.7 * motion.time + rng.uniform(0.0, 2.0 * np.pi))
        after.append(replace(motion, tau=motion.tau + at_joint(1, shakes)))
    found = compare(before, after, three_joints, (Side(), Side()))
    assert found.verdict == "changed_unexplained"
    assert not found.changes
    (risen,) = found.risen
    assert risen.joint == "joint_2"
    assert risen.low > 1.5
    row = check_record(found.to_dict() | {"provenance": Provenance("ident compare").to_dict()})
    words, order = headline(row)
    assert f"joint_2 is {risen.ratio:.1f} times" in words
    assert "shakes" in order
    assert words in render_comparison_report(row)


def test_what_changed_alike_at_many_joints_is_told_once() -> None:
    """Law: one change at every joint is said so; one at many is named once, with the first places and their number."""

    def first_line(*changes: tuple[str, str]) -> str:
        told = [
            {"effect": effect, "joints": [joint], "probability": 0.9, "class": [effect], "class_probability": 0.9}
            for effect, joint in changes
        ]
        empty: dict[str, list[str]] = {"not_testable": [], "risen": [], "unforetold": []}
        return headline({"verdict": "changed", "changes": told, "joints": list("abcde"), **empty})[0]

    rubs = [("friction_change", joint) for joint in "abcde"]
    assert first_line(*rubs) == "What changed: friction change at every joint."
    assert first_line(*rubs[:4]) == "What changed: friction change in a, b and c, and 1 more."
    assert first_line(rubs[0]) == "What changed: friction change in a."
    mixed = first_line(*rubs[:2], ("torque_offset", "c"))
    assert mixed == "What changed: friction change in a and b; torque offset in c."


def test_holds_make_no_rise() -> None:
    """Law: what a joint left while it stood is no measure of what it leaves in motion."""
    rng, part = np.random.default_rng(5), np.repeat(np.arange(8), 10)
    later, rows = part >= 4, np.full((80, 3), 20.0)
    squares = rng.chisquare(20.0, (3, 80))
    held = np.zeros((80, 3))
    held[~later, 1] = rows[~later, 1]
    squares[1, ~later] *= 1e-3
    assert not find_risen(squares, rows, held, part, later, list("abc"))
    assert find_risen(squares, rows, np.zeros((80, 3)), part, later, list("abc"))


@pytest.mark.parametrize("rows", [20.0, 1.0])
@pytest.mark.parametrize(("shared", "own"), [(1.0, 1.0), (3.0, 1.0), (1.0, 9.0)])
def test_residuals_that_rise_alike_are_no_change(shared: float, own: float, rows: float) -> None:
    """Law: of sets whose residuals scatter from run to run, and rise at all joints alike, at most three of a hundred
    show a rise; where one joint's alone rises to nine times its mean square, most show that, of ten rows a part, too,
    and though it stands in one of them.
    """
    rng, part = np.random.default_rng(4), np.repeat(np.arange(12), 10)
    later, joints, count = part >= 6, [f"joint_{j}" for j in range(7)], {True: 0, False: 0}
    for _ in range(100):
        usual = 0.3 * rng.standard_normal((7, 12)) + 0.15 * rng.standard_normal((7, 1)) * (np.arange(12) >= 6)
        squares = np.exp(usual)[:, part] * rng.chisquare(rows, (7, 120)) * np.where(later, shared, 1.0)
        squares[2] *= np.where(later, own, 1.0)
        risen = {
            one.joint for one in find_risen(squares, np.full((120, 7), rows), np.zeros((120, 7)), part, later, joints)
        }
        for third in count:
            count[third] += bool(risen & {"joint_2"} if third else risen - {"joint_2"})
    assert count[False] <= 3
    assert (count[True] > 70) == (own > 1.0)


def test_a_change_of_a_joint_that_slides_is_of_forces_and_metres() -> None:
    """Its record, card and plain line say so; the table of all joints names both units."""
    arm, sets = sliding_arm(), []
    for level, seeds in (((5, 5, 5, 5), range(4)), ((5, 10, 5, 5), range(10, 14))):
        law = lambda *s, level=level: arm.inverse_dynamics(*s) + level * np.tanh(s[1] / SLIP)  # noqa: E731
        sets.append(made_motions(arm, law, seeds, 8.0, 50.0, noise=NOISE))
    found = compare(*sets, arm, (Side(), Side(runs=4)))
    record = check_record(found.to_dict() | {"provenance": Provenance("ident compare").to_dict()})
    assert record["slides"] == ["slide_2", "slide_4"]
    card, table = render_comparison_report(record).split('class="finding"')[1].split("RMS [", 1)
    assert table.startswith("N m; of joints that slide N]")
    lines = [f"{describe_name(one, record, '')} {describe_sizes(one, record)}" for one in record["changes"]]
    for text in (card, *lines):
        assert re.search(r"slide_2 [\d.]+ → [\d.]+ N\b", text)
        assert not re.search(r"N m\b|\brad\b", text)


def with_load_and_rubbing(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """The load, in gears that rub by 6 % of what they carry, driving or not, before and after."""
    carried = arm.with_payload(LOAD).inverse_dynamics(q, dq, ddq)
    return with_load(arm, q, dq, ddq) + RUBBING * np.tanh(dq / SLIP) * np.abs(carried)


with_rubbing = on_top(lambda arm, *states: RUBBING * np.tanh(states[1] / SLIP) * np.abs(arm.inverse_dynamics(*states)))


def test_a_load_in_gears_that_rub_is_known_as_well_as_the_gains(three_joints: ArmModel) -> None:
    """What both sets share, friction by load with its gain-like part too, leaves a body's mass as sure as its readings.

    Were a gain of that part free beside the carried body, it would scale the body with the arm: ± 15 %.
    """
    sets = [
        record(three_joints, plant, seeds)
        for plant, seeds in ((with_rubbing, range(4)), (with_load_and_rubbing, range(10, 14)))
    ]
    widths = []
    for doubt in (STATED, BY_CURRENT):
        found = compare(*sets, three_joints, (Side(), Side()), gain_uncertainty=doubt)
        (figure,) = [one.estimate.parameters["mass_kg"] for one in found.changes if one.effect == "payload"]
        assert figure.low <= LOAD.mass_kg <= figure.high
        widths.append((figure.high - figure.low) / LOAD.mass_kg)
    assert widths[0] < 0.25
    assert 1.3 * widths[0] < widths[1] < 0.4


def test_a_load_is_weighed_by_the_difference_and_its_leaving_too(three_joints: ArmModel, before: list[Motion]) -> None:
    loaded = record(three_joints, with_load, range(10, 14))
    there, back = (compare(*sets, three_joints, (Side(), Side())) for sets in ((before, loaded), (loaded, before)))
    for found, sign in ((there, 1.0), (back, -1.0)):
        (change,) = found.changes
        assert "payload" in change.estimate.rivals
        figure = change.estimate.parameters["mass_kg" if change.effect == "payload" else "mass_change_kg"]
        assert figure.low <= sign * LOAD.mass_kg <= figure.high


def test_a_body_is_told_with_all_its_places(three_joints: ArmModel, before: list[Motion]) -> None:
    """Where a tool would pull alike, a person is told to look at it, too; and at no link that can't be it."""
    (change,) = compared(three_joints, before, with_denser_link).changes
    places = {(change.effect, "" if change.effect == "payload" else change.joints[0]), *change.elsewhere}
    assert {("link_inertial_error", "joint_2"), ("payload", "")} <= places
    assert ("link_inertial_error", "joint_1") not in places
    assert "payload" in change.estimate.rivals
    assert "tool" in change.action


def test_fewer_samples_than_figures_tell_nothing(three_joints: ArmModel) -> None:
    law = partial(healthy_torque, three_joints)
    sets = [made_motions(three_joints, law, range(seed, seed + 1), 1.2, 25.0, noise=NOISE) for seed in (0, 10)]
    found = compare(*sets, three_joints, (Side(), Side()))
    assert (found.verdict, found.changes) == ("not_testable", ())
    assert found.not_testable


def test_friction_of_another_day_is_no_change(three_joints: ArmModel, before: list[Motion]) -> None:
    """A joint that rubs by 5 % more is as joints are when they are warmer or colder: no change, and told so."""
    found = compared(three_joints, before, with_warmth)
    assert found.verdict == "no_change"


def test_friction_that_wanders_adds_up_in_a_session_and_begins_anew_in_the_next() -> None:
    """A mean of more runs in a row is off by more; the same runs from two days instead of one are off by less."""
    walked = {
        (runs, days): daily_variance(0.1, (runs, runs), (days, days)) - daily_variance(0.0, (runs, runs), (days, days))
        for runs in (6, 12)
        for days in (1, 2)
    }
    assert walked[12, 1] == pytest.approx(2.0 * walked[6, 1])
    assert walked[6, 1] == pytest.approx(4.0 * walked[6, 2])
    assert daily_variance(0.0, (6, 6), (1, 1)) == pytest.approx(2.0 * daily_variance(0.0, (6, 6), (2, 2)))


def test_one_run_a_side_tells_no_friction(three_joints: ArmModel, before: list[Motion]) -> None:
    found = compared(three_joints, before[:1], with_friction, range(10, 11))
    assert "friction_change" not in {one.effect for one in found.changes}
    silent = {one.effect.id: one.reason for one in found.not_testable}
    assert "one run a side" in silent["friction_change"]


def test_runs_are_dealt_into_sets_that_are_none(three_joints: ArmModel, before: list[Motion]) -> None:
    """Half of each side in either, none twice; where the model holds laws gain there what noise alone gives."""
    design = build_design(before, record(three_joints, wrong_everywhere, range(10, 14)), three_joints)
    dealt = [frozenset(one.tolist()) for one in design.permuted.permutations]
    assert {(len(one & set(range(4))), len(one & set(range(4, 8)))) for one in dealt} == {(2, 2)}
    assert len({frozenset({one, frozenset(range(8)) - one}) for one in dealt}) == len(dealt) > 3
    groups = {one.key: one for one in design.sums.evidence.layout.groups if one.joint == 1 and not one.borrows}
    nulls = [design.permuted.nulls(1, design.prior, [one]) for one in groups.values()]
    found = [null.get(key, null[None]).ratio for key, null in zip(groups, nulls, strict=True)]
    assert np.median(found) < 2.0
    many = replace(design.sides, later=np.arange(24) >= 12, run_of_block=np.arange(24))
    parts = [set(np.flatnonzero(parts_of(many) == part).tolist()) for part in range(12)]
    assert parts[:6] == [{k, k + 6} for k in range(6)]  # of runs that move joint after joint each holds several


BRACKET = np.array([0.1, 0.25, 0.1])  # [m]
# Something that is mounted on the forearm, 25 cm beside its axis.
with_bracket = on_top(lambda arm, *states: arm.regressor(*states)[..., 20:30] @ (2.5 * point_mass(BRACKET)))


def test_a_window_beside_a_push_is_no_null_of_it(three_joints: ArmModel, before: list[Motion]) -> None:
    """Law: beside a push the null variance of pushes is that of other times; another window at the same time would
    explain what the first leaves of the push itself.
    """
    after = record(three_joints, wrong_everywhere, range(10, 14))
    time = after[1].time
    pushes = tuple(Push(after[1].name, time[0] + at, time[0] + at + 1.0, 3) for at in (2.0, 2.3, 5.0))
    left = np.where(((time > pushes[0].start) & (time < pushes[0].end))[:, None], 30.0, 0.0)
    after[1] = replace(after[1], tau=after[1].tau + left)
    effects = tuple(replace(one, pushes=pushes) if isinstance(one, ExternalContact) else one for one in CHANGES)
    design = build_design(before, after, three_joints, effects=effects)
    windows = [
        one for one in design.sums.evidence.layout.groups if one.effect.event and not one.variant.shape["swells"]
    ]
    ratios = {}
    for kept in (windows[1:2], []):
        ratios[len(kept)] = design.permuted.nulls(-1, design.prior, kept)[windows[0].key].ratio
    assert 5.0 * ratios[1] < ratios[0]


def test_a_body_is_laid_out_about_the_place_where_it_was_found(three_joints: ArmModel, before: list[Motion]) -> None:
    """There its second moments are its own, and it explains more than a link of that moment and its own density."""
    after = record(three_joints, with_bracket, range(10, 14))
    first = build_design(before, after, three_joints)
    search = choose_set(first, frozenset()).search
    loads = [one.variant.shape for one in first.sums.evidence.layout.groups if one.effect.id == "payload"]
    assert any(LIKE_LINK in shape for shape in loads)  # else how a load is spread would decide its name
    effects = place_bodies(search, (), first.session, first.effects)
    design = build_design(before, after, three_joints, earlier=first.estimates, effects=effects)
    model = project(design.sums.evidence.gram(), design.sums.evidence, design.prior)
    groups = [one for one in design.sums.evidence.layout.groups if one.key == ("link_inertial_error", 2, None)]
    usual, placed = groups
    np.testing.assert_allclose([placed.variant.shape[name] for name in PLACE], BRACKET, atol=0.1)
    assert model.gain(placed)[0] > model.gain(usual)[0] + 100.0
    beta = model.gain(placed)[1] / design.sums.evidence.scale[placed.columns]
    figures = placed.effect.parameters(design.session, 2, placed.variant, beta, np.zeros((4, 4)))
    assert figures["mass_change_kg"].value == pytest.approx(2.5, rel=0.03)
    np.testing.assert_allclose([figures[f"moment_change_{axis}_kgm"].value for axis in "xyz"], 2.5 * BRACKET, atol=0.03)


def wrong_law(arm: ArmModel) -> Law:
    return lambda q, dq, ddq: healthy_torque(arm, q, dq, ddq) + wrong_everywhere(arm, q, dq, ddq)


def test_over_a_few_seconds_no_sum_is_negative(three_joints: ArmModel) -> None:
    """Law: however much encoder noise the states have, and however few rows there are, all columns together have a
    Gram matrix: what is solved has a solution.
    """
    rng, sets = np.random.default_rng(3), []
    for seeds in FEW:
        motions = made_motions(three_joints, wrong_law(three_joints), seeds, 2.0, 50.0, noise=NOISE)
        noisy = [np.array([1e-4, 1e-2, 1.0]) * rng.standard_normal((*one.q.shape, 3)) for one in motions]
        sets.append([replace(one, state_noise=noise) for one, noise in zip(motions, noisy, strict=True)])
    gram = build_design(*sets, three_joints).sums.evidence.gram()
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    assert np.linalg.eigvalsh(gram / np.outer(size, size)).min() > -1e-9


WIDTH = 0.11  # [rad/s], between two points of the search's grid
with_stribeck = on_top(
    lambda arm, q, dq, ddq: at_joint(0, 6.0 * np.exp(-((dq[:, 0] / WIDTH) ** 2)) * np.tanh(dq[:, 0] / SLIP))
)


def test_a_law_between_two_points_of_the_grid_is_found_where_it_is(
    three_joints: ArmModel, before: list[Motion]
) -> None:
    """Law: parameters of a change come from a grid as fine as a diagnosis has, not from the coarse one of the search,
    and what the coarse one leaves of the law has no name of its own.
    """
    (change,) = compared(three_joints, before, with_stribeck).changes
    assert (change.effect, change.joints) == ("stribeck_friction", ("joint_1",))
    speed = change.estimate.parameters["stribeck_velocity_rad_s"]
    assert speed.value == pytest.approx(WIDTH, rel=0.15)
    assert speed.low <= WIDTH <= speed.high


def test_laws_that_both_sets_share_are_as_large_as_laws_are(three_joints: ArmModel) -> None:
    """A few seconds tell a part of the baseline's many columns: the rest must not run away on runs left out."""
    before, after = (
        made_motions(three_joints, wrong_law(three_joints), seeds, 2.0, 50.0, noise=NOISE) for seeds in FEW
    )
    design = build_design(before, after, three_joints)
    evidence, free = design.sums.evidence, replace(design.prior, further=None)
    bounded, unbounded = (HeldOut(evidence, prior).score().misfit.sum() for prior in (design.prior, free))
    assert bounded < 0.8 * unbounded
    assert design.prior.further is not None
    assert len(design.prior.further) == evidence.layout.further
    (first,) = [one for one in design.sums.common if one.effect.id == "torque_offset" and one.joint == 1]
    at = design.sums.common.index(first)
    column = sum(len(one.columns) for one in design.sums.common[:at])
    largest = CHANGE.shared_laws * LARGEST_OFFSET_SHARE * rated_torque(design.session, 1)
    scale = evidence.scale[evidence.layout.tuned - evidence.layout.further + column]
    loosest = 1.0 / (largest * scale) ** 2
    assert loosest * (1.0 - 1e-9) <= design.prior.further[column] <= loosest / PRIOR.least * (1.0 + 1e-9)
