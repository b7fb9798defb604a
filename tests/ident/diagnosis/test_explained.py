"""Laws of what is told of a name: units are those of its joint."""

from __future__ import annotations

import pytest

from ident.diagnosis.explained import OF_A_SLIDE, of_a_slide


@pytest.mark.parametrize(("turning", "sliding"), list(OF_A_SLIDE.items()))
def test_every_unit_of_a_turning_joint_has_one_of_a_sliding_joint(turning: str, sliding: str) -> None:
    assert of_a_slide(f"it takes 3 {turning} (1 to 5 {turning})") == f"it takes 3 {sliding} (1 to 5 {sliding})"


def test_a_curved_law_of_a_slide_is_a_force_over_a_speed_in_metres() -> None:
    told = of_a_slide("give it a curved friction law, 2.1 N m (|v| / (1 rad/s))^0.5, beside its line")
    assert told == "give it a curved friction law, 2.1 N (|v| / (1 m/s))^0.5, beside its line"


def test_words_stay_as_they_are() -> None:
    assert of_a_slide("the radius of a quadrant: 3 N") == "the radius of a quadrant: 3 N"
