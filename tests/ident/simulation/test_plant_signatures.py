"""Each effect changes the recordings as its signature says: parity, speed, load, memory, time, frequency.

The tests know the signatures of the catalogue and no law of the plant: they switch an effect on and look at the
difference of the recorded torque, on motions made to show it.
"""

from itertools import pairwise

import numpy as np
import pytest
from laboratory import RATE_HZ, changes, record, there_and_back, with_effect

from ident.recordings.recording import Payload
from ident.trajectories.reference import chirp, ramps, together, via_spline

J = 1  # joint_2 carries the arm: friction, gravity and inertia all show there
SLIP = 0.02
POSE = np.array([0.2, 0.5, 0.8, 0.3, 0.4, 0.2])


def path_and_back(arm, joint=None):
    """The same path forward and backward, at the same speeds."""
    rng = np.random.default_rng(4)
    points = POSE + 0.5 * rng.uniform(-1.0, 1.0, (4, arm.n))
    if joint is not None:
        others = [j for j in range(arm.n) if j != joint]
        points[:, others] = POSE[others]
        points[:, joint] = POSE[joint] + np.array([-0.5, -0.1, 0.3, 0.7])
    forward = via_spline("forward", points, 3.0)
    return [forward.held(0.1, 0.1), forward.reversed("backward").held(0.1, 0.1)]


def odd_share(hardware, effect, joint, size):
    """Share of an effect's torque that turns its sign with the velocity on the same path."""
    alone = path_and_back(hardware.arm, joint)
    (forward, backward), runs = changes(hardware, alone, effect, joint, size)
    there, back = forward[:, joint], backward[::-1, joint]
    moving = np.abs(runs[0].velocity[:, joint]) > 0.15
    odd, even = (there - back)[moving], (there + back)[moving]
    return float(odd @ odd / (odd @ odd + even @ even))


ODD = {
    "nonlinear_viscous_friction": 3.0,
    "load_dependent_friction": 0.1,
    "presliding_hysteresis": 4.0,
    "position_dependent_friction": 3.0,
}
EVEN = {
    "asymmetric_friction": 3.0,
    "spring_torque": 5.0,
    "payload": 1.0,
    "link_inertial_error": 0.2,
    "torque_offset": 2.0,
    "gravity_misalignment": 0.03,
}


@pytest.mark.parametrize("effect", [*ODD, *EVEN])
def test_friction_is_odd_and_conservative_or_constant_torques_are_even(hardware, effect):
    # A tilted base shows on the vertical joint 1 as it turns.
    joint = 0 if effect == "gravity_misalignment" else J
    share = odd_share(hardware, effect, joint, {**ODD, **EVEN}[effect])
    assert share > 0.8 if effect in ODD else share < 0.2


def steady(run, change, joint, speed):
    """Mean change where a joint moves at a constant speed [N m]."""
    at = np.abs(run.velocity[:, joint] - speed) < 0.04 * abs(speed)
    assert at.sum() > 20
    return float(change[at, joint].mean())


def test_stribeck_is_odd_and_lives_at_low_speed(hardware):
    motion = there_and_back(POSE, J, 0.25, [0.03, 1.0])
    (change,), (run,) = changes(hardware, [motion], "stribeck_friction", J, 4.0)
    slow, fast = steady(run, change, J, 0.03), steady(run, change, J, 1.0)
    assert slow > 1.0
    assert abs(fast) < 0.2 * slow
    assert steady(run, change, J, -0.03) == pytest.approx(-slow, rel=0.1)


def test_nonlinear_viscous_friction_is_concave_in_speed(hardware):
    motion = there_and_back(POSE, J, 0.4, [0.2, 0.6, 1.0])
    (change,), (run,) = changes(hardware, [motion], "nonlinear_viscous_friction", J, 3.0)
    low, middle, high = (steady(run, change, J, v) for v in (0.2, 0.6, 1.0))
    assert 0.0 < high - middle < middle - low


