"""The numbers that decide: each says what it is, and each gate obeys the ones that it was given."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ident.diagnosis.selection.search import Gates
from ident.diagnosis.settings import USUAL, DiagnosisSettings

CLEAR = Gates(
    p_value=0.001,
    log_score=(50.0, 5.0),
    rms_fall=0.2,
    gap_fall=0.5,
    share=0.5,
    own_share=0.5,
    evidence=100.0,
    absorbed=False,
)


def test_every_number_says_what_it_is_and_where_it_comes_from() -> None:
    """Law: unit, meaning and source stand with each; a result records each by its name."""
    for one in DiagnosisSettings.describe():
        assert one["unit"]
        assert one["meaning"]
        assert one["source"].startswith(("law: ", "chosen: ", "calibrated: "))
        assert USUAL.to_dict()[one["name"]] == one["value"]


@pytest.mark.parametrize(
    "stricter", [{"family_error": 1e-4}, {"least_rms_fall": 0.3}, {"least_gap_fall": 0.6}, {"least_own_share": 0.6}]
)
def test_a_gate_obeys_the_settings_that_it_was_given(stricter: dict[str, float]) -> None:
    """Law: what passes as usual does not pass where one number asks for more."""
    assert CLEAR.passed
    assert not replace(CLEAR, settings=replace(USUAL, **stricter)).passed  # type: ignore[arg-type]
