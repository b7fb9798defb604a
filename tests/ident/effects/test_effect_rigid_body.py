"""Masses, gravity and pushes: arms that are really different, distinguished from the nominal arm's columns."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from smooth_motion import Recover, make_session

from ident.arrays import Array
from ident.effects.added_body import PLACE
from ident.effects.base import SessionContext, Variant, impossible
from ident.effects.catalogue import find_effect
from ident.effects.contact import ExternalContact
from ident.effects.pushes import Leftover, Push, force_columns, locate, pairs_of_ends, screen_windows
from ident.laws.acting import point_mass, shifted
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


def test_a_link_weighs_what_its_urdf_says_until_a_name_takes_it_off(session: SessionContext) -> None:
    """Law: what tuning alone took off a link, a name takes off it, not once more: it may be up to all of the URDF's."""
    effect = find_effect("link_inertial_error")
    arm = session.runs[0].arm
    taken = np.zeros_like(arm.inertial_parameters)
    taken[20] = -0.6 * arm.inertial_parameters[20]
    runs = [replace(run, arm=arm.with_inertial_parameters(arm.inertial_parameters + taken)) for run in session.runs]
    tuned = replace(session, runs=runs, tuned=taken)
    shift = 0.1 * effect.prior_scale(session, 2, Variant())
    covariance = np.diag((1e-3 * shift) ** 2)
    for share, is_possible in ((0.7, True), (1.2, False)):
        change = np.append(-share * arm.inertial_parameters[20], shift[1:])
        figures = effect.parameters(tuned, 2, Variant(), change, covariance)
        assert (impossible(effect, tuned, 2, figures) is None) == is_possible


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


