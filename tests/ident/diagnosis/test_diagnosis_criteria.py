"""What a candidate must show for a name, and what is told of one that shows less."""

from dataclasses import replace
from functools import reduce
from types import SimpleNamespace
from typing import Any, cast

import pytest

from ident import InputError
from ident import diagnose as diagnose_files
from ident.diagnosis.alternate import _with_rejected
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.named_links import _leads
from ident.diagnosis.reservations import Reservation
from ident.diagnosis.selection.criteria import AcceptanceCriteria, Evaluated, SearchResults, first_of_each_joint
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.diagnosis.settings import USUAL
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, load_friction_on_2, record, search_of, spring_on_3

CLEAR = AcceptanceCriteria(
    log_score=(300.0, 60.0),
    closed=(0.3, 0.05),
    rms_fall=0.05,
    gap_fall=0.6,
    initial_gap_share=0.5,
    log_evidence=280.0,
    absorbed=False,
)
ABSORBED = replace(CLEAR, absorbed=True, log_score=(-2.0, 5.0), closed=(-0.1, 0.2), rms_fall=0.0, gap_fall=0.0)
EVENT = replace(CLEAR, event=True, required_log_evidence=20.0, rms_fall=0.001, log_score=(0.0, 0.0))


@pytest.mark.parametrize(
    ("criteria", "passed"),
    [
        (CLEAR, True),
        (replace(CLEAR, log_evidence=11.0), False),
        (replace(CLEAR, log_score=(50.0, 60.0)), True),
        (replace(CLEAR, log_score=(50.0, 60.0), closed=(0.1, 0.2)), False),
        (replace(CLEAR, gap_fall=0.09), False),
        (replace(CLEAR, rms_fall=0.019), False),
        (replace(CLEAR, initial_gap_share=0.014), False),
        (ABSORBED, True),
        (replace(ABSORBED, log_evidence=11.0), False),
        (replace(ABSORBED, log_evidence=11.0, required_log_evidence=5.0), True),
        (replace(ABSORBED, initial_gap_share=0.01), False),
        (EVENT, True),
        (replace(EVENT, gap_fall=0.4), False),
        (replace(EVENT, log_evidence=19.0), False),
    ],
)
def test_every_gate_can_close(criteria: AcceptanceCriteria, passed: bool) -> None:
    """A candidate passes if nothing is missing, and each thing that is missing alone keeps it from a name."""
    assert criteria.passed is passed


@pytest.mark.parametrize(
    ("criteria", "told"),
    [
        (replace(CLEAR, gap_fall=0.05, rms_fall=0.016), True),
        (replace(CLEAR, gap_fall=0.05, rms_fall=0.014), False),
        (replace(CLEAR, log_evidence=11.0), True),
        (replace(CLEAR, log_evidence=4.0), False),
        (replace(CLEAR, log_evidence=7.0), True),
        (replace(CLEAR, log_evidence=7.0, tried=20), False),  # the best of many is more by chance
        (replace(CLEAR, gap_fall=0.05, log_score=(-1.0, 5.0), closed=(-0.1, 0.2)), False),
        (replace(EVENT, gap_fall=0.4, log_evidence=10.0), False),
    ],
)
def test_what_is_beyond_chance_is_told_without_a_name(criteria: AcceptanceCriteria, told: bool) -> None:
    """With evidence, better on unseen runs, and not negligible: then it is reported, if not named."""
    assert not criteria.passed
    assert criteria.exceeds_chance is told


def test_a_name_that_was_struck_for_its_unevenness_is_something_there() -> None:
    """Law: without names, the best of what was struck for its figures counts as refused, and so as a hint; what may as
    well be zero does not, and beside names or another hint nothing changes.
    """
    some: Any = SimpleNamespace()
    weak, strong = (Evaluated(some, replace(CLEAR, log_evidence=nats), some, some) for nats in (50.0, 90.0))

    def struck(item: Evaluated | None) -> Reservation:
        return Reservation("stribeck_friction", ("joint_1",), "its size differs between runs", {}, item)

    nothing = SearchResults((), (some,), None)
    doubted = (struck(weak), struck(strong), struck(None))
    assert _with_rejected(nothing, doubted).near_miss is strong
    assert _with_rejected(nothing, (struck(None),)) is nothing
    named = SearchResults((cast(Evaluated, weak),), (some, some), None)
    assert _with_rejected(named, doubted) is named
    hinted = SearchResults((), (some,), replace(weak, criteria=replace(CLEAR, gap_fall=0.05)))
    assert _with_rejected(hinted, doubted) is hinted


