"""Laws of worlds: drawn within their bounds, the same from the same seed, and what they say is what the log shows."""

from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.simulation.hardware import draw_hardware
from ident.simulation.record import Channels, record_one
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import Simulator
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
from ident.trajectories.reference import TICK_S, stepped, via_spline


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
