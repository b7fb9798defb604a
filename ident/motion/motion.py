"""From recordings to motions: smoothed states on an even grid, and one zero-phase filter for every
signal.

Measured torque and every modelled torque or regressor column must pass through the same filter and
decimation; otherwise the difference of two filters looks like delay or elasticity.
`Motion.filtered` is that one filter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze, in_a_line
from ident.errors import RecordingError
from ident.motion.encoder_noise import (
    draw_errors,
    find_resolution,
    find_signal_band,
    keep_band,
    mean_spectrum,
)
from ident.motion.filter import LEAST_CUTOFF_HZ, Lowpass
from ident.motion.settings import USUAL_MOTION, MotionSettings
from ident.motion.smoothing import NoiseLevels, Smoothed, fit_noise_levels, smooth
from ident.recordings.recording import Payload, Recording, Session

# Signals of a motion that have a column a joint.
BY_COLUMN = ("q", "dq", "ddq", "tau", "std", "temperature", "position_command", "state_noise")


@dataclass(frozen=True, eq=False)
class Motion:
    """One run, ready for models: T even samples of n joints."""

    __repr__ = in_a_line

    name: str  # name of the run
    joints: tuple[str, ...]  # joint names
    time: Float[Array, " T"]  # time [s]
    q: Float[Array, "T n"]  # smoothed states [rad, rad/s, rad/s²]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]  # measured torque, not filtered [N m]
    lowpass: Lowpass  # the filter that every torque and column goes through
    std: Float[Array, "3 n"]  # standard deviation of q, dq, ddq from the smoother, shape (3, n)
    payload: Payload | None = None  # known body at the flange
    temperature: Float[Array, "T n"] | None = None  # measured joint temperature [degC], or None
    position_command: Float[Array, "T n"] | None = None  # commanded position [rad], or None
    # whether it is the next piece of the recorded run that the motion before it is a piece of
    continues: bool = False
    # One more draw of the encoder noise that is left in q, dq and ddq, or None: what it does to
    # columns made of the states is what the noise that is in them does.
    state_noise: Float[Array, "T n 3"] | None = None
    # Frequency up to which each joint's states follow its motion [Hz], or None where they follow
    # all of it.
    band: Float[Array, " n"] | None = None
    # Power density of each joint's encoder noise [rad²/Hz], or None where nobody knows.
    density: Float[Array, " n"] | None = None
    log_interval: float = 0.0  # sampling interval of the recording [s]; 0 where nobody knows
    settings: MotionSettings = USUAL_MOTION  # how it was made, and what of it counts as settled

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return 1.0 / self.lowpass.rate

    def filtered(self, values: Float[Array, "T ..."]) -> Float[Array, "t ..."]:
        """A signal of this run, of T samples, low-passed and decimated to t samples."""
        return self.lowpass(values)

    @cached_property
    def tau_filtered(self) -> Float[Array, "t n"]:
        """Measured torque through the common filter [N m]."""
        return self.filtered(self.tau)

    @property
    def coarse(self) -> slice:
        """Slice that takes the samples that the filter keeps from all T samples."""
        return slice(None, None, self.lowpass.factor)

    @property
    def filtered_length(self) -> int:
        """Number of samples that the filter keeps."""
        return -(-len(self.time) // self.lowpass.factor)

    @property
    def moving(self) -> Bool[Array, "t n"]:
        """Where each joint surely moves, on the filtered grid.

        At rest dry friction holds any torque up to its Coulomb level: no function of the state
        tells it.
        """
        return np.asarray(np.abs(self.dq[self.coarse]) > self.rest_speed)

    @property
    def blurred(self) -> Int[Array, " n"]:
        """Filtered samples over which a stop or a turn of each joint is smeared; one that never
        moves has no band.
        """
        band: Float[Array, " n"] = np.full(self.n, np.inf)
        if self.band is not None:
            band = np.maximum(self.band, LEAST_CUTOFF_HZ)
        seconds = self.settings.reversal_periods / np.minimum(self.lowpass.cutoff, band)
        samples = np.round(seconds / (self.interval * self.lowpass.factor))
        return np.asarray(np.maximum(1, samples), dtype=int)

    @cached_property
    def settled(self) -> Bool[Array, "t n"]:
        """Where each joint moves and neither reverses, stops nor starts within the filter's reach.

        At rest dry friction holds any torque up to its level, and the filter smears that over its
        neighbourhood, as the smoother smears where it begins and ends. Until a joint has travelled
        some way its friction depends on what was before the run, and behind a turn or stop, until
        its gears' contacts slide, on where it stood.
        """
        reach = self.blurred
        heading = np.where(self.moving, np.sign(self.dq[self.coarse]), 0.0)
        settled = heading != 0.0
        for shift in range(1, min(int(reach.max()), len(heading) - 1) + 1):
            same = (heading[shift:] == heading[:-shift]) | (shift > reach)
            settled[shift:] &= same
            settled[:-shift] &= same
            # What was before a run and came after it, nobody knows.
            settled[:shift] &= shift > reach
            settled[-shift:] &= shift > reach
        q = self.q[self.coarse]
        travelled = np.maximum.accumulate(q) - np.minimum.accumulate(q)
        slid = np.abs(q - np.take_along_axis(q, last_turns(heading), axis=0))
        has_forgotten = travelled > self.settings.forgetting_travel
        is_sliding = slid > self.settings.presliding_travel
        return np.asarray(settled & (has_forgotten & is_sliding))

    @property
    def rest_speed(self) -> Float[Array, " n"]:
        """Speed below which a joint can't be distinguished from one at rest [rad/s]."""
        noise = self.settings.rest_deviations * self.std[1]
        return np.asarray(np.maximum(noise, self.settings.rest_speed))

    @property
    def noisier(self) -> Motion:
        """A copy with one more draw of the encoder noise in its states.

        The run itself where no noise was drawn.
        """
        if self.state_noise is None:
            return self
        q, dq, ddq = np.moveaxis(self.state_noise, -1, 0)
        return replace(
            self,
            q=self.q + q,
            dq=self.dq + dq,
            ddq=self.ddq + ddq,
        )

    def below(self, corner: float) -> Motion:
        """The run with a common filter of at most this corner [Hz]; itself where it has one
        already.
        """
        if corner >= self.lowpass.cutoff:
            return self
        return replace(self, lowpass=Lowpass.design(self.lowpass.rate, corner, self.settings))

    def select(self, joints: tuple[str, ...]) -> Motion:
        """A copy with some joints only, in the given order.

        Raises:
            ValueError: A joint is not there.
        """
        columns = [self.joints.index(name) for name in joints]
        cut: dict[str, Any] = {}
        for name in BY_COLUMN:
            values = getattr(self, name)
            if values is not None:
                cut[name] = freeze(values[:, columns])
        for name in ("band", "density"):
            values = getattr(self, name)
            if values is not None:
                cut[name] = freeze(values[columns])
        return replace(self, joints=tuple(joints), **cut)


