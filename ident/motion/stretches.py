"""Sessions of hours by stretches: as many samples as memory should hold, drawn from all over the
session.

A standard error falls with the root of the number of samples; work and memory grow with the number
itself. So a session of more samples than `HELD_SAMPLES` is cut into stretches, each of which draws
a number, and those with the smallest numbers are kept: a simple random sample, whatever the order
in which runs come, of which never more than twice as much is in memory. A shorter session is handed
back as it is.

Source: Efraimidis and Spirakis 2006 (reservoir sampling by random keys).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.motion.motion import Motion, torque_band

# Samples of a session that are held for a diagnosis (13 minutes at 125 Hz, to which faster logs are
# decimated), and for a fit, whose motions keep the log's own rate.
HELD_SAMPLES = 100_000
FITTED_SAMPLES = 1_000_000
# Length of the stretches into which a longer session is cut.
STRETCH_SAMPLES = 4_000
# Of the choice of stretches, or of runs where a few are enough.
CHOICE_SEED = 0
CHANNELS = ("time", "q", "dq", "ddq", "tau", "temperature", "position_command", "state_noise")


@dataclass(frozen=True, eq=False)
class Held:
    """What is held of a session's motions."""

    motions: tuple[Motion, ...]  # the motions, or stretches of them, in their order
    source: tuple[int, ...]  # of each the number of the motion that it is, or is a stretch of
    samples: int  # number of samples of the whole session

    @property
    def in_part(self) -> bool:
        """Whether the session has more samples than are held."""
        return sum(len(motion.time) for motion in self.motions) < self.samples


class _Stretch(NamedTuple):
    """A stretch that may be kept."""

    key: float  # the number that it drew
    source: int  # number of its motion
    motion: Motion


def hold(motions: Iterable[Motion], most: int | None = None) -> Held:
    """Motions as far as memory should hold them: all, or stretches from all over a longer session.

    Args:
        motions: The motions of a session, in their order.
        most: Samples that are held; `HELD_SAMPLES` if None.

    Returns:
        The motions; stretches that follow another of the same run are marked `continues`.
    """
    most = HELD_SAMPLES if most is None else most
    rng = np.random.default_rng(CHOICE_SEED)
    stretches: list[_Stretch] = []
    samples = 0
    whole: list[Motion] = []
    for number, motion in enumerate(motions):
        samples += len(motion.time)
        pieces = cut(motion, STRETCH_SAMPLES)
        stretches += [_Stretch(rng.random(), number, piece) for piece in pieces]
        if samples <= most:
            whole.append(motion)
            continue
        whole.clear()
        if sum(len(stretch.motion.time) for stretch in stretches) > 2 * most:
            stretches = _sample(stretches, most)
    if samples <= most:
        return Held(tuple(whole), tuple(range(len(whole))), samples)
    chosen = []
    sources = []
    last = -1
    for stretch in _sample(stretches, most):
        chosen.append(replace(stretch.motion, continues=stretch.source == last))
        sources.append(stretch.source)
        last = stretch.source
    return Held(tuple(chosen), tuple(sources), samples)


def _sample(stretches: list[_Stretch], most: int) -> list[_Stretch]:
    """Those with the smallest numbers, of so many samples, in their order; they hold on to no
    longer motion.
    """
    order = np.argsort([stretch.key for stretch in stretches])
    samples = list(accumulate(len(stretches[k].motion.time) for k in order))
    count = max(1, int(np.searchsorted(samples, most, side="right")))
    chosen = []
    for k in sorted(order[:count]):
        motion = stretches[k].motion
        channels = {name: values.copy() for name, values in _channels(motion).items()}
        chosen.append(stretches[k]._replace(motion=_with_channels(motion, channels)))
    return chosen


def within_band(motions: Sequence[Motion], inertia: Float[Array, " n"]) -> tuple[Motion, ...]:
    """Motions whose common filter's corner is no higher than what is known of the motion bears on
    torques.

    Where torque is looked at beyond the band that states follow, speeds and accelerations that are
    half kept stand against torques that are whole: where that is more than a little (`torque_band`)
    it looks like elasticity, whose torque grows towards its resonance.

    Args:
        motions: All runs of a session.
        inertia: What each joint moves [kg m²].

    Returns:
        The motions in their order, all with one corner at the most; as they are where no band is
        known.
    """
    banded = [motion for motion in motions if motion.band is not None]
    corner = np.inf  # where nobody knows a band
    if banded:
        # Of most joints in most runs.
        usual_band = float(np.median(np.median([motion.band for motion in banded], axis=0)))
        corner = banded[0].settings.whole_share * usual_band
    if np.isfinite(corner):
        corner = float(np.median([torque_band(motion, inertia, corner) for motion in motions]))
    return tuple(motion.below(corner) for motion in motions)


def choose_runs(count: int, every: int) -> list[int]:
    """Indices of one run out of each stretch of `every`, at a random but always the same place of
    it.

    Recordings often go through a few kinds of motion in turn. Runs at even distances, or at places
    that shift by an even step, may all be of the same few kinds; runs at random places are of all
    kinds in proportion.

    Args:
        count: Number of runs.
        every: Length of a stretch, in runs.
    """
    starts = np.arange(0, count, every)
    places = np.random.default_rng(CHOICE_SEED).integers(np.minimum(every, count - starts))
    return [int(k) for k in starts + places]


def runs_recorded(motions: Sequence[Motion]) -> int:
    """Number of runs, stretches of one counted as one."""
    return sum(not motion.continues for motion in motions)


def cut(motion: Motion, most: int) -> Iterator[Motion]:
    """A run in pieces of about equal length, each of at most `most` samples.

    A short run comes as it is; pieces are named `<run> (1 of 3)` and so on, and all but the first
    are marked `continues`.
    """
    count = -(-len(motion.time) // most)
    if count <= 1:
        yield motion
        return
    edges = np.linspace(0, len(motion.time), count + 1).astype(int)
    for k, (start, end) in enumerate(pairwise(edges), start=1):
        pieces = {name: values[start:end] for name, values in _channels(motion).items()}
        name = f"{motion.name} ({k} of {count})"
        yield replace(
            _with_channels(motion, pieces), name=name, continues=motion.continues or k > 1
        )


def _channels(motion: Motion) -> dict[str, Array]:
    """The signals that a run has."""
    return {name: values for name in CHANNELS if (values := getattr(motion, name)) is not None}


def _with_channels(motion: Motion, values: dict[str, Array]) -> Motion:
    """The same run with other signals."""
    return replace(motion, **values)  # type: ignore[arg-type]
