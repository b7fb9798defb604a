"""Fast logs on a slower grid: what lies far above the common corner is not computed.
A log of 1 kHz that is filtered at 25 Hz says no more than its samples at 125 Hz, and every column
of every effect would cost eight times as much. States and torque go through one and the same
zero-phase filter, whose corner lies well above the common one, so that neither side is changed
below it; every eighth sample is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion, prepare_each
from ident.motion.settings import FOR_DIAGNOSIS, MotionSettings
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

# Poses of a session by which a typical inertia is judged.
SAMPLED_POSES = 200
# Of the encoder noise that is drawn: the same session gives the same diagnosis.
NOISE_SEED = 0


def decimation_factor(rate: float, cutoff: float, settings: MotionSettings = FOR_DIAGNOSIS) -> int:
    """One of how many samples is needed by a filter.

    Args:
        rate: Sampling rate [Hz].
        cutoff: The filter's corner [Hz].
        settings: Its largest share of the rate, and the least factor that is worth it.

    Returns:
        1 where too few samples could be spared.
    """
    factor = int(rate * settings.cutoff_share / cutoff + 1e-6)
    return factor if factor >= settings.least_factor else 1


def decimate(motion: Motion) -> Motion:
    """A run on a slower grid, as its common filter allows; itself where it is slow already."""
    rate = motion.lowpass.rate
    cutoff = motion.lowpass.cutoff
    settings = motion.settings
    factor = decimation_factor(rate, cutoff, settings)
    if factor == 1:
        return motion
    keep = Lowpass(rate, settings.guard * cutoff, factor)

    def slower(values: Float[Array, "T ..."]) -> Float[Array, "t ..."]:
        """A signal on the slower grid."""
        return freeze(keep(values))

    temperature = motion.temperature
    command = motion.position_command
    noise = motion.state_noise
    return replace(
        motion,
        q=slower(motion.q),
        dq=slower(motion.dq),
        ddq=slower(motion.ddq),
        tau=slower(motion.tau),
        time=freeze(motion.time[::factor]),
        lowpass=Lowpass.design(rate / factor, cutoff, settings),
        temperature=None if temperature is None else freeze(temperature[::factor]),
        position_command=None if command is None else slower(command),
        state_noise=None if noise is None else slower(noise),
    )


def prepare_slower(
    session: Session, cutoff: float | None = None, settings: MotionSettings = FOR_DIAGNOSIS
) -> Iterator[Motion]:
    """All runs of a session that are long enough, as motions for the diagnosis.

    Each is decimated before the next is smoothed, and takes a draw of its encoder noise along.

    Args:
        session: The recordings.
        cutoff: Corner of the common filter [Hz]; as the settings have it if None.
        settings: How a recording becomes a motion.
    """
    rng = np.random.default_rng(NOISE_SEED)
    return map(decimate, prepare_each(session, cutoff, settings, rng))


def moved_inertia(arm: ArmModel, motions: Sequence[Motion]) -> Float[Array, " n"]:
    """What each joint moves of the arm's links, on average over the poses of a session [kg m²]."""
    every = max(1, sum(len(motion.time) for motion in motions) // SAMPLED_POSES)
    return arm.mean_inertia(np.concatenate([motion.q[::every] for motion in motions]))