def last_turns(heading: Float[Array, "t n"]) -> Int[Array, "t n"]:
    """For each sample the index of that at which each joint last turned, started or stopped.

    0 before any of these.

    Args:
        heading: Sign of each joint's motion: 1, 0 or -1.
    """
    turned = np.diff(heading, axis=0, prepend=heading[:1]) != 0.0
    rows = np.arange(len(heading))[:, None]
    return np.asarray(np.maximum.accumulate(turned * rows))


def torque_band(motion: Motion, inertia: Float[Array, " n"], corner: float) -> float:
    """Frequency up to which what a run's states lack of its motion is little in any torque [Hz].

    Beyond a corner the states lack motion that is less than `caution` times the encoder's noise: in
    the torque at most caution · M² (2π f)⁴ · density. Up to some frequency that is a small share
    (`lost_share`) of what the torque has there, at each joint.

    Args:
        motion: The run.
        inertia: What each joint moves, M [kg m²].
        corner: Up to where the states are whole [Hz].
    """
    if motion.density is None or len(motion.time) < 2:
        return corner
    rate = motion.lowpass.rate
    settings = motion.settings
    length = min(len(motion.time), max(16, round(settings.band_stretch_s * rate)))
    f, torque = mean_spectrum(np.asarray(motion.tau), rate, length)
    beyond = f > corner
    torque_of_position = inertia * (2.0 * np.pi * f[beyond, None]) ** 2
    lost = settings.caution * motion.density * torque_of_position**2
    allowed = settings.lost_share * np.cumsum(torque[beyond], axis=0)
    little = (np.cumsum(lost, axis=0) <= allowed).all(axis=1)
    last_little = np.argmin(np.append(little, False))
    return float(np.append(corner, f[beyond])[last_little])


def session_noise(session: Session, settings: MotionSettings = USUAL_MOTION) -> NoiseLevels:
    """Noise levels of a session's joints, by maximum likelihood over all its runs.

    Args:
        session: The recordings.
        settings: Between which corners of the smoother it is searched.
    """
    times = [run.time for run in session.runs]
    positions = [run.position for run in session.runs]
    return fit_noise_levels(times, positions, settings)


