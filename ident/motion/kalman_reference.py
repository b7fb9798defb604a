"""The smoother of a joint by filterpy's general filter: what the compiled one is held against."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float


def smooth_by_filterpy(
    z: Float[Array, " T"],
    dt: Float[Array, " T-1"],
    noise: Float[Array, " 5"],
    states: Float[Array, "T 3"],
    middle: Float[Array, " 3"],
) -> None:
    """Smooths one joint of one run by filterpy.

    The results are those of `filter_joint` and `smooth_joint` of `ident.motion.kalman`.

    Args:
        z: Measured positions [rad].
        dt: Sampling intervals [s].
        noise: As `filter_joint` takes it.
        states: Gets the smoothed states: position, velocity, acceleration [rad, rad/s, rad/s²].
        middle: Gets their variances in the middle of the run.
    """
    from filterpy.kalman import KalmanFilter  # slow to load, and only the reference needs it

    jerk = noise[0]
    variance = noise[1]
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.R = np.array([[variance]])
    first = np.diag([variance, *noise[2:4] ** 2])
    start = np.array([[z[0]], [0.0], [0.0]])
    kalman.x = start.copy()
    kalman.P = first.copy()
    steps = [_step(h) for h in dt]
    noises = [jerk * _growth(h) for h in dt]
    means, covariances, _, _ = kalman.batch_filter(z[1:], Fs=steps, Qs=noises)
    means = np.concatenate([[start], means])
    covariances = np.concatenate([[first], covariances])
    # Entry k of filterpy's lists belongs to the step that arrives at sample k.
    smoothed, spread, _, _ = kalman.rts_smoother(
        means, covariances, [steps[0], *steps], [noises[0], *noises]
    )
    states[:] = smoothed[:, :, 0]
    middle[:] = np.diag(spread[len(z) // 2])


def _step(h: float) -> Float[Array, "3 3"]:
    """F: what the state becomes in h seconds."""
    return np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])


def _growth(h: float) -> Float[Array, "3 3"]:
    """Covariance that white jerk of density one adds in h seconds."""
    return np.array(
        [
            [h**5 / 20, h**4 / 8, h**3 / 6],
            [h**4 / 8, h**3 / 3, h**2 / 2],
            [h**3 / 6, h**2 / 2, h],
        ]
    )