def test_load_dependent_friction_grows_with_the_load(hardware):
    """The same motion with a heavy known payload, and none: more friction."""
    motion = there_and_back(POSE, J, 0.3, [0.3])
    mean = []
    for loaded in (hardware, with_effect(hardware, [motion], "payload", J, 4.0)):
        (change,), (run,) = changes(loaded, [motion], "load_dependent_friction", J, 0.1)
        mean.append(steady(run, change, J, 0.3))
    assert mean[0] > 1.0
    assert mean[1] > 1.2 * mean[0]


def test_thermal_friction_falls_with_work_and_comes_back_after_rest(hardware):
    """The same motion again and again: less and less friction; after a long rest it starts anew."""
    motion = there_and_back(POSE, J, 0.6, [1.2, 1.2, 1.2])
    warm, runs = changes(hardware, [motion] * 6, "thermal_friction", J, 0.6, pause=1.0)
    trend = [steady(run, change, J, 1.2) for run, change in zip(runs, warm, strict=True)]
    assert steady(runs[-1], warm[-1], J, -1.2) == pytest.approx(-trend[-1], rel=0.3)  # odd
    assert all(later < earlier for earlier, later in pairwise(trend))
    rested, runs = changes(hardware, [motion] * 2, "thermal_friction", J, 0.6, pause=3e4)
    assert steady(runs[1], rested[1], J, 1.2) == pytest.approx(steady(runs[0], rested[0], J, 1.2), rel=0.1)
    assert abs(trend[-1]) > 2.0 * abs(trend[0])


def test_presliding_builds_up_over_displacement_after_a_reversal(hardware):
    """At two speeds the torque after a reversal is the same function of the way since, not of the time."""
    builds = []
    for speed in (0.05, 0.15):
        motion = there_and_back(POSE, J, 0.2, [speed], push=20.0)
        effect = with_effect(hardware, [motion], "presliding_hysteresis", J, 4.0)
        soft = effect.with_laws("friction", J, soft_stiffness=4.0 / SLIP)  # far softer than any loop transient
        (run,), (after,) = record(hardware, [motion]), record(soft, [motion])
        change = after.effort - run.effort
        back = int(np.argmax(run.velocity[:, J] < -0.5 * speed))  # under way again, in the other direction
        way = run.position[:, J].max() - run.position[:, J]
        marks = [int(np.argmax(way[back:] > part * SLIP)) + back for part in (0.5, 1.5, 8.0)]
        builds.append([change[mark, J] for mark in marks])
        assert builds[-1][0] > builds[-1][1] > builds[-1][2]
    np.testing.assert_allclose(builds[0], builds[1], atol=0.5)
    assert builds[0][2] == pytest.approx(-4.0, abs=0.3)


def profile(hardware, effect, size, span, speed):
    """Change at nine angles about the pose, on the way there [N m]."""
    motion = there_and_back(POSE, J, span, [speed])
    (change,), (run,) = changes(hardware, [motion], effect, J, size)
    going = np.flatnonzero(np.abs(run.velocity[:, J] - speed) < 0.02)
    return np.interp(POSE[J] + 0.6 * span * np.linspace(-1.0, 1.0, 9), run.position[going, J], change[going, J])


def test_spring_is_a_function_of_the_angle_alone(hardware):
    """At two speeds and with another load the same torque at the same angle, falling or rising along the way."""
    loaded = with_effect(hardware, [there_and_back(POSE, J, 0.6, [0.3])], "payload", J, 3.0)
    slow, fast, heavy = (
        profile(arm, "spring_torque", 8.0, 0.6, speed)
        for arm, speed in ((hardware, 0.3), (hardware, 0.9), (loaded, 0.3))
    )
    np.testing.assert_allclose(fast, slow, atol=0.3)
    np.testing.assert_allclose(heavy, slow, atol=0.3)
    assert (np.diff(slow) > 0.0).all()


def test_coupling_moves_with_the_other_joint(hardware):
    """While the joint itself creeps on steadily, its torque changes its sign with the neighbour's velocity."""
    other = J - 1
    slow = there_and_back(POSE, J, 0.3, [0.1])
    moving = there_and_back(POSE, other, 0.15, [0.3] * 6)
    length = min(len(slow.q), len(moving.q))
    q = slow.q[:length].copy()
    q[:, other] = moving.q[:length, other]
    dq, ddq = slow.dq[:length] + moving.dq[:length], slow.ddq[:length] + moving.ddq[:length]
    both = type(slow)("both", q, dq, ddq)
    (change,), (run,) = changes(hardware, [both], "joint_coupling", J, 5.0)
    own = np.abs(run.velocity[:, J]) > 0.05
    with_other = own & (run.velocity[:, other] > 0.2)
    against = own & (run.velocity[:, other] < -0.2)
    assert abs(change[with_other, J].mean() - change[against, J].mean()) > 5.0