@pytest.mark.parametrize("number", range(3))
def test_what_is_known_of_a_load_is_a_density(number: int, session: SessionContext) -> None:
    """Law: over all masses and centres it integrates to one, wherever the load is laid out.

    By importance sampling: masses and distances drawn with wide logarithms, directions evenly.
    """
    effect = find_effect("payload")
    variant = effect.variants(session, 0)[number]
    prior = effect.size_prior(session, 0, variant)
    rng = np.random.default_rng(number)
    count = 40_000
    log_mass = rng.uniform(np.log(1e-3), np.log(1e3), count)
    log_distance = rng.uniform(np.log(1e-4), np.log(30.0), count)
    direction = rng.normal(size=(count, 3))
    centre = np.exp(log_distance)[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
    mass = np.exp(log_mass)
    arm = session.runs[0].arm
    place = effect._law(arm, variant)[1:4, 0]
    shift = mass[:, None] * (centre - place)
    density = np.exp([prior.log_density(np.array([m, *s])) for m, s in zip(mass, shift, strict=True)])
    # d(m) d³(m c) in terms of log m and log r: m · 4π r³ m³
    volume = mass * 4.0 * np.pi * np.exp(3.0 * log_distance) * mass**3
    widths = (np.log(1e3) - np.log(1e-3)) * (np.log(30.0) - np.log(1e-4))
    assert np.mean(density * volume) * widths == pytest.approx(1.0, abs=0.05)


def test_an_arm_whose_links_were_tuned_below_zero_still_weighs_something(session: SessionContext) -> None:
    """Law: priors of bodies are finite where tuning took more off a link than the whole arm weighs."""
    run, effect = session.runs[0], find_effect("payload")
    parameters = run.arm.inertial_parameters.copy()
    parameters[10] -= 2.0 * parameters[::10].sum()
    tuned = replace(session, runs=(replace(run, arm=run.arm.with_inertial_parameters(parameters)),))
    prior = effect.size_prior(tuned, 0, effect.variants(session, 0)[0])
    assert (prior.deviation > 0.0).all()
    assert np.isfinite(prior.log_density(np.array([1.0, 0.0, 0.0, 0.1])[: len(prior.deviation)]))


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


FORCE = np.array([12.0, -5.0, 8.0])


def push(session: SessionContext, run_index: int, start: float, end: float) -> list[np.ndarray]:
    """Torque −Jᵀ f of a force at the last link's centre of mass, by Pinocchio's Jacobian."""
    torque = [np.zeros_like(run.motion.q) for run in session.runs]
    run = session.runs[run_index]
    model, data = run.arm.model, run.arm.model.createData()
    centre = model.inertias[run.n].lever
    for k in np.flatnonzero((run.motion.time > start) & (run.motion.time < end)):
        jacobian = pin.computeJointJacobian(model, data, run.motion.q[k], run.n)
        pin.forwardKinematics(model, data, run.motion.q[k])
        at_centre = data.oMi[run.n].rotation @ (jacobian[:3] - pin.skew(centre) @ jacobian[3:])
        torque[run_index][k] = -at_centre.T @ FORCE
    return torque


@pytest.mark.parametrize(("swells", "seconds", "timed", "sized"), [(False, 1.2, 0.1, 0.1), (True, 1.5, 0.25, 0.15)])
def test_a_push_is_found_in_its_window(
    session: SessionContext, recover: Recover, swells: bool, seconds: float, timed: float, sized: float
) -> None:
    """Screening what is left finds the window; in it the force comes out, and when it began and ended: of one that
    swells and fades as a squared sine its height, from its first rise on.
    """
    start = session.runs[2].motion.time[0] + 8.0
    torque = push(session, 2, start, start + seconds)
    if swells:
        time = session.runs[2].motion.time
        torque[2] = torque[2] * (np.sin(np.pi * (time - start) / seconds) ** 2)[:, None]
    rng = np.random.default_rng(2 + swells)
    left = [
        run.motion.filtered(tau + rng.normal(0, 0.3, tau.shape)) for run, tau in zip(session.runs, torque, strict=True)
    ]
    found_there = ExternalContact().screened(session, left)
    assert swells or [one.run for one in found_there.pushes] == ["run_2"] * 2  # the window, and the force's span
    assert found_there.screens > 100  # every window and point that was looked at counts
    found = recover(found_there, session, 0, torque)
    np.testing.assert_allclose(found["start_s"].value, start, atol=timed)
    np.testing.assert_allclose(found["end_s"].value, start + seconds, atol=timed)
    np.testing.assert_allclose(found["force_N"].value, np.linalg.norm(FORCE), rtol=sized)
    assert found["link"].value == 6.0


@pytest.mark.parametrize("outward", [0.0, 0.5])
def test_where_a_push_acts_does_not_hang_on_tuning(session: SessionContext, outward: float) -> None:
    """Law: a link that tuning left next to no mass, or less than none, is pushed where the URDF has its centre."""
    run = session.runs[0]
    given = run.arm.inertial_parameters
    for link in (2, 3):
        for left in (1e-6, -2.0):
            change = np.zeros(10 * session.n)
            change[10 * (link - 1)] = left - given[10 * (link - 1)]
            tuned = run.arm.with_inertial_parameters(given + change)
            columns = force_columns(tuned, run.motion.q[:5], link, outward, change)
            np.testing.assert_allclose(columns, force_columns(run.arm, run.motion.q[:5], link, outward), atol=1e-9)


def test_a_long_push_costs_no_more_than_a_short_one(session: SessionContext) -> None:
    """Law: what leans on the arm for most of a run is found in its time, looked at in no more places than a push is."""
    start = session.runs[2].motion.time[0] + 3.0
    torque = push(session, 2, start, start + 12.0)
    rng = np.random.default_rng(9)
    left = [
        run.motion.filtered(tau + rng.normal(0, 0.3, tau.shape)) for run, tau in zip(session.runs, torque, strict=True)
    ]
    found = ExternalContact().screened(session, left).pushes
    assert min(abs(one.start - start) + abs(one.end - start - 12.0) for one in found) < 0.6
    first, last = pairs_of_ends(100_000, 1, 2)
    assert len(first) < 25_000
    assert (last.max(), first.min()) == (100_000, 0)
    assert set(zip(*pairs_of_ends(3, 1, 2), strict=True)) == {(0, 2), (0, 3), (1, 3)}


def test_a_push_of_which_one_sample_is_known_is_none(session: SessionContext) -> None:
    """Law: three components of a force explain any one sample, so that it says nothing of a push."""
    time = session.runs[2].motion.time[session.runs[2].motion.coarse]
    start = float(time[0]) + 8.0
    torque = push(session, 2, start, start + 1.2)
    left = [run.motion.filtered(tau) for run, tau in zip(session.runs, torque, strict=True)]
    window = Push("run_2", start, start + 1.2)
    assert locate(Leftover(session, left), window).share > 0.9
    inside = np.flatnonzero((time > start - 0.1) & (time < start + 1.3))
    left[2][np.delete(inside, len(inside) // 2)] = np.nan
    assert locate(Leftover(session, left), window).share == 0.0


def test_a_push_stands_out_of_the_friction_of_its_run(session: SessionContext) -> None:
    """Where a run's friction leaves as much before and after as the push itself, the window is still that of the push,
    and a constant force explains what changes in it.
    """
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(5).normal(0, 0.3, item.motion.tau_filtered.shape) for item in session.runs]
    start = float(time[0]) + 5.0
    force = force_columns(run.arm, run.motion.q[run.motion.coarse], 3, 0.0) @ (0.5 * FORCE)
    around, inside = np.abs(time - start - 0.5) < 2.0, (time > start) & (time < start + 1.0)
    left[1] -= np.where(around[:, None], 0.5 * force[inside].mean(axis=0), 0.0)
    left[1] += np.where(inside[:, None], force, 0.0)
    windows = [push for push in screen_windows(Leftover(session, left)) if push.run == "run_1"]
    assert any(abs(push.start - start) < 0.1 and abs(push.end - start - 1.0) < 0.1 for push in windows)
    best = max((locate(Leftover(session, left), push) for push in windows), key=lambda one: one.share)
    assert best.push.link == 3
    assert best.share > 0.8


def test_a_push_on_a_standing_arm_stands_out_of_its_holds(session: SessionContext) -> None:
    """Law: in a run of which nothing goes beyond friction but in a window, what does is a push; its link is found."""
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(6).normal(0, 0.1, item.motion.tau_filtered.shape) for item in session.runs]
    left[1][:] = 0.0
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 1.0)
    left[1][inside] = force_columns(run.arm, run.motion.q[run.motion.coarse][inside], 4, 1.0) @ (4.0 * FORCE)
    windows = screen_windows(Leftover(session, left))
    assert [one.run for one in windows] == ["run_1"]
    np.testing.assert_allclose([windows[0].start, windows[0].end], [start, start + 1.0], atol=0.1)
    best = locate(Leftover(session, left), windows[0])
    assert best.push.link == 4
    assert best.share > 0.95