@pytest.mark.parametrize(
    ("count", "evidence", "foretells", "kept"),
    [
        *((2, 11.0, -5.0, True), (2, 9.0, 5.0, False), (3, 11.0, -0.5, True), (3, 11.0, -5.0, False)),
        (4, 99.0, 5.0, False),
    ],
)
def test_more_names_are_no_better_start(count: int, evidence: float, foretells: float, kept: bool) -> None:
    """Law: beside a first model of three names and 10 nats, a second of more evidence stands with fewer names, or with
    as many where it foretells no worse, by more than its error of one, beside the URDF as it is; never with more.
    """
    gain: Any = SimpleNamespace(effect=SimpleNamespace(id="torque_gain_error"))
    models = {False: ["first"] * 3, True: ["second"] * count}
    search: Any = SimpleNamespace(
        run=lambda start=(): SimpleNamespace(accepted=[SimpleNamespace(group=one) for one in models[bool(start)]]),
        evidence=SimpleNamespace(layout=SimpleNamespace(groups=[gain])),
        backward_elimination=lambda groups: [SimpleNamespace(group=one) for one in groups],
        model_log_evidence=lambda groups: evidence if "second" in groups else 10.0,
        fixed=SimpleNamespace(score=lambda groups: SimpleNamespace(gain_over=lambda other: (foretells, 1.0))),
    )
    assert Search.best_start(search) == models[kept]


def test_every_number_says_what_it_is_and_where_it_comes_from() -> None:
    """Law: unit, meaning and source stand with each; a result records each by its name."""
    told = USUAL.describe()
    for one in told:
        assert one["unit"]
        assert one["meaning"]
        assert one["source"].startswith(("law: ", "chosen: ", "calibrated: "))
        value = list(one["value"]) if isinstance(one["value"], tuple) else one["value"]
        assert reduce(lambda group, name: group[name], one["name"].split("."), USUAL.to_dict()) == value
    assert len({one["name"] for one in told}) == len(told)


@pytest.mark.parametrize("stricter", [{"least_rms_fall": 0.3}, {"least_gap_fall": 0.7}, {"least_own_share": 0.6}])
def test_a_gate_obeys_the_settings_that_it_was_given(stricter: dict[str, float]) -> None:
    """Law: what passes as usual does not pass where one number asks for more."""
    assert CLEAR.passed
    assert not replace(CLEAR, settings=replace(USUAL_SELECTION, **stricter)).passed  # type: ignore[arg-type]


def test_every_stage_obeys_the_settings_of_the_diagnosis(short_arm: ArmModel) -> None:
    """Law: a number that is given for one diagnosis decides in its stage, and stands in its result."""
    settings = replace(
        USUAL,
        regression=replace(USUAL.regression, folds=3),
        selection=replace(USUAL.selection, most_sure=0.7),
        gap=replace(
            USUAL.gap,
            map=replace(USUAL.gap.map, places_told=1, bins=2),
            replay=replace(USUAL.gap.replay, window_s=0.1),
            ceiling=replace(USUAL.gap.ceiling, least_samples=10**9, least_nats=1e9),
        ),
        verdict=replace(USUAL.verdict, named_from=2.0),
    )
    effects = [find_effect("load_dependent_friction")]
    motions = record(short_arm, load_friction_on_2)
    analysis = diagnose(motions, short_arm, effects, common_clock=False, settings=settings)
    found = analysis.diagnosis
    assert len(analysis.evidence.weights) == 3
    (finding,) = found.findings
    assert finding.estimate.probability <= 0.7
    assert len(found.where) == 1
    told = found.to_dict()
    assert all(len(strip["p_value"]) <= 2 for strip in told["maps"] if strip["axis"] != "frequency")
    assert told["heldout"]["forward"]["window_s"] == 0.1
    assert all(gap["unexplained"] is None for gap in told["gap"].values())
    assert found.verdict == "partial"  # a name that closes nearly all, where all would not be enough
    assert found.settings is settings


def test_what_is_no_settings_is_told() -> None:
    """Law: another object in their place is the caller's mistake, in one line."""
    with pytest.raises(InputError, match="settings"):
        diagnose_files("nowhere", "tm5-900", settings={"least_nats": 1.0})  # type: ignore[arg-type]


def test_what_goes_at_one_joint_waits_for_none_at_another() -> None:
    """Of items at a joint the first is kept; what acts on the whole arm shares a joint with every other."""
    assert first_of_each_joint([("a", [0]), ("b", [0]), ("c", [1]), ("arm", [0, 1, 2]), ("d", [2])]) == ["a", "c", "d"]


def test_a_search_ends_in_the_same_names_wherever_it_begins(short_arm: ArmModel) -> None:
    """What does not stand goes from the start, what stands is found without it."""
    analysis = analyse(short_arm, spring_on_3)
    search = search_of(analysis)
    wrong = [one for one in analysis.evidence.layout.groups if one.effect.id == "stribeck_friction" and one.joint == 0]
    names = [{item.group.key for item in search.run(start).accepted} for start in ((), wrong[:1])]
    assert names[0] == names[1] == {("spring_torque", 2, None)}


@pytest.mark.parametrize(("odds", "leads"), [(2.0, True), (0.2, True), (0.05, False)])
def test_a_body_that_another_of_its_class_outranks_by_far_has_no_name(odds: float, leads: bool) -> None:
    """A class that is likely because of another cause is no name for the link."""
    shares = {"link_inertial_error": 0.75 / (1.0 + 1.0 / odds), "torque_offset": 0.75 / (1.0 + odds)}
    one = SimpleNamespace(probability=shares["link_inertial_error"], shares=shares, class_probability=0.75)
    assert _leads(cast(Any, one), USUAL_SELECTION, 0.5) is leads
