"""References of all runs of a session: splines, Fourier sums, slow sweeps and chirps in turn."""

import numpy as np

from tests.bench.other_simulator.drawn import World
from tests.bench.other_simulator.simulator import STEP


def draw_reference(
    world: World, low: np.ndarray, high: np.ndarray, top: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """References `[R T n]`: splines, Fourier sums, slow sweeps and chirps in turn."""
    T = int(world.seconds / STEP)
    t = np.arange(T) * STEP
    centre, reach = 0.5 * (low + high), 0.5 * (high - low)
    out = np.zeros((world.runs, T, len(low)))
    for r in range(world.runs):
        for j in range(len(low)):
            middle = centre[j] + 0.4 * reach[j] * rng.uniform(-1, 1)
            if r % 4 == 0:
                x = _spline(t, middle, 0.5 * reach[j], top[j], rng)
            elif r % 4 == 1:
                x = sum(
                    0.35
                    * rng.uniform(0.3, 1)
                    / h
                    * np.sin(2 * np.pi * h * t / world.seconds * 1.0 + rng.uniform(0, 6.3))
                    for h in range(1, 8)
                )
                x = middle + reach[j] * x
            elif r % 4 == 2:
                x = middle + 0.5 * reach[j] * np.sin(
                    2 * np.pi * t / world.seconds * rng.uniform(0.7, 2.0) + rng.uniform(0, 6.3)
                )
            else:
                f0, f1 = 0.1, rng.uniform(0.8, 2.5)
                phase = 2 * np.pi * (f0 * t + 0.5 * (f1 - f0) * t**2 / world.seconds)
                amplitude = 0.5 * top[j] / (2 * np.pi * (f0 + (f1 - f0) * t / world.seconds))
                x = middle + amplitude * 0.4 * reach[j] / (amplitude + 0.4 * reach[j]) * np.sin(
                    phase + rng.uniform(0, 6.3)
                )
            x = _slowed(x, top[j])
            out[r, :, j] = middle + (x - middle) * _fit_in(x, low[j], high[j], middle)
    start = np.minimum(t / 1.5, 1.0)
    ease = start**3 * (10 - 15 * start + 6 * start**2)
    return out[:, :1] + (out - out[:, :1]) * ease[None, :, None]


def _spline(t: np.ndarray, middle: float, reach: float, top: float, rng: np.random.Generator) -> np.ndarray:
    """Fifth-order pieces between drawn stops, some with a rest."""
    x, here, done = np.zeros_like(t), middle, 0.0
    while done < t[-1]:
        goal = middle + reach * rng.uniform(-1, 1)
        span = max(1.9 * abs(goal - here) / (rng.uniform(0.3, 1.0) * top), 0.4)
        part = np.clip((t - done) / span, 0.0, 1.0)
        x = np.where(t >= done, here + (goal - here) * part**3 * (10 - 15 * part + 6 * part**2), x)
        here, done = goal, done + span + (rng.uniform(0.1, 0.6) if rng.random() < 0.4 else 0.0)
    return x


def _slowed(x: np.ndarray, top: float) -> np.ndarray:
    fastest = np.abs(np.gradient(x, STEP)).max()
    return x[0] + (x - x[0]) * min(1.0, top / max(fastest, 1e-9))


def _fit_in(x: np.ndarray, low: float, high: float, middle: float) -> float:
    over = max((x.max() - middle) / max(high - middle, 1e-9), (middle - x.min()) / max(middle - low, 1e-9), 1.0)
    return 1.0 / over