def spectrum_of(change):
    """Frequencies [Hz] and amplitudes of a change at the log's rate."""
    amplitude = np.abs(np.fft.rfft(np.hanning(len(change)) * (change - change.mean())))
    return np.fft.rfftfreq(len(change), 1.0 / RATE_HZ), amplitude


def test_elasticity_grows_with_frequency(hardware):
    """In a chirp nearly nothing shows at the low end; the high end carries the change."""
    n = hardware.n
    sweep = chirp("chirp", POSE, np.full(n, 0.3), (0.2, 10.0), np.zeros(n), 10.0).held(0.1, 0.1)
    (change,), _ = changes(hardware, [sweep], "joint_elasticity", J, 1.5e4)
    early, late = change[: len(change) // 3, J], change[len(change) // 2 : -50, J]
    assert late.std() > 3.0 * early.std()
    frequency, amplitude = spectrum_of(change[:, J])
    power = [np.sum(amplitude[(frequency >= a) & (frequency < b)] ** 2) for a, b in ((0.0, 4.0), (4.0, 30.0))]
    assert power[1] > power[0]


def test_backlash_acts_where_the_load_changes_its_sign(hardware):
    """Swinging through the upright pose the gap is crossed; away from it nothing shows."""
    upright = np.array([0.2, 0.0, 0.02, 0.0, 0.0, 0.0])
    leaning = POSE + np.array([0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    motions = [there_and_back(pose, J, span, [0.4], push=0.8) for pose, span in ((upright, 0.5), (leaning, 0.25))]
    (crossing, away), runs = changes(hardware, motions, "backlash", J, 3e-3)
    assert np.abs(crossing[:, J]).max() > 3.0 * np.abs(away[20:, J]).max()
    strongest = int(np.argmax(np.abs(crossing[:, J])))
    gravity = np.abs(hardware.arm.gravity(runs[0].position)[:, J])
    assert gravity[strongest] < 0.5 * gravity.max()


@pytest.mark.parametrize("speed", [0.1, 0.25])
def test_ripple_is_a_line_that_follows_the_speed(hardware, speed):
    """The strongest line of the change stands at order times speed over 2π."""
    order = hardware.drive.ripple_order[J]
    motion = there_and_back(POSE, J, 0.4, [speed])
    (change,), (run,) = changes(hardware, [motion], "torque_ripple", J, 2.0)
    going = np.flatnonzero(np.abs(run.velocity[:, J] - speed) < 0.1 * speed)
    frequency, amplitude = spectrum_of(change[going[0] : going[-1], J])
    assert frequency[int(np.argmax(amplitude))] == pytest.approx(order * speed / (2.0 * np.pi), rel=0.08)


def test_tilt_gives_gravity_to_the_vertical_joint(hardware):
    """Joint 1 is vertical: without tilt it carries no gravity; with it, a torque that turns with the joint."""
    motion = there_and_back(POSE, 0, 1.5, [0.5])
    (change,), (run,) = changes(hardware, [motion], "gravity_misalignment", 5, 0.04)
    going = run.velocity[:, 0] > 0.45
    angle, torque = run.position[going, 0], change[going, 0]
    columns = np.column_stack([np.cos(angle), np.sin(angle)])
    fitted = columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    assert np.ptp(torque) > 0.5
    assert np.std(torque - fitted) < 0.1 * np.std(torque)


def test_offset_is_there_at_rest_too_and_drifts(hardware):
    motions = path_and_back(hardware.arm)
    (first, second), _ = changes(hardware, motions, "torque_offset", J, 1.0, pause=120.0)
    assert np.ptp(first[:, J]) < 0.02
    assert first[0, J] == pytest.approx(1.0, abs=0.25)
    assert abs(second[0, J] - first[0, J]) > 0.01


def test_delay_is_common_and_grows_with_frequency(hardware):
    """Every joint's torque is late by the same time: to first order the change is -delay dτ/dt."""
    delay, n = 0.004, hardware.n
    sweep = chirp("chirp", POSE, np.full(n, 0.25), (0.2, 6.0), np.arange(n) * 1.0, 8.0).held(0.1, 0.1)
    (change,), (run,) = changes(hardware, [sweep], "torque_delay", J, delay)
    slope = np.gradient(run.effort, run.time, axis=0)
    for j in range(n):
        fitted = -(change[:, j] @ slope[:, j]) / (slope[:, j] @ slope[:, j])
        assert fitted == pytest.approx(delay, rel=0.25)
    assert np.std(change[len(change) // 2 :, J]) > np.std(change[: len(change) // 3, J])


def test_saturation_has_flat_tops(hardware):
    """The reading never passes the limit, and below three quarters of it nothing changes."""
    motions = path_and_back(hardware.arm)
    peak = max(np.abs(run.effort[:, J]).max() for run in record(hardware, motions))
    limit = 0.7 * peak
    (change, _), runs = changes(hardware, motions, "torque_saturation", J, limit)
    reading = runs[0].effort[:, J] + change[:, J]
    assert np.abs(reading).max() <= limit * (1.0 + 1e-9)
    low = np.abs(runs[0].effort[:, J]) < 0.6 * limit
    assert np.abs(change[low, J]).max() < 1e-3 * limit


def test_encoder_offset_shifts_gravity_on_several_joints(hardware):
    """The arm stands elsewhere than it says: the change is gravity's there less gravity's here."""
    arm, offset = hardware.arm, 0.03
    (forward, _), runs = changes(hardware, path_and_back(arm), "encoder_offset", J, offset)
    moved = runs[0].position - np.eye(arm.n)[J] * offset
    expected = arm.gravity(moved) - arm.gravity(runs[0].position)
    moving = np.abs(runs[0].velocity[:, J]) > 0.15
    for j in (1, 2):
        assert np.corrcoef(forward[moving, j], expected[moving, j])[0, 1] > 0.8
    shifted = record(with_effect(hardware, path_and_back(arm), "encoder_offset", J, offset), path_and_back(arm))
    assert np.abs(shifted[0].position - runs[0].position).max() < 2e-3


def test_contact_is_a_burst_with_a_jacobians_pattern(hardware):
    """Nothing before it; during it the joints up to the link, not those beyond."""
    motions = path_and_back(hardware.arm)
    changed = with_effect(hardware, motions, "external_contact", 3, 60.0)
    push = changed.contact
    (change_a, change_b), runs = changes(hardware, motions, "external_contact", 3, 60.0)
    change, other = (change_a, change_b) if changed.contact_run == 0 else (change_b, change_a)
    before = runs[0].time < push.start - 0.02
    during = (runs[0].time > push.start + 0.1) & (runs[0].time < push.end - 0.1)
    assert np.abs(change[before]).max() < 1e-6
    size = np.abs(change[during]).mean(axis=0)
    assert size[:3].max() > 3.0
    assert (size[4:] < 0.5).all()
    if changed.contact_run == 1:
        assert np.abs(other).max() < 1e-6


def test_payload_shows_on_all_joints_by_the_jacobian(hardware):
    """At rest the change is what the arm model says of such a body."""
    arm = hardware.arm
    motion = together("rest", [ramps(here, [(here + 0.4, 1.0)], 4.0, 0.02) for here in POSE]).held(0.5, 0.5)
    changed = with_effect(hardware, [motion], "payload", J, 1.0)
    com = changed.bodies.added[-1].com
    (before,), (after,) = record(hardware, [motion]), record(changed, [motion])
    change = (after.effort - before.effort)[60:100].mean(axis=0)
    expected = (arm.with_payload(Payload(1.0, com)).gravity(POSE[None]) - arm.gravity(POSE[None]))[0]
    # Sticking joints hide a part below their dry friction; the moving average of both sides would not.
    assert np.abs(change - expected).max() < 1.5
    assert change[J] == pytest.approx(expected[J], rel=0.3)
