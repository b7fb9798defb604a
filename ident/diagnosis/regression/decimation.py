"""Fast logs on a slower grid: what lies far above the common corner need not be computed column by column.

A log of 1 kHz that is filtered at 25 Hz says no more than its samples at 125 Hz, and every column of every effect would
cost eight times as much. States and torque go through one and the same zero-phase filter, whose corner lies well above
the common one, so that neither side is changed below it; every eighth sample is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.motion.motion import CRITICAL_OVERSAMPLING, LARGEST_CUTOFF_SHARE, Lowpass, Motion, prepare_each
from ident.recordings.recording import Session

# Corner of the filter before decimation, in corners of the common filter: between them lies what columns may fold down.
GUARD = 2.0
# Logs are left alone unless so many samples make way for one.
LEAST_FACTOR = 3
# Of the encoder noise that is drawn: the same session gives the same diagnosis.
NOISE_SEED = 0


def decimation_factor(rate: float, cutoff: float) -> int:
    """One of how many samples is needed by a filter of some corner; 1 where too few could be spared."""
    factor = int(rate * LARGEST_CUTOFF_SHARE / cutoff + 1e-6)
    return factor if factor >= LEAST_FACTOR else 1


def decimate(motion: Motion, oversampling: float = CRITICAL_OVERSAMPLING) -> Motion:
    """The same run on a slower grid; a run that is slow already is handed back.

    Args:
        motion: The run.
        oversampling: Samples that the common filter keeps a period of its corner.
    """
    rate, cutoff = motion.lowpass.rate, motion.lowpass.cutoff
    factor = decimation_factor(rate, cutoff)
    if factor == 1:
        return motion
    keep = Lowpass(rate, GUARD * cutoff, factor)

    def slower(values: Float[Array, "T ..."] | None) -> Float[Array, "t ..."] | None:
        return None if values is None else freeze(keep(values))

    states: dict[str, Any] = {name: freeze(keep(getattr(motion, name))) for name in ("q", "dq", "ddq", "tau")}
    return replace(
        motion,
        **states,
        time=freeze(motion.time[::factor]),
        lowpass=Lowpass.design(rate / factor, cutoff, oversampling),
        temperature=None if motion.temperature is None else freeze(motion.temperature[::factor]),
        position_command=slower(motion.position_command),
        state_noise=slower(motion.state_noise),
    )


def prepare_slower(session: Session, cutoff: float) -> Iterator[Motion]:
    """All runs of a session that are long enough, as motions for the diagnosis.

    Each is decimated before the next is smoothed, and takes a draw of its encoder noise along.
    """
    rng = np.random.default_rng(NOISE_SEED)
    return map(decimate, prepare_each(session, cutoff, CRITICAL_OVERSAMPLING, rng))
