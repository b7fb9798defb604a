"""What the recording sees of the plant: encoders that count, drives that report their current.

torque_measured(t) = sat(gain · τ(t - delay)) + offset + drift · t + noise, the noise coloured and
growing with load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.signal import lfilter

from ident.arrays import Array, Float, freeze

# Counts of a motor encoder's turn, and temperature resolution.
MOTOR_COUNTS = 65536
TEMPERATURE_STEP_K = 0.1
# Temperature of the lab, above which joints warm up [degC].
LAB_DEGC = 24.0


class ReadOnly:
    """Base of parts of an arm: their arrays are read-only, a change makes a copy."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, freeze(value))

    def replace(self, **changes: Any) -> Self:
        """A copy with other fields, given by their names."""
        return replace(self, **changes)  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class Sensing(ReadOnly):
    """Sensors of n joints; arrays of shape (n,)."""

    white: Float[Array, " n"]  # standard deviations of the torque's white and coloured noise [N m]
    coloured: Float[Array, " n"]
    corner_hz: float  # corner of the coloured part
    load_growth: float  # relative growth of the noise from no torque to rated torque
    rated: Float[Array, " n"]  # rated torque [N m]
    count: Float[Array, " n"]  # encoder resolution at the joint [rad]
    count_noise: float | Float[Array, " n"]  # standard deviation of the encoder's reading [counts]
    encoder_offset: Float[Array, " n"]  # what the encoder reads at zero [rad]
    gain: Float[Array, " n"]  # torque reading's gain, 1 for true
    # its offset [N m], its trend [N m/s], standard deviation of its wandering in a minute
    offset: Float[Array, " n"]
    drift: Float[Array, " n"]
    wander: Float[Array, " n"]
    delay: float  # age of the torque reading [s]
    limit: Float[Array, " n"]  # torque that the reading can't exceed [N m]
    # relative rise of the reading when all drives draw `sag_power` (outside the catalogue)
    sag: Float[Array, " n"]
    sag_power: float = 150.0  # [W]
    link_side: bool = False  # whether the logged position is that of the link, not of the motor

    @classmethod
    def typical(cls, rated: Float[Array, " n"], ratio: Float[Array, " n"]) -> Sensing:
        """Sensors of a healthy drive: noise of a quarter per cent of the rated torque, white and
        coloured alike.
        """
        return ideal_sensing(len(rated)).replace(
            white=1.5e-3 * rated,
            coloured=2.0e-3 * rated,
            load_growth=1.0,
            rated=np.array(rated),
            count=2.0 * np.pi / (MOTOR_COUNTS * ratio),
            count_noise=0.4,
        )

    @property
    def noise_floor(self) -> Float[Array, " n"]:
        """Standard deviation of the torque noise of an unloaded joint [N m]."""
        return np.hypot(self.white, self.coloured)

    def set(self, joint: int, **values: float) -> Sensing:
        """A copy with values of one joint changed."""
        chosen = np.arange(len(self.white)) == joint
        return self.replace(
            **{name: np.where(chosen, value, getattr(self, name)) for name, value in values.items()}
        )

    def silent(self) -> Sensing:
        """These sensors without chance, with which an effect's visible amplitude is measured."""
        zero = np.zeros(len(self.white))
        return self.replace(
            white=zero, coloured=zero, count_noise=0.0, wander=zero, count=np.full_like(zero, 1e-12)
        )


def ideal_sensing(n: int) -> Sensing:
    """Sensors that read the truth."""
    ones = np.ones(n)
    names = ("white", "coloured", "encoder_offset", "offset", "drift", "wander", "sag")
    values: dict[str, Any] = {
        "rated": ones,
        "gain": ones,
        "count": 1e-12 * ones,
        "limit": np.inf * ones,
    }
    values |= dict.fromkeys(names, np.zeros(n))
    return Sensing(corner_hz=15.0, load_growth=0.0, count_noise=0.0, delay=0.0, **values)


def sample(
    ticks: Float[Array, " K"], values: Float[Array, "K n"], times: Float[Array, " T"]
) -> Float[Array, "T n"]:
    """Values at other times, linear between ticks."""
    return np.column_stack([np.interp(times, ticks, column) for column in values.T])


def read_torque(
    sensing: Sensing,
    ticks: Float[Array, " K"],
    torque: Float[Array, "K n"],
    speed: Float[Array, "K n"],
    times: Float[Array, " T"],
    clock: float,
    rng: np.random.Generator,
) -> Float[Array, "T n"]:
    """The drives' torque readings at times in a run, from the motors' torque [N m] and speed
    [rad/s] at its ticks.

    `clock` is the session time at the start of the run [s].
    """
    true = sample(ticks, torque, times - sensing.delay)
    reading = true * sensing.gain
    if np.any(sensing.sag):
        power = (
            np.abs(sample(ticks, (torque * speed).sum(axis=1, keepdims=True), times))
            / sensing.sag_power
        )
        reading = reading * (1.0 + sensing.sag * power)
    # A soft knee: the reading bends within a few per cent of its limit.
    reading = reading / (1.0 + np.abs(reading / sensing.limit) ** 16) ** (1.0 / 16.0)
    reading = reading + sensing.offset + np.outer(times + clock, sensing.drift)
    noise = torque_noise(sensing, len(times), float(np.median(np.diff(times))), rng)
    return reading + noise * (1.0 + sensing.load_growth * np.abs(true) / sensing.rated)


def torque_noise(
    sensing: Sensing, samples: int, interval: float, rng: np.random.Generator
) -> Float[Array, "T n"]:
    """White and coloured (Ornstein-Uhlenbeck) noise of an unloaded joint, and the offset's
    wandering [N m].
    """
    n = len(sensing.white)
    white = rng.standard_normal((samples, n)) * sensing.white
    keep = np.exp(-2.0 * np.pi * sensing.corner_hz * interval)
    drive = rng.standard_normal((samples, n)) * np.sqrt(1.0 - keep**2)
    start = rng.standard_normal((1, n)) * keep
    coloured, _ = lfilter([1.0], [1.0, -keep], drive, axis=0, zi=start)
    steps = rng.standard_normal((samples, n)) * sensing.wander * np.sqrt(interval / 60.0)
    return white + coloured * sensing.coloured + np.cumsum(steps, axis=0)


def read_encoder(
    sensing: Sensing,
    ticks: Array,
    angle: Float[Array, "K n"],
    times: Array,
    rng: np.random.Generator,
) -> Float[Array, "T n"]:
    """Encoder readings at the joint [rad]: whole counts of the motor's angle."""
    counts = (sample(ticks, angle, times) + sensing.encoder_offset) / sensing.count
    return (
        np.round(counts + sensing.count_noise * rng.standard_normal(counts.shape)) * sensing.count
    )


def read_temperature(
    ticks: Array, rise: Float[Array, "K n"], times: Array, rng: np.random.Generator
) -> Float[Array, "T n"]:
    """Housing temperatures [degC] with a tenth of a degree of noise and resolution."""
    true = LAB_DEGC + sample(ticks, rise, times)
    return (
        np.round((true + 0.05 * rng.standard_normal(true.shape)) / TEMPERATURE_STEP_K)
        * TEMPERATURE_STEP_K
    )
