"""Masses and gravity: arms that are really different, told from the nominal arm's columns."""

from dataclasses import replace

import numpy as np
import pytest
from smooth_motion import Recover, make_session

from ident.arrays import Array
from ident.effects.added_body import PLACE
from ident.effects.base import SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.laws.acting import point_mass
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel


def difference(session: SessionContext, other: ArmModel) -> list[Array]:
    """Torque of another arm on the same motion, less the nominal arm's."""
    motions = [run.motion for run in session.runs]
    return [other.inverse_dynamics(m.q, m.dq, m.ddq) - run.rigid for m, run in zip(motions, session.runs, strict=True)]


@pytest.mark.parametrize("com", [(0.0, 0.0, 0.03), (0.02, -0.03, 0.1)])
def test_a_payload_is_found_with_its_centre(session: SessionContext, recover: Recover, com: tuple[float, ...]) -> None:
    """A point mass of 1.5 kg, at and off the points of the grid."""
    torque = difference(session, session.runs[0].arm.with_payload(Payload(1.5, com)))
    found = recover(find_effect("payload"), session, 0, torque)
    np.testing.assert_allclose(found["mass_kg"].value, 1.5, rtol=0.01)
    np.testing.assert_allclose([found[f"com_{axis}_m"].value for axis in "xyz"], com, atol=0.005)


def test_a_load_has_a_height_only_where_it_is_tilted(session: SessionContext) -> None:
    """On a SCARA no motion shows how far below the flange the load hangs: it has no column for it."""
    scara = ArmModel.load("scara")
    hanging = make_session(scara, seconds=2.0, runs=1)
    effect = find_effect("payload")
    columns = [effect.columns(one, 0, effect.variants(one, 0)[0])[0].shape[-1] for one in (hanging, session)]
    assert columns == [3, 4]
    figures = effect.parameters(hanging, 0, effect.variants(hanging, 0)[0], np.ones(3), 0.01 * np.eye(3))
    assert (figures["com_z_m"].open, figures["com_x_m"].open) == ("both", "")


@pytest.mark.parametrize(("spread", "open_end"), [(0.05, ""), (2.0, "low")])
def test_no_link_weighs_less_than_nothing(session: SessionContext, spread: float, open_end: str) -> None:
    """Law: where less than nothing is as likely, a link's mass stays open, and what to do is stated by its moment."""
    effect, own = find_effect("link_inertial_error"), session.runs[0].arm.inertial_parameters[20]
    shift, error = 0.2 * effect.prior_scale(session, 2, Variant()), spread * own * np.array([1.0, 0.01, 0.01, 0.01])
    figures = effect.parameters(session, 2, Variant(), np.append(-0.5 * own, shift[1:]), np.diag(error**2))
    assert (figures["mass_change_kg"].open, "moment" in effect.action("joint_3", figures)) == (open_end, open_end != "")


@pytest.mark.parametrize("name", ["payload", "link_inertial_error"])
def test_of_a_bar_that_turns_about_a_fixed_point_the_moment_is_told_and_no_mass(recover: Recover, name: str) -> None:
    """Law: 0.4 kg at 0.3 m of one level joint are 0.12 kg m, whatever the inertia says of the mass."""
    bar = ArmModel.load("tm5-900", joints=["joint_2"])
    session, at = make_session(bar, seconds=4.0, runs=2), (0.3, 0.0, 0.0)
    body = point_mass(np.array(at)) + np.concatenate([np.zeros(4), 0.05 * np.array([1.0, 0, 1.0, 0, 0, 1.0])])
    torque = difference(session, bar.with_inertial_parameters(bar.inertial_parameters + 0.4 * body))
    effect = find_effect(name)
    found = recover(effect, session, 0, torque)
    mass = found["mass_kg" if name == "payload" else "mass_change_kg"]
    assert mass.open == "both"
    assert mass.low <= 0.4 <= mass.high
    np.testing.assert_allclose(found["moment_about_axis_kgm"].value, 0.12, rtol=0.02)
    assert "kg m" in effect.action("joint_2", found)
    assert " kg [" not in effect.action("joint_2", found)


