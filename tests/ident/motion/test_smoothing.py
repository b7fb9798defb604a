"""Laws of the Kalman smoother."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt, sosfreqz, welch

from ident.arrays import Array
from ident.motion.encoder_noise import draw_errors, find_resolution, keep_band, mean_spectrum
from ident.motion.filter import design_lowpass, filter_both_ways
from ident.motion.motion import prepare_run, session_noise
from ident.motion.smoothing import NoiseLevels, fit_noise_levels, smooth
from ident.motion.stretches import within_band
from ident.recordings.recording import Recording, Session


def _swings(
    rng: np.random.Generator, interval: float, samples: int, jitter: float, noise: float
) -> tuple[Array, Array]:
    """Times and noisy positions of two joints that swing by about a radian."""
    time = interval * (np.arange(samples) + jitter * rng.uniform(-1, 1, samples))
    q = np.stack([np.sin(3 * time) + 0.3 * np.sin(7 * time), 0.5 * np.cos(2 * time)], axis=1)
    return time, q + noise * rng.standard_normal(q.shape)


def _levels(corner: float, interval: float, noise: float = 3e-5) -> NoiseLevels:
    """Noise levels whose smoother has a given corner frequency [Hz]."""
    return NoiseLevels(np.array([(2 * np.pi * corner) ** 6 * noise**2 * interval]), np.array([noise**2]))


@pytest.mark.parametrize("jitter", [0.0, 0.3], ids=["regular", "irregular"])
@pytest.mark.parametrize(("interval", "noise"), [(0.001, 1e-5), (0.004, 1e-4), (0.01, 1e-6), (0.033, 1e-3)])
def test_fast_path_equals_filterpy(interval: float, noise: float, jitter: float) -> None:
    """q, dq, ddq to 1e-9 of their size and their deviations to 1e-9, at fitted noise levels."""
    time, z = _swings(np.random.default_rng(1), interval, 1500, jitter, noise)
    levels = fit_noise_levels([time], [z])
    fast, reference = smooth(time, z, levels), smooth(time, z, levels, method="filterpy")
    for name in ("q", "dq", "ddq"):
        expected = getattr(reference, name)
        assert np.allclose(getattr(fast, name), expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))
    assert np.allclose(fast.std, reference.std, rtol=1e-9)


def _white_jerk(rng: np.random.Generator, interval: float, samples: int, density: float) -> Array:
    """q, dq, ddq of one joint that is driven by white jerk from rest, shape (T, 3)."""
    step = np.array([[1, interval, interval**2 / 2], [0, 1, interval], [0, 0, 1]])
    divisors = [[20, 8, 6], [8, 3, 2], [6, 2, 1]]
    shape = np.array([[interval ** (5 - i - j) / divisors[i][j] for j in range(3)] for i in range(3)])
    root, x = np.linalg.cholesky(density * shape), np.zeros((samples, 3))
    for k in range(1, samples):
        x[k] = step @ x[k - 1] + root @ rng.standard_normal(3)
    return x


@pytest.mark.parametrize("runs", [1, 2])
def test_noise_levels_are_recovered(runs: int) -> None:
    """On positions driven by white jerk, 8000 samples: both levels within 15 % (one deviation is about 4 %)."""
    interval, samples, rng = 0.004, 8000 // runs, np.random.default_rng(2)
    true = NoiseLevels(np.array([100.0, 1e4]), np.array([1e-8, 1e-10]))
    time, positions = interval * np.arange(samples), []
    for _ in range(runs):
        q = np.stack([_white_jerk(rng, interval, samples, density)[:, 0] for density in true.jerk], axis=1)
        positions.append(q + np.sqrt(true.position) * rng.standard_normal(q.shape))
    found = fit_noise_levels([time] * runs, positions)
    assert np.allclose(found.jerk, true.jerk, rtol=0.15)
    assert np.allclose(found.position, true.position, rtol=0.15)


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 1.0])
def test_a_swing_is_damped_by_the_sixth_power(share: float) -> None:
    """A sine of f comes out times 1 / (1 + (f / f_c)⁶), in phase: 0.98 at half the corner, a half at the corner."""
    interval, corner = 0.004, 18.0
    time = np.arange(-3, 3, interval)
    q = np.sin(2 * np.pi * share * corner * time)
    found = smooth(time, q[:, None], _levels(corner, interval)).q[:, 0]
    middle = np.abs(time) < 1
    assert np.allclose(found[middle], q[middle] / (1 + share**6), atol=1e-5)


@pytest.mark.parametrize(
    ("order", "cutoff", "rate"), [(4, 10.0, 250.0), (4, 5.0, 30.0), (2, 0.5, 1000.0), (6, 40.0, 100.0)]
)
def test_the_design_is_that_of_scipy(order: int, cutoff: float, rate: float) -> None:
    """One at rest, 3 dB down at the corner, and the same response as the reference at every frequency."""
    ours = design_lowpass(order, cutoff, rate)
    frequencies = np.linspace(0.0, 0.499 * rate, 200)
    response = sosfreqz(ours, frequencies, fs=rate)[1]
    reference = sosfreqz(butter(order, cutoff, fs=rate, output="sos"), frequencies, fs=rate)[1]
    assert np.allclose(response, reference, rtol=0, atol=1e-9)
    assert np.abs(sosfreqz(ours, [cutoff], fs=rate)[1][0]) == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize(("order", "cutoff"), [(3, 10.0), (4, 50.0), (4, 0.0)])
def test_no_filter_where_there_can_be_none(order: int, cutoff: float) -> None:
    """Odd orders and corners beyond half the rate are refused."""
    with pytest.raises(ValueError, match="no low-pass"):
        design_lowpass(order, cutoff, 100.0)


@pytest.mark.parametrize("shape", [(400,), (400, 6), (400, 6, 3), (40, 100)])
@pytest.mark.parametrize("padding", [0, 1, 39])
@pytest.mark.parametrize("order", [2, 4, 5, 7])
def test_equals_scipy(shape: tuple[int, ...], padding: int, order: int) -> None:
    """Law: whatever the shape, the extension and the number of sections, the numbers are those of `sosfiltfilt`; the
    signals that are filtered stay what they were.
    """
    sections = butter(order, 10.0, fs=125.0, output="sos")
    values = np.random.default_rng(3).normal(size=shape).cumsum(axis=0)
    expected = sosfiltfilt(sections, values, axis=0, padlen=padding)
    before = values.copy()
    assert np.allclose(filter_both_ways(sections, values, padding), expected, rtol=1e-11, atol=1e-11)
    assert np.array_equal(values, before)


@pytest.mark.parametrize("length", [64, 65, 300])
def test_the_spectrum_is_the_reference_s(length: int) -> None:
    """Frequencies and densities are those of Welch's method, for even and odd stretches and one that is all."""
    values = np.random.default_rng(1).standard_normal((300, 2))
    frequencies, power = mean_spectrum(values, 125.0, length)
    reference = welch(values, 125.0, nperseg=length, axis=0, detrend=False)
    assert np.allclose(frequencies, reference[0])
    assert np.allclose(power, reference[1], rtol=1e-9)


