"""What a candidate change must show, and the settings of all stages: each says what it is, and is obeyed."""

from dataclasses import replace
from functools import reduce

import pytest

from ident import InputError
from ident import diagnose as diagnose_files
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.selection.criteria import AcceptanceCriteria, first_of_each_joint
from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.diagnosis.settings import USUAL
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import load_friction_on_2, record

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
        gap=replace(
            USUAL.gap,
            map=replace(USUAL.gap.map, places_told=1, bins=2),
            replay=replace(USUAL.gap.replay, window_s=0.1),
            ceiling=replace(USUAL.gap.ceiling, least_samples=10**9),
        ),
        verdict=replace(USUAL.verdict, loud=1.1),
    )
    effects = [find_effect("load_dependent_friction")]
    motions = record(short_arm, load_friction_on_2)
    analysis = diagnose(motions, short_arm, effects, common_clock=False, settings=settings)
    found = analysis.diagnosis
    assert len(analysis.evidence.weights) == 3
    assert [one.effect for one in found.findings] == ["load_dependent_friction"]
    assert len(found.where) == 1
    told = found.to_dict()
    assert all(len(strip["p_value"]) <= 2 for strip in told["maps"] if strip["axis"] != "frequency")
    assert told["heldout"]["forward"]["window_s"] == 0.1
    assert all(gap["unexplained"] is None for gap in told["gap"].values())
    assert found.verdict == "named"
    assert found.settings is settings


def test_what_is_no_settings_is_told() -> None:
    """Law: another object in their place is the caller's mistake, in one line."""
    with pytest.raises(InputError, match="settings"):
        diagnose_files("nowhere", "tm5-900", settings={"least_nats": 1.0})  # type: ignore[arg-type]


def test_what_goes_at_one_joint_waits_for_none_at_another() -> None:
    """Of items at a joint the first is kept; what acts on the whole arm shares a joint with every other."""
    assert first_of_each_joint([("a", [0]), ("b", [0]), ("c", [1]), ("arm", [0, 1, 2]), ("d", [2])]) == ["a", "c", "d"]
