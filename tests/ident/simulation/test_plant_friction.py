"""Laws of the plant's friction: it sticks, it slides at its level, and it never gives energy."""

import numpy as np
import pytest

from ident.simulation.laws import (
    bristle,
    change_law,
    cool_down,
    heat_law,
    make_law,
    plain_friction,
    remembered_torque,
    sliding_level,
    warm_up,
)
from ident.simulation.loop import fresh_state
from ident.simulation.sensing import Sensing, read_encoder, torque_noise


def joint(**values):
    law = plain_friction(np.array([10.0]), np.array([5.0]), np.array([1.0]))
    return change_law(law, **values)[0]


def level(record, v, angle=0.0, load=0.0, acceleration=0.0, warm=0.0):
    return sliding_level(record, v, angle, load, acceleration, warm)


def test_levels_move_with_their_own_cause_only():
    """Stribeck with low speed, load with torque, seat with angle, heat with temperature, skidding with acceleration."""
    assert level(joint(stribeck=4.0), 1e-4) == pytest.approx(14.0, rel=1e-2)
    assert level(joint(stribeck=4.0), 2.0) == pytest.approx(10.0, rel=1e-6)
    assert level(joint(load=0.1), 0.5, load=50.0) > level(joint(load=0.1), 0.5, load=-50.0) > 13.0
    assert level(joint(load=0.1), 0.5) == pytest.approx(10.0, abs=0.1)
    angles = [level(joint(seat=0.2), 0.5, angle=a) for a in np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)]
    assert np.mean(angles) == pytest.approx(10.0, rel=1e-3)
    assert np.ptp(angles) == pytest.approx(4.0, rel=0.1)
    assert level(joint(thermal_coulomb=0.01), 0.5, warm=20.0) == pytest.approx(10.0 * np.exp(-0.2))
    assert level(joint(skid=3.0), 0.5, acceleration=20.0) == pytest.approx(13.0, rel=1e-3)
    assert level(joint(coulomb_skew=2.0), 0.5) - level(joint(coulomb_skew=2.0), -0.5) == pytest.approx(2.0)


def test_heat_settles_where_loss_and_cooling_balance():
    """Under the rated loss the lubricant ends at the stated rise, and cools down in a pause."""
    network = heat_law(np.array([6.0]), rise=25.0, time_constant=20.0)
    state, record = fresh_state(1), network[0]
    for _ in range(200000):
        warm_up(record, state[0], 6.0, 0.02)
    assert state["lubricant_rise"][0] == pytest.approx(25.0, rel=0.02)
    rise = np.column_stack([state["lubricant_rise"], state["housing_rise"]])
    assert cool_down(network, rise, 0.0) == pytest.approx(rise)
    assert cool_down(network, rise, 1e5) == pytest.approx(0.0, abs=1e-3)
    twice = cool_down(network, cool_down(network, rise, 30.0), 30.0)
    assert twice == pytest.approx(cool_down(network, rise, 60.0))


TICK = 1e-3


def follow(angle, transmitted=0.0, **law):  # type: ignore[no-untyped-def]
    """Torque of a law along a path of one joint."""
    joint = make_law("outside", 1, **law)[0]
    state = fresh_state(1)
    state["transmitted"] = transmitted
    speed = np.gradient(angle, TICK)
    return np.array([remembered_torque(joint, state[0], q, v, TICK) for q, v in zip(angle, speed, strict=True)])


def at_speed(speed, seconds=2.0):  # type: ignore[no-untyped-def]
    return speed * np.arange(round(seconds / TICK)) * TICK


def test_a_seal_is_viscous_when_slow_and_a_spring_when_quick() -> None:
    slow = follow(at_speed(0.2), seal=10.0, seal_relaxation=0.1)
    assert slow[-1] == pytest.approx(-10.0 * 0.2 * 0.1, rel=1e-2)
    t = np.arange(2000) * TICK
    quick = 0.01 * np.sin(2 * np.pi * 20.0 * t)
    torque = follow(quick, seal=10.0, seal_relaxation=1.0)
    assert np.corrcoef(torque[1000:], quick[1000:])[0, 1] < -0.99


