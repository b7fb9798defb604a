"""Laws of worlds and of visible amplitudes: within bounds, the same from the same seed, and what is said is there."""

from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.simulation import visibility
from ident.simulation.causes import Circumstances, find_cause
from ident.simulation.hardware import draw_hardware
from ident.simulation.record import Channels, record_one
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import Simulator, choose_step
from ident.simulation.visibility import TOLERANCE, VisibilityMeter, moves_alike
from ident.simulation.visible_rows import compare, gather
from ident.simulation.world import (
    FULL,
    PRESETS,
    World,
    channels_of,
    draw_world_arm,
    find_world,
    find_worlds,
    friction_path,
    settle,
)
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import TICK_S, via_spline
from ident.trajectories.stepped import stepped


@pytest.fixture(scope="module")
def sound() -> World:
    return PRESETS["industrial"].with_values("sound", {"robot": "tm5-900"}, "here").draw(np.random.default_rng(1))


@pytest.fixture(scope="module")
def trace(hardware):
    points = np.array([[0.0] * 6, [0.4, 0.3, -0.5, 0.2, 0.6, 0.3], [0.0, 0.5, 0.2, -0.3, 0.1, 0.9]])
    motion = via_spline("spline", points, 2.0).held(0.3, 0.3)
    return Simulator(hardware, np.random.default_rng(2)).run([motion], [0.0], lambda: None)[0]


@pytest.mark.parametrize("name", PRESETS)
def test_worlds_lie_within_the_full_table_and_their_arms_load(name: str) -> None:
    for seed in range(20):
        world = PRESETS[name].draw(np.random.default_rng(seed))
        for key, options in FULL.items():
            value = getattr(world, key)
            assert value in options if isinstance(options[0], str | bool) else options[0] <= value <= options[1]
        assert World(**world.to_dict()) == world
        assert ArmModel.load(world.robot).n >= 4


def test_a_file_fixes_what_it_names_and_leaves_the_rest_to_its_preset(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('preset = "fine-encoder"\nrate_hz = 125\ntorque_noise = [0.01, 0.02]\nvelocity = "none"\n')
    world = find_world(path).draw(np.random.default_rng(0))
    assert (world.name, world.rate_hz, world.velocity) == ("mine", 125, "none")
    assert 0.01 <= world.torque_noise <= 0.02
    assert world.encoder_noise_rad <= 5e-6


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rate_hz = 5000", "between 30 and 1000"),
        ("colour = 3", "choose from"),
        ('velocity = "guessed"', "none, differenced"),
        ("jitter = [0.2, 0.1]", "in order"),
        ('preset = "mars"', "choose from"),
        ("preset = [100, 500]", "choose from"),
        ("rate_hz = ", "TOML"),
    ],
)
def test_a_wrong_file_is_told_with_its_remedy(tmp_path, text: str, expected: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=expected):
        find_world(path)


def test_unknown_worlds_are_told(tmp_path) -> None:
    with pytest.raises(InputError, match="unknown world"):
        find_world("mars")
    with pytest.raises(InputError, match="names no world"):
        find_worlds("scara,-scara")


def test_what_the_user_asks_for_beside_a_world_holds() -> None:
    world = settle(PRESETS["any"], 3, robot="ur5", runs=2, duration=6.0, rate=80.0, velocity=False)
    assert (world.robot, world.runs, world.run_duration_s, world.rate_hz) == ("ur5", 2, 6.0, 80.0)
    assert world.velocity == "none"


def test_the_arm_of_a_world_has_its_sensors_and_its_friction(arm, sound: World) -> None:
    usual = draw_hardware(arm, np.random.default_rng(4), sound.link_error)
    own = draw_world_arm(arm, replace(sound, friction_scale=2.0, rotor_scale=0.5), np.random.default_rng(4))
    np.testing.assert_allclose(own.friction.coulomb, 2.0 * usual.friction.coulomb)
    np.testing.assert_allclose(own.drive.rotor_inertia, 0.5 * usual.drive.rotor_inertia)
    np.testing.assert_allclose(own.sensing.noise_floor, sound.torque_noise * usual.sensing.rated)
    np.testing.assert_allclose(own.sensing.count_noise * own.sensing.count, sound.encoder_noise_rad)


def test_jitter_and_lost_samples_are_what_was_asked_for(hardware, trace) -> None:
    channels = Channels(rate=500.0, jitter=0.2, lost=0.02)
    run = record_one(hardware, trace, "run", channels, np.random.default_rng(5))
    grid = np.round(run.time * 500.0)
    away = np.abs(run.time * 500.0 - grid)
    assert 0.15 < away.max() <= 0.2 + 1e-3
    steps = np.diff(grid)
    assert (steps >= 1).all()
    assert 0.005 < (steps - 1).sum() / len(steps) < 0.05