def prepare_run(
    run: Recording,
    levels: NoiseLevels,
    payload: Payload | None = None,
    cutoff: float | None = None,
    settings: MotionSettings = USUAL_MOTION,
    rng: np.random.Generator | None = None,
) -> Motion:
    """Smooths one run and lays it on an even grid.

    Args:
        run: The recording.
        levels: Noise of its joints.
        payload: The known body at the flange; none if None.
        cutoff: Corner of the common filter [Hz]; as `Lowpass.design` chooses it if None.
        settings: How a recording becomes a motion.
        rng: Of a draw of encoder noise that is taken along (`state_noise`); none if None.

    Raises:
        RecordingError: The corner is no frequency of a motion, or too high for the rate.
    """
    states = smooth(run.time, run.position, levels, settings.smoother)
    rate = 1.0 / run.sample_interval
    steps = int(np.floor(run.duration * rate + 1e-6))
    grid = run.time[0] + np.arange(steps + 1) / rate
    even = False
    if len(grid) == len(run):
        even = bool(np.max(np.abs(grid - run.time)) < 1e-3 / rate)
    new_times = None if even else grid
    lowpass = Lowpass.design(rate, cutoff, settings)
    highest = 2 * lowpass.cutoff
    even_states = _on_grid(run.time, states, new_times)
    band = find_signal_band(even_states[:, :, 2], rate, levels, settings)
    q, dq, ddq = np.moveaxis(keep_band(even_states, rate, band, highest), -1, 0)
    noise = None
    if rng is not None:
        errors = draw_errors(states.q, levels, find_resolution(run.position), rng)
        drawn = _on_grid(run.time, smooth(run.time, errors, levels), new_times)
        noise = keep_band(drawn, rate, band, highest)

    def on_grid(values: Float[Array, "T n"] | None) -> Float[Array, "T n"] | None:
        """A signal at the even times."""
        if values is None or even:
            return values
        return np.stack([np.interp(grid, run.time, column) for column in values.T], axis=1)

    effort = on_grid(run.effort)
    assert effort is not None
    return Motion(
        name=run.name,
        joints=run.joints,
        time=freeze(grid),
        q=freeze(q),
        dq=freeze(dq),
        ddq=freeze(ddq),
        tau=freeze(effort),
        lowpass=lowpass,
        std=states.std,
        payload=payload,
        temperature=on_grid(run.temperature),
        position_command=on_grid(run.position_command),
        state_noise=None if noise is None else freeze(noise),
        band=freeze(np.minimum(band, levels.bandwidth(1.0 / rate))),
        density=freeze(2.0 * levels.position / rate),
        log_interval=1.0 / rate,
        settings=settings,
    )


def prepare(
    session: Session, cutoff: float | None = None, settings: MotionSettings = USUAL_MOTION
) -> tuple[Motion, ...]:
    """All runs of a session that are long enough, as motions.

    Args:
        session: The recordings.
        cutoff: Corner of the common filter [Hz]; that of the settings, as far as the sampling rate
            allows it, if None.
        settings: How a recording becomes a motion.

    Raises:
        RecordingError: No run is long enough.
    """
    motions = tuple(prepare_each(session, cutoff, settings))
    if not motions:
        raise no_motion(session.path or session.name, settings)
    return motions


def prepare_each(
    session: Session,
    cutoff: float | None = None,
    settings: MotionSettings = USUAL_MOTION,
    rng: np.random.Generator | None = None,
) -> Iterator[Motion]:
    """The runs of a session that are long enough, as motions, one after the other.

    For whoever needn't have them all at once, as `prepare` has. None where no run is long enough.

    Args:
        session: The recordings.
        cutoff: Corner of the common filter [Hz]; as `Lowpass.design` chooses it if None.
        settings: How a recording becomes a motion.
        rng: Of draws of encoder noise that are taken along; none if None.
    """
    least = settings.least_duration_s
    samples = settings.least_samples
    long = [run for run in session.runs if run.duration >= least and len(run) >= samples]
    if not long:
        return
    levels = session_noise(session.replace(runs=long), settings)
    for run in long:
        yield prepare_run(run, levels, session.payload, cutoff, settings, rng)


def no_motion(where: str | Path, settings: MotionSettings = USUAL_MOTION) -> RecordingError:
    """The error (to be raised by the caller) of recordings whose runs are all too short.

    Args:
        where: The recordings.
        settings: How long a run has to be.
    """
    return RecordingError(
        str(where), f"no run lasts {settings.least_duration_s:g} s", "record longer motions"
    )


def _on_grid(time: Array, states: Smoothed, grid: Array | None) -> Float[Array, "T n 3"]:
    """Smoothed states side by side: at their own times, or at others by the quintic through both
    neighbours' states.
    """
    if grid is None:
        return np.stack([states.q, states.dq, states.ddq], axis=-1)
    left = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 2)
    h = (time[left + 1] - time[left])[:, None]
    # Place between both neighbours, from 0 to 1, by which the quintic and its derivatives go.
    u = ((grid - time[left])[:, None]) / h
    q0 = states.q[left]
    q1 = states.q[left + 1]
    v0 = states.dq[left] * h
    v1 = states.dq[left + 1] * h
    a0 = states.ddq[left] * h**2
    a1 = states.ddq[left + 1] * h**2
    rise = q1 - q0 - v0 - a0 / 2
    start = v1 - v0 - a0
    end = a1 - a0
    c3 = 10 * rise - 4 * start + end / 2
    c4 = -15 * rise + 7 * start - end
    c5 = 6 * rise - 3 * start + end / 2
    q = q0 + u * (v0 + u * (a0 / 2 + u * (c3 + u * (c4 + u * c5))))
    dq = (v0 + u * (a0 + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))) / h
    ddq = (a0 + u * (6 * c3 + u * (12 * c4 + u * 20 * c5))) / h**2
    return np.stack([q, dq, ddq], axis=-1)
