"""The compiled smoother against filterpy. Run: pytest <this file> -s.

filterpy is timed on 5,000 samples of one joint and scaled by samples and joints: it works joint by joint, sample by
sample. Processor time, best of several runs, so that other work on the machine does not enter.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ident.motion.smoothing import NoiseLevels, fit_noise_levels, smooth

SAMPLES, JOINTS, SLICE = 100_000, 6, 5_000


def _seconds(action: Callable[[], object], repeats: int = 5) -> float:
    best = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        action()
        best = min(best, time.process_time() - begin)
    return float(best)


def test_fast_path_is_two_hundred_times_faster() -> None:
    """10⁵ samples × 6 joints: at least 200 times, with regular sampling and with jitter."""
    rng = np.random.default_rng(0)
    t = 0.004 * np.arange(SAMPLES)
    z = np.sin(t[:, None] * np.arange(1, JOINTS + 1)) + 1e-5 * rng.standard_normal((SAMPLES, JOINTS))
    levels = fit_noise_levels([t], [z])
    one = NoiseLevels(levels.jerk[:1], levels.position[:1])
    jittered = t + rng.uniform(-0.001, 0.001, SAMPLES)
    smooth(t[:100], z[:100], levels)  # compiles
    slow = _seconds(lambda: smooth(t[:SLICE], z[:SLICE, :1], one, "filterpy")) * JOINTS * SAMPLES / SLICE
    fast, irregular = _seconds(lambda: smooth(t, z, levels)), _seconds(lambda: smooth(jittered, z, levels), 2)
    fitting = _seconds(lambda: fit_noise_levels([t], [z]), 2)
    print(f"\nfilterpy {slow:.1f} s (scaled from {SLICE} samples × 1 joint)")
    for name, seconds in (("regular", fast), ("irregular", irregular)):
        print(f"{name} {seconds * 1e3:.0f} ms: {slow / seconds:.0f} times")
    print(f"noise levels by maximum likelihood {fitting * 1e3:.0f} ms")
    assert min(slow / fast, slow / irregular) >= 200
