"""What encoder noise leaves in smoothed states, and what is done about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from ident.motion.encoder import draw_errors, find_resolution, keep_band, mean_spectrum
from ident.motion.motion import prepare_run, session_noise
from ident.motion.out_of_core import SpooledMotions, within_band
from ident.motion.smoothing import NoiseLevels, smooth
from ident.recordings.recording import Recording, Session


@pytest.mark.parametrize("length", [64, 65, 300])
def test_the_spectrum_is_the_reference_s(length: int) -> None:
    """Frequencies and densities are those of Welch's method, for even and odd stretches and one that is all."""
    values = np.random.default_rng(1).standard_normal((300, 2))
    frequencies, power = mean_spectrum(values, 125.0, length)
    reference = welch(values, 125.0, nperseg=length, axis=0, detrend=False)
    assert np.allclose(frequencies, reference[0])
    assert np.allclose(power, reference[1], rtol=1e-9)


def test_power_adds_up_to_the_variance() -> None:
    """White noise of variance one has a density of 2 / rate, whose sum over all frequencies is one."""
    frequencies, power = mean_spectrum(np.random.default_rng(2).standard_normal((20_000, 1)), 100.0, 200)
    assert np.trapezoid(power[:, 0], frequencies) == pytest.approx(1.0, rel=0.05)


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
    to the corner, the corner stays, in memory as on disk.
    """
    run, _ = slow_run(np.random.default_rng(3))
    run = replace(run, effort=np.random.default_rng(5).standard_normal(run.effort.shape))
    coarse = prepare_run(run, session_noise(Session("s", (run,))), cutoff=25.0)
    assert coarse.band is not None
    assert coarse.band[0] < 20.0
    for held in ([coarse, coarse], SpooledMotions([coarse, coarse])):
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
        assert motion.state_noise is not None
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


def test_errors_of_steps_are_drawn_as_steps_make_them() -> None:
    """Law: a coarse encoder errs by at most half a step, with a twelfth of its square; a fine one like white noise."""
    q = np.stack([np.linspace(0.0, 1.0, 5000), np.linspace(0.0, 1.0, 5000)], axis=1)
    levels = NoiseLevels(np.ones(2), np.array([1e-3**2 / 12, 1e-5**2]))
    error = draw_errors(q, levels, np.array([1e-3, 0.0]), np.random.default_rng(6))
    assert np.abs(error[:, 0]).max() <= 0.5e-3 + 1e-9
    assert np.std(error[:, 0]) == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
    assert np.std(error[:, 1]) == pytest.approx(1e-5, rel=0.05)
