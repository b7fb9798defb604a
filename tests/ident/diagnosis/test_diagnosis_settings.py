"""The numbers that decide: each says what it is, and each stage obeys the ones that it was given."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

import pytest

from ident import InputError
from ident import diagnose as diagnose_files
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.selection.gates import Gates
from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.diagnosis.settings import USUAL
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import load_friction_on_2, record

CLEAR = Gates(
    p_value=0.001,
    log_score=(50.0, 5.0),
    closed=(0.3, 0.05),
    rms_fall=0.2,
    gap_fall=0.5,
    own_share=0.5,
    evidence=100.0,
    absorbed=False,
)


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


@pytest.mark.parametrize(
    "stricter", [{"family_error": 1e-4}, {"least_rms_fall": 0.3}, {"least_gap_fall": 0.6}, {"least_own_share": 0.6}]
)
def test_a_gate_obeys_the_settings_that_it_was_given(stricter: dict[str, float]) -> None:
    """Law: what passes as usual does not pass where one number asks for more."""
    assert CLEAR.passed
    assert not replace(CLEAR, settings=replace(USUAL_SELECTION, **stricter)).passed  # type: ignore[arg-type]


def test_every_stage_obeys_the_settings_of_the_diagnosis(short_arm: ArmModel) -> None:
    """Law: a number that is given for one diagnosis decides in its stage, and stands in its result."""
    settings = replace(
        USUAL,
        regression=replace(USUAL.regression, folds=3),
        selection=replace(USUAL.selection, most_sure=0.5),
        gap=replace(
            USUAL.gap,
            map=replace(USUAL.gap.map, places_told=1, bins=2),
            replay=replace(USUAL.gap.replay, window_s=0.1),
            ceiling=replace(USUAL.gap.ceiling, least_samples=10**9, least_nats=1e9),
        ),
        verdict=replace(USUAL.verdict, named_from=2.0, even_odds=1.0),
    )
    effects = [find_effect("load_dependent_friction")]
    motions = record(short_arm, load_friction_on_2)
    analysis = diagnose(motions, short_arm, effects, common_clock=False, settings=settings)
    found = analysis.diagnosis
    assert len(analysis.evidence.weights) == 3
    (finding,) = found.findings
    assert finding.estimate.probability <= 0.5
    assert len(found.where) == 1
    told = found.to_dict()
    assert all(len(strip["p_value"]) <= 2 for strip in told["maps"] if strip["axis"] != "frequency")
    assert told["heldout"]["forward"]["window_s"] == 0.1
    assert all(gap["unexplained"] is None for gap in told["gap"].values())
    assert found.verdict == "none_of_catalogue"  # a name that closes nearly all, where all would not be enough
    assert found.settings is settings


def test_what_is_no_settings_is_told() -> None:
    """Law: another object in their place is the caller's mistake, in one line."""
    with pytest.raises(InputError, match="settings"):
        diagnose_files("nowhere", "tm5-900", settings={"family_error": 0.1})  # type: ignore[arg-type]