@pytest.mark.parametrize(("shaken", "least", "most"), [(False, 0.75, 1.0), (True, 0.0, 0.6)])
def test_noise_around_a_faint_push_says_nothing_against_it(
    session: SessionContext, shaken: bool, least: float, most: float
) -> None:
    """Law: of three times the noise of the joint that feels it most a constant force explains what is more than noise,
    though noise is most of what is left; of the same force shaken to and fro it doesn't.
    """
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(7).normal(0, 0.3, item.motion.tau_filtered.shape) for item in session.runs]
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 0.7)
    felt = force_columns(run.arm, run.motion.q[run.motion.coarse][inside], 4, 1.0) @ FORCE
    sway = np.random.default_rng(8).choice([-1.0, 1.0], len(felt)) if shaken else np.ones(len(felt))
    left[1][inside] += 0.9 * felt / np.sqrt(np.mean(felt**2, axis=0)).max() * sway[:, None]
    share = locate(Leftover(session, left), Push("run_1", start, start + 0.7)).share
    assert least <= share <= most


@pytest.mark.parametrize("delay", [0.001, 0.005, 0.013, 0.025])
def test_a_delay_is_found_on_and_off_the_grid(arm: ArmModel, recover: Recover, delay: float) -> None:
    """The torque of the same motion, computed late instead of shifted: the delay is within 3 %."""
    session, late = make_session(arm, 10.0, 2), make_session(arm, 10.0, 2, late=delay)
    torque = [b.total - a.total for a, b in zip(session.runs, late.runs, strict=True)]
    found = recover(find_effect("torque_delay"), session, 0, torque)["delay_s"]
    np.testing.assert_allclose(found.value, delay, rtol=0.03)


