"""Settings of all stages: each says what it is, and is obeyed."""

from dataclasses import replace
from functools import reduce

import pytest

from ident import InputError
from ident import diagnose as diagnose_files
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.settings import USUAL
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import load_friction_on_2, record


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
