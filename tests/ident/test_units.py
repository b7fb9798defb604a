"""Units are read off keys, and those of joints that slide off those of joints that turn."""

import pytest

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
