"""Units are read off keys, and those of joints that slide off those of joints that turn."""

import pytest

from ident.effects.interval import Interval
from ident.units import OF_KEYS, SLIDING, TORQUE, in_linear_units, split_key, unit_for


@pytest.mark.parametrize(("ending", "unit"), list(OF_KEYS.items()))
def test_a_key_ends_in_its_whole_unit(ending: str, unit: str) -> None:
    """Law: `_rad_s` is a speed, not a time; no ending hides a longer one."""
    assert split_key(f"size{ending}") == ("size", unit)


def test_a_key_without_a_unit_is_its_own_name() -> None:
    assert split_key("exponent") == ("exponent", "")


@pytest.mark.parametrize(("turning", "sliding"), list(SLIDING.items()))
def test_a_joint_that_slides_has_a_unit_of_its_own(turning: str, sliding: str) -> None:
    """Law: asked for alone and within a sentence it is the same; of a joint that turns nothing changes."""
    assert unit_for(turning, slides=True) == sliding
    assert unit_for(turning, slides=False) == turning
    assert in_linear_units(f"off by 0.2 {turning} at rest") == f"off by 0.2 {sliding} at rest"


def test_a_unit_that_every_joint_has_stays() -> None:
    assert unit_for("%", slides=True) == "%"
    assert in_linear_units("joint_Nm reads 3 %") == "joint_Nm reads 3 %"
    assert TORQUE in SLIDING


def test_degrees_stand_beside_an_angle_and_never_beside_a_length() -> None:
    """Law: a tilt is told as a level shows it, too; a zero of a joint that slides has none."""
    tilt = Interval(0.0259, 0.0219, 0.0299)
    told = f"add {tilt:mrad°} to its reading"
    assert told == "add 25.9 mrad [21.9, 29.9] (1.48°) to its reading"
    assert in_linear_units(told) == "add 25.9 mm [21.9, 29.9] to its reading"


@pytest.mark.parametrize("value", [0.0, -1.5e-7, 4e-6])
def test_a_value_that_its_interval_swallows_is_nothing(value: float) -> None:
    """Law: digits that the interval's own do not reach are not written."""
    assert f"{Interval(value, -0.00395, 0.00395):mrad}" == "0 mrad [−3.95, 3.95]"
