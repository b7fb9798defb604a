"""Laws of what is told of a name: units are those of its joint."""

from __future__ import annotations

import pytest

from ident.diagnosis.heldout_gain import OF_A_SLIDE, of_a_slide


@pytest.mark.parametrize(("turning", "sliding"), list(OF_A_SLIDE.items()))
def test_every_unit_of_a_turning_joint_has_one_of_a_sliding_joint(turning: str, sliding: str) -> None:
    assert of_a_slide(f"it takes 3 {turning} (1 to 5 {turning})") == f"it takes 3 {sliding} (1 to 5 {sliding})"


def test_a_curved_law_of_a_slide_is_a_force_over_a_speed_in_metres() -> None:
    told = of_a_slide("at 0.5 rad/s 2.1 N m [1, 3] more than on the straight line from rest to 1 rad/s")
    assert told == "at 0.5 m/s 2.1 N [1, 3] more than on the straight line from rest to 1 m/s"


def test_words_stay_as_they_are() -> None:
    assert of_a_slide("the radius of a quadrant: 3 N") == "the radius of a quadrant: 3 N"