def test_velocity_channels_are_late_differenced_or_true(hardware, trace) -> None:
    def velocity(**channel):
        run = record_one(hardware, trace, "run", Channels(rate=1000.0, **channel), np.random.default_rng(6))
        return run.velocity, run

    true, _ = velocity(velocity_kind="true")
    late, _ = velocity(velocity_kind="filtered", velocity_delay=0.02)
    difference, run = velocity(velocity_kind="differenced")
    np.testing.assert_allclose(true, trace.log.speed[: len(true)], atol=1e-5)
    np.testing.assert_allclose(difference[1:], np.diff(run.position, axis=0) * 1000.0, atol=1e-3)
    errors = [np.abs(late[k:, 1] - true[: len(true) - k, 1]).mean() for k in range(40)]
    assert 15 <= int(np.argmin(errors)) <= 25


def test_friction_changes_from_run_to_run_and_drifts_as_asked(arm, sound: World) -> None:
    rest = [via_spline("", np.zeros((2, 6)), 1.0)] * 40
    both = (
        replace(sound, friction_spread=0.05, friction_drift=0.0),
        replace(sound, friction_spread=0.0, friction_drift=0.2),
    )
    spread, drift = (
        np.log([friction_path(world, 6, rest, [1.0] * 40, np.random.default_rng(seed)) for seed in range(40)])
        for world in both
    )
    np.testing.assert_allclose(spread.std(), 0.05, rtol=0.1)
    np.testing.assert_allclose(drift[:, -1].std(), 0.2, rtol=0.25)
    assert drift[:, 0].std() < 0.3 * drift[:, -1].std()


@pytest.mark.parametrize(("shape", "order"), [("acceleration", 2), ("jerk", 3)])
def test_references_step_where_they_say(shape: str, order: int) -> None:
    smooth = via_spline("spline", np.array([[0.0, 0.0], [0.8, -0.4]]), 3.0).held(0.25, 0.25)
    rough = stepped(smooth, shape)
    assert np.abs(rough.q - smooth.q).max() < 5e-3
    np.testing.assert_allclose(rough.dq[[0, -1]], 0.0, atol=1e-9)
    # Between the steps the next derivative is nothing: most of its changes stand at few ticks.
    change = np.abs(np.diff(rough.q, order + 1, axis=0)[:, 0]) / TICK_S**order
    assert np.sort(change)[::-1][: len(change) // 8].sum() > 0.9 * change.sum()
    assert stepped(smooth, "smooth") is smooth


@pytest.mark.parametrize("name", ["scara", "hobby"])
def test_a_world_simulates_again_the_same_and_tells_itself(name: str) -> None:
    world = replace(PRESETS[name].draw(np.random.default_rng(9)), runs=2, duration_s=6.0)
    options = SimulationOptions(seed=3, effects=("torque_offset:2",)).in_world(world)
    one, again = simulate(options), simulate(options)
    assert one.answer == again.answer
    assert World(**one.answer.world) == world
    assert set(one.answer.losses) == set(one.session.runs[0].joints)
    for run, same in zip(one.session.runs, again.session.runs, strict=True):
        np.testing.assert_array_equal(run.position, same.position)
        np.testing.assert_array_equal(run.effort, same.effort)
        assert (run.velocity is None) == (world.velocity == "none")
        assert channels_of(world).rate == pytest.approx(1.0 / np.median(np.diff(run.time)), rel=0.1)


SENSORS = ("torque_gain_error", "torque_offset", "torque_delay", "torque_saturation", "supply_sag")


@pytest.fixture(scope="module")
def motions(arm):
    return plan_motions(arm, ["fourier", "chirp"], 2, 3.0, np.random.default_rng(1))


@pytest.fixture(scope="module")
def meters(hardware, motions):
    """A coarse and a fine meter of the same session."""
    return tuple(VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse) for coarse in (True, False))


def scene_at(hardware, motions, joint):
    return Circumstances(hardware, joint, motions, np.random.default_rng(2))


