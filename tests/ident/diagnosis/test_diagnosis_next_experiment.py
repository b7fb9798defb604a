"""What the diagnosis proposes to record next."""

from __future__ import annotations

from itertools import combinations

import pytest

from ident.diagnosis.next_experiment import next_experiment
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import SHOWINGS, describe_motion, family_for, setup_for


def finding(*effects: str, joint: str = "joint_2") -> dict[str, object]:
    return {"effect": effects[0], "class": list(effects), "joints": [joint]}


def unseen(effect: str, *joints: str, reason: str = "it stands still") -> dict[str, object]:
    return {"effect": effect, "joints": list(joints), "reason": reason}


def test_nothing_open_needs_no_experiment() -> None:
    """A single name, and effects that no motion could show, leave nothing to propose."""
    assert next_experiment([], []) is None
    assert next_experiment([finding("torque_delay")], []) is None
    assert (
        next_experiment([], [unseen("torque_ripple", "joint_1", reason="gear ratio of joint_1 is not known")]) is None
    )


def test_first_tied_class_is_parted() -> None:
    """The motion is for the joint and the effects of the first class of two or more, not for later ones."""
    found = next_experiment(
        [
            finding("payload"),
            finding("joint_elasticity", "torque_delay", joint="joint_3"),
            finding("stribeck_friction", "presliding_hysteresis"),
        ],
        [unseen("thermal_friction", "joint_1")],
    )
    assert found is not None
    assert found["separates"] == ["joint_elasticity", "torque_delay"]
    assert "swept in frequency" in found["motion"]
    assert "--robot tm5-900 --separate joint_elasticity,torque_delay --joint joint_3 --out" in found["motion"]
    assert found["minutes"] > 0


def test_exact_twins_get_another_set_up() -> None:
    """Payload and last link are one torque in every motion: the proposal is to take the payload off."""
    found = next_experiment([finding("payload", "link_inertial_error", joint="joint_6")], [])
    assert found is not None
    assert "Take everything off the flange" in found["motion"]
    assert "plan excite" not in found["motion"]


def test_a_gap_without_a_name_is_asked_about_where_it_is_largest() -> None:
    """By what came nearest there; else by what could not be tested there; not at another joint's first."""
    near = {"effect": "joint_elasticity", "joints": ["joint_2"]}
    silent = [unseen("joint_elasticity", "joint_6"), unseen("backlash", "joint_2", "joint_6")]
    for nearest, effect in (
        (near, "joint_elasticity"),
        (None, "backlash"),
        ({**near, "joints": ["joint_4"]}, "backlash"),
    ):
        found = next_experiment([], silent, nearest=nearest, loudest="joint_2")
        assert found is not None
        assert found["separates"] == [effect]
        assert "--joint joint_2 " in found["motion"]


def test_unseen_effects_get_the_motion_that_shows_most_of_them() -> None:
    """Three effects want a ladder of speeds and one a chirp: the ladder is proposed, for the joint that lacks most."""
    entries = [
        unseen("stribeck_friction", "joint_5"),
        unseen("nonlinear_viscous_friction", "joint_5"),
        unseen("asymmetric_friction", "joint_4"),
        unseen("torque_delay", "joint_1"),
    ]
    found = next_experiment([], entries)
    assert found is not None
    assert found["separates"] == ["stribeck_friction", "nonlinear_viscous_friction", "asymmetric_friction"]
    assert found["motion"].startswith("joint_5 there and back at steady speeds")


@pytest.mark.parametrize("effect", CATALOGUE)
def test_every_effect_of_the_catalogue_has_its_motion(effect: Effect) -> None:
    """Whatever is named, there are words for the motion that shows it."""
    assert "{" not in describe_motion(effect.shown_by, "joint_1")


def test_every_pair_has_a_motion_or_a_set_up() -> None:
    """No tied class leaves the user without advice."""
    for pair in combinations([effect.id for effect in CATALOGUE], 2):
        assert setup_for(pair, CATALOGUE) or family_for(pair, CATALOGUE) in SHOWINGS
    assert setup_for(("payload", "link_inertial_error"), CATALOGUE)
    assert setup_for(("spring_torque", "gravity_misalignment"), CATALOGUE) is None


def test_unknown_effects_get_general_motion() -> None:
    """An effect of the user's own has no row in the tables: wide motion of all joints."""
    assert family_for(["magnet"], CATALOGUE) == "wide"