def test_a_heavier_link_is_found(session: SessionContext, recover: Recover) -> None:
    """Link 3 with 12 % more of everything: its mass and its moment say so."""
    arm = session.runs[0].arm
    parameters = arm.inertial_parameters.reshape(6, 10).copy()
    parameters[2] *= 1.12
    torque = difference(session, arm.with_inertial_parameters(parameters.ravel()))
    found = recover(find_effect("link_inertial_error"), session, 2, torque)
    seen = [found[name].value for name in ("mass_change_kg", "moment_change_x_kgm")]
    np.testing.assert_allclose(seen, 0.12 * arm.inertial_parameters[20:22], rtol=0.05)


def test_a_tilted_base_is_found_about_both_axes(session: SessionContext, recover: Recover) -> None:
    """Turned by 10 and −15 mrad about its own axes, the base sees gravity the other way round."""
    turn_x, turn_y = 0.010, -0.015
    about_x = np.array([[1, 0, 0], [0, np.cos(turn_x), -np.sin(turn_x)], [0, np.sin(turn_x), np.cos(turn_x)]])
    about_y = np.array([[np.cos(turn_y), 0, np.sin(turn_y)], [0, 1, 0], [-np.sin(turn_y), 0, np.cos(turn_y)]])
    gravity = (about_x @ about_y).T @ np.array([0.0, 0.0, -9.81])
    torque = difference(session, session.runs[0].arm.with_gravity(gravity))
    found = recover(find_effect("gravity_misalignment"), session, 0, torque)
    np.testing.assert_allclose([found[f"tilt_{axis}_rad"].value for axis in "xy"], (turn_x, turn_y), atol=3e-4)


def test_a_body_is_laid_out_about_the_place_that_tuning_tells(session: SessionContext) -> None:
    """Law: where tuning has put one body on a link, that is its place, and its column there is its torque, whole; what
    is usual of it beforehand does not hang on where it is laid out.
    """
    link, mass, place = 4, 0.4, np.array([0.09, -0.11, 0.06])
    body = mass * point_mass(place)
    tuned = np.zeros(10 * session.n)
    tuned[10 * link : 10 * link + 10] = body
    effect = find_effect("link_inertial_error").screened(replace(session, tuned=tuned), [])
    usual, placed = effect.variants(session, link)
    np.testing.assert_allclose([placed.shape[name] for name in PLACE], place, atol=1e-6)
    at_place = np.array([mass, 0.0, 0.0, 0.0])
    seen = effect.columns(session, link, placed)[0] @ at_place
    np.testing.assert_allclose(seen, session.runs[0].regressor[:, :, 10 * link : 10 * link + 10] @ body, atol=1e-9)
    arm = session.runs[0].arm
    shift = mass * (place - arm.inertial_parameters[10 * link + 1 : 10 * link + 4] / arm.inertial_parameters[10 * link])
    priors = [effect.size_prior(session, link, variant) for variant in (usual, placed)]
    assert priors[1].log_density(at_place) == pytest.approx(priors[0].log_density(np.append(mass, shift)))
    whole = find_effect("payload").screened(replace(session, tuned=tuned), [])
    assert len(whole.variants(session, 0)) == len(find_effect("payload").variants(session, 0))
    assert find_effect("link_inertial_error").screened(session, []).variants(session, link) == (Variant(),)


def test_a_shifted_centre_is_no_mass(session: SessionContext, recover: Recover) -> None:
    """Link 2 with its centre 10 mm further out: the first moment changes, and the inertia with it."""
    arm = session.runs[0].arm
    parameters = arm.inertial_parameters.reshape(6, 10).copy()
    mass, centre = parameters[1, 0], parameters[1, 1:4] / parameters[1, 0]
    moved = centre + np.array([0.01, 0.0, 0.0])
    steiner = mass * ((moved @ moved - centre @ centre) * np.eye(3) - np.outer(moved, moved) + np.outer(centre, centre))
    parameters[1, 1:4] = mass * moved
    parameters[1, 4:] += steiner[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    torque = difference(session, arm.with_inertial_parameters(parameters.ravel()))
    found = recover(find_effect("link_inertial_error"), session, 1, torque)
    np.testing.assert_allclose(found["moment_change_x_kgm"].value, 0.01 * mass, rtol=0.05)
    assert abs(found["mass_change_kg"].value) < 0.05 * mass