def test_flat_tops_are_found_with_their_limit(session: SessionContext, recover: Recover) -> None:
    """Torque clipped at 80 % of its largest is found there; below the limit nothing is said."""
    effect = find_effect("torque_saturation")
    whole = np.concatenate([run.total[:, 1] for run in session.runs])
    limit = 0.8 * np.quantile(np.abs(whole), 0.999)
    torque = [np.clip(run.total[:, 1], -limit, limit) - run.total[:, 1] for run in session.runs]
    found = recover(effect, session, 1, torque)["limit_Nm"]
    np.testing.assert_allclose(found.value, limit, rtol=1e-3)
    assert found.low < limit < found.high
    variant = effect.variants(session, 1)[0]
    run = session.runs[0]
    low = np.abs(run.total[:, 1]) < variant.shape["knee_Nm"]
    assert not effect.columns(session, 1, variant)[0][low].any()
    assert np.all(effect.columns(session, 1, variant)[0][:, 0] * run.total[:, 1] <= 0.0)


@pytest.mark.parametrize("shift", [0.3, -0.45])
def test_a_zero_that_is_far_off_is_found_by_its_secant(session: SessionContext, shift: float) -> None:
    """Law: the columns about an offset, times the offset, are the torque that it makes; the slope leaves 4 % of it or
    more. Both signs and offsets up to half a radian are among the points of the finer grid, within a fifth.
    """
    effect, joint = find_effect("encoder_offset"), 1
    exact = [
        run.arm.inverse_dynamics(run.motion.q + shift * np.eye(6)[joint], run.motion.dq, run.motion.ddq) - run.rigid
        for run in session.runs
    ]
    grid = effect.refined(session, joint, effect.variants(session, joint)[0])
    nearest = min((one.shape["about_rad"] for one in grid), key=lambda about: abs(about - shift))
    assert abs(nearest - shift) < 0.2 * abs(shift)
    secant = effect.columns(session, joint, Variant(shape={"about_rad": shift}))
    slope = effect.columns(session, joint, Variant(shape={"about_rad": 0.0}))
    for column, straight, torque in zip(secant, slope, exact, strict=True):
        np.testing.assert_allclose(shift * column[:, :, 0], torque, atol=1e-9)
        left = torque - shift * straight[:, :, 0]
        assert np.sqrt(np.mean(left**2)) > 0.04 * np.sqrt(np.mean(torque**2))


def test_a_force_acts_by_the_jacobian(session: SessionContext) -> None:
    """Unit forces give the columns of −Jᵀ, whatever the links weigh."""
    run = session.runs[0]
    torque = push(session, 0, -1.0, 1.0)[0]
    inside = run.motion.time < 1.0
    np.testing.assert_allclose(force_columns(run.arm, run.motion.q[inside], run.n) @ FORCE, torque[inside], atol=1e-9)


def test_a_shift_by_whole_samples_is_exact_and_by_parts_is_cubic() -> None:
    """Three samples late is the value three samples ago; a cubic is shifted by any part exactly."""
    t = np.arange(40.0)
    values = np.stack([np.sin(t), 1 + t - 0.1 * t**2 + 0.01 * t**3], axis=1)
    np.testing.assert_allclose(shifted(values, 3.0, 1.0)[3:], values[:-3])
    late = t - 2.3
    np.testing.assert_allclose(shifted(values, 2.3, 1.0)[5:, 1], (1 + late - 0.1 * late**2 + 0.01 * late**3)[5:])