def test_rest_strengthens_a_contact_and_slip_renews_it() -> None:
    moving = at_speed(0.3)
    rested = np.concatenate([np.zeros(3000), moving])
    fresh, aged = follow(moving, ageing=1.0, ageing_slip=0.01), follow(rested, ageing=1.0, ageing_slip=0.01)[3000:]
    assert -aged[:20].mean() > 2.0 * -fresh[:20].mean()
    assert aged[-1] == pytest.approx(fresh[-1], rel=1e-3)
    assert follow(-moving, ageing=1.0)[-1] > 0.0


def test_tooth_friction_turns_round_within_a_tooth_and_needs_load() -> None:
    angle = at_speed(0.5)
    torque = follow(angle, transmitted=40.0, tooth=0.05, tooth_order=20.0)
    assert torque.max() == pytest.approx(2.0, rel=0.02)
    assert torque.min() == pytest.approx(-2.0, rel=0.02)
    assert abs(torque[: round(2 * np.pi / 20 / 0.5 / TICK)].mean()) < 0.05
    assert not follow(angle, tooth=0.05).any()


def test_a_kinematic_error_shakes_hardest_at_the_resonance() -> None:
    law = {"wobble": 1e-3, "wobble_order": 100.0, "wobble_inertia": 1.0, "wobble_resonance": 60.0}
    below, at, above = (np.abs(follow(at_speed(v), **law)[200:]).max() for v in (0.2, 0.6, 1.8))
    assert at > 5.0 * below
    assert at > 1.2 * above


RATED, RATIO = np.array([157.0, 43.0]), np.array([100.0, 80.0])
TICKS = np.arange(4001) * 1e-3
TIMES = np.arange(1000) * 4e-3
WAVE = np.column_stack([20.0 * np.sin(2.0 * TICKS), 5.0 * np.cos(3.0 * TICKS)])


def true(times=TIMES):
    return np.column_stack([20.0 * np.sin(2.0 * times), 5.0 * np.cos(3.0 * times)])


def test_noise_has_the_stated_size_and_colour():
    sensing = Sensing.typical(RATED, RATIO)
    noise = torque_noise(sensing, 40000, 4e-3, np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), sensing.noise_floor, rtol=0.05)
    neighbours = (noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0)
    assert (neighbours > 0.2).all()


def test_encoders_count():
    """Readings are whole counts of the motor's encoder, near the truth."""
    sensing = Sensing.typical(RATED, RATIO)
    reading = read_encoder(sensing, TICKS, WAVE, TIMES, np.random.default_rng(0))
    counts = reading / sensing.count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert np.abs(reading - true())[:, 0].max() < 1e-4


DT = 5e-4


def test_a_cycle_loses_energy():
    """Over any closed path friction takes energy, also below the breakaway."""
    for amplitude in (1e-5, 1e-4, 1e-2):
        phase = np.linspace(0.0, 8.0 * np.pi, 8000)
        speed, z, work = amplitude * np.cos(phase) * np.pi, 0.0, 0.0
        for v in speed:
            z, torque = bristle(z, v, 10.0, 5e4, 100.0, DT)
            work += torque * v * DT
        assert work > 0.0


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_rest_holds_any_torque_below_the_level(share):
    """A body pushed with less than the level creeps by no more than the presliding; with more it runs away."""
    travel = []
    for load in (share * 10.0, 1.3 * 10.0):
        z = v = x = 0.0
        for k in range(6000):
            z, torque = bristle(z, v, 10.0, 5e4, 250.0, DT)
            v += DT * (load * min(k / 3000, 1.0) - torque)
            x += DT * v
        travel.append(x)
    assert travel[0] < 2e-3
    assert travel[1] > 1.0