RATE, NOISE = 200.0, 1e-4
# What a joint moves [kg m²].
HEAVY, LIGHT = np.array([100.0]), np.array([1e-3])


def slow_run(rng: np.random.Generator, seconds: float = 20.0) -> tuple[Recording, np.ndarray]:
    """A motion below 1.5 Hz with white encoder noise, and its true acceleration."""
    time = np.arange(int(seconds * RATE)) / RATE
    frequency, size = 2 * np.pi * np.array([0.3, 0.7, 1.3]), np.array([0.6, 0.2, 0.05])
    phase = rng.uniform(0, 2 * np.pi, 3)
    q = (size * np.sin(np.outer(time, frequency) + phase)).sum(axis=1)
    ddq = -(size * frequency**2 * np.sin(np.outer(time, frequency) + phase)).sum(axis=1)
    position = (q + NOISE * rng.standard_normal(len(time)))[:, None]
    return Recording("r", ("a",), time, position, np.zeros_like(position)), ddq[:, None]


def test_slow_motions_lose_the_noise_above_them() -> None:
    """Law: where a motion is slower than the smoother's corner, cutting brings its acceleration nearer to the truth: to
    less than two thirds of the error; the ends of the run are no worse than the smoother's.
    """
    run, truth = slow_run(np.random.default_rng(3))
    levels = session_noise(Session("s", (run,)))
    before = smooth(run.time, run.position, levels).ddq - truth
    after = prepare_run(run, levels, cutoff=25.0).ddq - truth
    middle, ends = slice(200, -200), np.r_[0:20, -20:0]
    assert np.sqrt(np.mean(after[middle] ** 2)) < 0.67 * np.sqrt(np.mean(before[middle] ** 2))
    assert np.abs(after[ends]).max() < 1.2 * np.abs(before[ends]).max()