@pytest.mark.parametrize(
    ("effect", "joint", "wanted"),
    [
        ("load_dependent_friction", 1, 0.3),
        ("presliding_hysteresis", 4, 1.0),
        ("joint_elasticity", 2, 3.0),
        ("payload", 5, 3.0),
        ("external_contact", 2, 1.0),
        ("torque_delay", 5, 1.0),
        ("torque_saturation", 1, 1.0),
    ],
)
def test_a_coarse_search_keeps_its_promise(hardware, motions, meters, effect, joint, wanted):
    """A finer simulation of all runs shows what the coarse one showed; so it does without the effect."""
    meter = meters[0]
    cause, scene = find_cause(effect), scene_at(hardware, motions, joint)
    size = meter.find_size(cause, scene, wanted, seed=2)
    assert meter.share(cause, scene, size, seed=2) == pytest.approx(wanted, rel=1.05 * TOLERANCE)
    changed, _ = cause.apply(scene_at(hardware, motions, joint), size)
    way = visibility.Way(all_runs=True, coarse_step=0.5 * choose_step(changed, coarse=True))
    finer = VisibilityMeter(hardware, motions, [0.0, 1.0], 0)
    after, before = (gather(one, finer._traces(one, way), cause.view) for one in (changed, hardware))
    push = changed.contact
    window = (after.run == changed.contact_run) & (after.time > push.start) & (after.time < push.end)
    share = compare(after, before, window if push.body else None).rms / hardware.sensing.noise_floor
    assert (share.max() if cause.whole_arm else share[joint]) == pytest.approx(wanted, rel=0.08)


@pytest.mark.parametrize("effect", SENSORS)
def test_what_only_the_reading_shows_needs_no_new_simulation(hardware, motions, meters, effect):
    """Read anew from the arm without the effect, the torque is the one that a new simulation would give."""
    fine = meters[1]
    cause, scene = find_cause(effect), scene_at(hardware, motions, 2)
    size = cause.typical(scene)
    changed, _ = cause.apply(Circumstances(hardware, 2, motions, np.random.default_rng(2)), size)
    assert moves_alike(changed, hardware)
    seen = fine.measure(cause, scene, size, 2)
    way = visibility.Way(cause.needs_all, None)
    again = [gather(one, fine._traces(one, way), cause.view) for one in (changed, hardware)]
    np.testing.assert_array_equal(seen, compare(*again).rms)


def test_a_joint_that_is_stuck_shows_without_limit(hardware, motions, meters):
    """Friction that holds a joint still leaves few samples that show it: no size for a case."""
    cause, scene = find_cause("stribeck_friction"), scene_at(hardware, motions, 4)
    most = cause.bounds(scene)[1]
    held = [meters[0].share(cause, scene, size, seed=2) for size in (0.1 * cause.typical(scene), most)]
    assert held[0] < np.inf == held[1]


def test_what_encoder_noise_hides_is_not_shown_by_the_fit_of_what_it_leaves(hardware, motions):
    """Torque and columns share a band, so that a resonance beyond it is no slow torque that the model can't explain."""
    cause, scene = find_cause("joint_elasticity"), scene_at(hardware, motions, 2)
    whole, slow = (
        VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse=True, band=band).measure(cause, scene, 2e3, 2)
        for band in (None, np.full(hardware.n, 2.0))
    )
    assert (slow < 0.15 * whole)[1:3].all()


def test_a_size_is_measured_once(hardware, motions, monkeypatch):
    meter = VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse=True)
    cause, scene = find_cause("spring_torque"), scene_at(hardware, motions, 2)
    first = meter.measure(cause, scene, 3.0, 2)
    monkeypatch.setattr(meter, "_traces", lambda *_: pytest.fail("simulated again"))
    assert meter.measure(cause, scene, 3.0, 2) is first


def test_the_answer_tells_the_amplitude_that_was_reached():
    request = EffectRequest("spring_torque", "joint_3", amplitude=1.0)
    options = SimulationOptions(motions=("spline",), runs=2, duration=2.0, rate=50.0, effects=(request,), coarse=True)
    made = simulate(options).answer
    assert made.effects[0].visible_Nm["joint_3"] / made.noise_floor_Nm["joint_3"] == pytest.approx(1.0, rel=TOLERANCE)


def test_play_is_compared_with_the_same_gear_without_play(hardware, motions, meters):
    """That teeth twist is no play: a gear without it shows nothing, and more play shows more."""
    cause, scene = find_cause("backlash"), scene_at(hardware, motions, 2)
    none, some, more = (meters[0].measure(cause, scene, gap, 3)[2] for gap in (0.0, 0.004, 0.016))
    assert none < 1e-9
    assert 1e-6 < some < more


def test_friction_rises_from_a_run_on_at_its_joint_alone(hardware, motions):
    """Law: runs before it have the path that they had, those from it on more, dry and viscous alike."""
    changed, true = find_cause("friction_step").apply(scene_at(hardware, motions, 3), 0.8)
    path = np.array(changed.friction_path)
    first = true["from_run"]
    assert 0 < first < len(motions)
    assert np.all(path[:first] == 1.0)
    assert path[first:, :, 3] == pytest.approx(1.8)
    assert np.all(np.delete(path, 3, axis=2) == 1.0)
