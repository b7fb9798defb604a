"""Laws of the sensors: what is read is what is, but for what they are known to do."""

import numpy as np
import pytest

from ident.simulation.sensing import Sensing, ideal_sensing, read_encoder, read_temperature, read_torque, torque_noise

RATED, RATIO = np.array([157.0, 43.0]), np.array([100.0, 80.0])
TICKS = np.arange(4001) * 1e-3
TIMES = np.arange(1000) * 4e-3
WAVE = np.column_stack([20.0 * np.sin(2.0 * TICKS), 5.0 * np.cos(3.0 * TICKS)])


def read(sensing, clock=0.0, seed=0):
    return read_torque(sensing, TICKS, WAVE, np.zeros_like(WAVE), TIMES, clock, np.random.default_rng(seed))


def true(times=TIMES):
    return np.column_stack([20.0 * np.sin(2.0 * times), 5.0 * np.cos(3.0 * times)])


def test_ideal_sensors_read_the_truth():
    np.testing.assert_allclose(read(ideal_sensing(2)), true(), atol=1e-4)
    angles = read_encoder(ideal_sensing(2), TICKS, WAVE, TIMES, np.random.default_rng(0))
    np.testing.assert_allclose(angles, true(), atol=1e-4)


def test_a_delay_is_a_shift_in_time():
    late = read(ideal_sensing(2).replace(delay=0.0137))
    np.testing.assert_allclose(late[20:], true(TIMES - 0.0137)[20:], atol=1e-3)


def test_gain_offset_drift_and_limit_act_on_their_own_joint():
    base = read(ideal_sensing(2))
    np.testing.assert_allclose(read(ideal_sensing(2).set(0, gain=1.1))[:, 0], 1.1 * base[:, 0])
    shifted = read(ideal_sensing(2).set(1, offset=0.5, drift=0.01), clock=100.0) - base
    np.testing.assert_allclose(shifted[:, 1], 0.5 + 0.01 * (TIMES + 100.0), atol=1e-9)
    np.testing.assert_allclose(shifted[:, 0], 0.0, atol=1e-12)
    assert read(ideal_sensing(2).set(0, limit=12.0))[:, 0].max() == pytest.approx(12.0, rel=1e-2)


def test_noise_has_the_stated_size_and_colour():
    sensing = Sensing.typical(RATED, RATIO)
    noise = torque_noise(sensing, 40000, 4e-3, np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), sensing.noise_floor, rtol=0.05)
    neighbours = (noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0)
    assert (neighbours > 0.2).all()


def test_noise_grows_with_the_load():
    sensing = Sensing.typical(RATED, RATIO)
    steady = np.ones_like(WAVE)
    spread = []
    for load in (0.0, 1.0):
        rng = np.random.default_rng(2)
        torque = read_torque(sensing, TICKS, load * steady * RATED, 0.0 * steady, TIMES, 0.0, rng)
        spread.append(torque.std(axis=0))
    np.testing.assert_allclose(spread[1] / spread[0], 2.0, rtol=1e-6)


def test_encoders_count():
    """Readings are whole counts of the motor's encoder, near the truth."""
    sensing = Sensing.typical(RATED, RATIO)
    reading = read_encoder(sensing, TICKS, WAVE, TIMES, np.random.default_rng(0))
    counts = reading / sensing.count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert np.abs(reading - true())[:, 0].max() < 1e-4


def test_silent_sensors_repeat_whatever_the_chance():
    silent = Sensing.typical(RATED, RATIO).silent()
    np.testing.assert_array_equal(read(silent, seed=1), read(silent, seed=2))


def test_temperatures_are_read_in_tenths():
    reading = read_temperature(TICKS, 0.0 * WAVE + 3.0, TIMES, 24.0, np.random.default_rng(0))
    np.testing.assert_allclose(reading * 10.0, np.round(reading * 10.0), atol=1e-9)
    assert reading.mean() == pytest.approx(27.0, abs=0.02)