def test_torque_is_looked_at_as_far_as_the_motion_is_known() -> None:
    """Law: a coarse encoder's common filter ends below its joint's band, where the cut leaves 99 % of its states; of a
    joint that moves so little that motion beyond is nothing in its torque, above; where the encoder tells the motion up
    to the corner, the corner stays.
    """
    run, _ = slow_run(np.random.default_rng(3))
    run = replace(run, effort=np.random.default_rng(5).standard_normal(run.effort.shape))
    coarse = prepare_run(run, session_noise(Session("s", (run,))), cutoff=25.0)
    assert coarse.band[0] < 20.0
    held = [coarse, coarse]
    corner = within_band(held, HEAVY)[1].lowpass.cutoff
    assert corner == pytest.approx(0.8 * coarse.band[0])
    assert corner < within_band(held, LIGHT)[1].lowpass.cutoff <= 25.0
    assert held[1].lowpass.cutoff == 25.0
    tone = np.sin(2 * np.pi * corner * coarse.time)[:, None]
    states = np.stack([0 * tone, 0 * tone, tone], axis=2)
    kept = keep_band(states, RATE, coarse.band, 50.0)[200:-200, 0, 2]
    assert np.abs(kept - tone[200:-200, 0]).max() < 0.02
    fine = replace(coarse, band=np.array([60.0]))
    assert within_band([fine], HEAVY)[0] is fine


def test_the_second_draw_is_as_large_as_the_noise_that_is_there() -> None:
    """Law: the drawn noise of the acceleration has the variance of what is left of the true noise, within a fifth."""
    rng = np.random.default_rng(4)
    left, drawn = [], []
    for _ in range(6):
        run, truth = slow_run(rng)
        motion = prepare_run(run, session_noise(Session("s", (run,))), cutoff=25.0, rng=rng)
        left.append((motion.ddq - truth)[200:-200])
        drawn.append(motion.state_noise[200:-200, :, 2])
        assert np.allclose(motion.noisier.ddq, motion.ddq + motion.state_noise[:, :, 2])
    assert np.std(drawn) == pytest.approx(np.std(left), rel=0.2)


def test_steps_of_an_encoder_are_found_where_there_are_any() -> None:
    rng = np.random.default_rng(5)
    smooth_path = np.cumsum(rng.standard_normal((2000, 2)), axis=0) * 1e-3
    step = 2 * np.pi / 2**12
    position = np.stack([step * np.round(smooth_path[:, 0] / step), smooth_path[:, 1]], axis=1)
    found = find_resolution(position)
    assert found[0] == pytest.approx(step, rel=1e-6)
    assert found[1] == 0.0


def test_a_joint_at_rest_stays_at_rest() -> None:
    """Constant readings give zero speed and acceleration, exactly, and do not disturb the joint that moves."""
    time, z = _swings(np.random.default_rng(5), 0.004, 1000, 0.0, 1e-5)
    resting = np.column_stack([z[:, 0], np.full(1000, 0.7)])
    levels = fit_noise_levels([time], [resting])
    found = smooth(time, resting, levels)
    assert levels.jerk[1] == 0.0
    assert np.all(found.dq[:, 1] == 0.0)
    assert np.all(found.ddq[:, 1] == 0.0)
    assert np.allclose(found.q[:, 1], 0.7, atol=1e-12)
    alone = smooth(time, z[:, :1], fit_noise_levels([time], [z[:, :1]]))
    assert np.allclose(found.dq[:, 0], alone.dq[:, 0])


def test_bias_of_a_smooth_reversal_is_below_the_noise() -> None:
    """0.5 rad swings at 0.5 Hz, 250 Hz, 20 µrad: at reversals the mean error over 40 noises is below 3 standard errors
    of the mean: the smoother adds no bias that a smooth motion would show.
    """
    time, omega = np.arange(0, 20, 0.004), np.pi
    q, dq, ddq = 0.5 * np.sin(omega * time), 0.5 * omega * np.cos(omega * time), -0.5 * omega**2 * np.sin(omega * time)
    z = q[:, None] + 2e-5 * np.random.default_rng(4).standard_normal((len(time), 40))
    levels = fit_noise_levels([time], [z[:, :1]])
    found = smooth(time, z, NoiseLevels(np.full(40, levels.jerk[0]), np.full(40, levels.position[0])))
    reversal = np.argmin(np.abs(time - 9.5))
    for states, truth, std in ((found.dq, dq, found.std[1, 0]), (found.ddq, ddq, found.std[2, 0])):
        assert abs((states[reversal] - truth[reversal]).mean()) < 3 * std / np.sqrt(40)


@pytest.mark.parametrize(("interval", "corner"), [(0.004, 18.0), (0.01, 12.5)])
def test_bias_where_a_joint_reverses(interval: float, corner: float) -> None:
    """A reversal at a corner of the acceleration (jerk J on one side, -J on the other): no bias of speed, and the
    peak of the acceleration is cut by 2 J / (3 ω_c); 100 rad/s³ at 18 Hz: 0.6 rad/s².
    """
    time, jerk, omega = np.arange(-3, 3, interval), 100.0, 2 * np.pi * corner
    middle = len(time) // 2
    time = time - time[middle]
    q = -jerk * np.abs(time) ** 3 / 6
    found = smooth(time, q[:, None], _levels(corner, interval))
    inner = np.abs(time) < 1
    bias = found.ddq[:, 0] + jerk * np.abs(time)
    assert abs(found.dq[middle, 0]) < 1e-6 * jerk / omega**2
    assert np.abs(bias[inner]).max() * omega / jerk == pytest.approx(2 / 3, abs=0.01)
    assert np.abs(bias[inner]).argmax() == np.abs(bias[inner]).shape[0] // 2


@pytest.mark.parametrize(("interval", "corner"), [(0.004, 18.0), (0.01, 12.5), (0.002, 30.0)])
def test_bias_where_a_joint_stops(interval: float, corner: float) -> None:
    """A joint that brakes at Δa to a stop: the speed is off by Δa / (3 ω_c) there, the position by < 0.14 Δa / ω_c².

    That is the bias of a motion whose acceleration jumps; 5 rad/s² at 18 Hz: 15 mrad/s, over some 1 / f_c = 55 ms;
    further away less than 0.015 Δa / ω_c.
    """
    time, jump, omega = np.arange(-3, 3, interval), 5.0, 2 * np.pi * corner
    before = time < 0
    q, dq = np.where(before, jump * time**2 / 2, 0.0), np.where(before, jump * time, 0.0)
    found = smooth(time, q[:, None], _levels(corner, interval))
    inner = np.abs(time) < 1
    speed_bias = np.abs(found.dq[:, 0] - dq) * omega / jump
    assert speed_bias[inner].max() == pytest.approx(1 / 3, abs=0.01)
    assert speed_bias[inner & (np.abs(time) > 1 / corner)].max() < 0.015
    assert np.abs(found.q[:, 0] - q)[inner].max() * omega**2 / jump < 0.14


def test_errors_are_as_large_as_told() -> None:
    """On white-jerk motion the true state lies within the stated deviations: mean square of error / std is 1 ± 0.2."""
    interval, samples, rng = 0.01, 4000, np.random.default_rng(3)
    levels = NoiseLevels(np.array([200.0]), np.array([4e-8]))
    x = _white_jerk(rng, interval, samples, 200.0)
    z = x[:, :1] + 2e-4 * rng.standard_normal((samples, 1))
    found = smooth(interval * np.arange(samples), z, levels)
    middle = slice(200, -200)
    for i, states in enumerate((found.q, found.dq, found.ddq)):
        assert np.mean((states[middle, 0] - x[middle, i]) ** 2) / found.std[i, 0] ** 2 == pytest.approx(1.0, abs=0.2)


def test_errors_of_steps_are_drawn_as_steps_make_them() -> None:
    """Law: a coarse encoder errs by at most half a step, with a twelfth of its square; a fine one like white noise."""
    q = np.stack([np.linspace(0.0, 1.0, 5000), np.linspace(0.0, 1.0, 5000)], axis=1)
    levels = NoiseLevels(np.ones(2), np.array([1e-3**2 / 12, 1e-5**2]))
    error = draw_errors(q, levels, np.array([1e-3, 0.0]), np.random.default_rng(6))
    assert np.abs(error[:, 0]).max() <= 0.5e-3 + 1e-9
    assert np.std(error[:, 0]) == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
    assert np.std(error[:, 1]) == pytest.approx(1e-5, rel=0.05)
