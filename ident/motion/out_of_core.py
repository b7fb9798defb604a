"""Sessions of hours: motions that wait on disk until they are asked for, so that memory does not grow with length.

Numbers go to unnamed temporary files, which vanish with the process that made them, and are mapped into memory run by
run: what is asked for is read, what is let go is gone. A session that is short enough is held in memory as it is.

Where a few samples say as much as all of them (typical sizes, a model to linearise about, maps, curves), one of every
so many runs is asked: about `HELD_SAMPLES` samples, from all over the session. Sums of squares see every sample.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from itertools import chain, compress, pairwise
from tempfile import TemporaryFile, gettempdir
from typing import IO, Any, Generic, TypeVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.motion.motion import Motion, torque_band

# Samples of a session that are held in memory; those of a longer one are spooled.
HELD_SAMPLES = 200_000
# A run of a spooled session that is longer than this is gone through in pieces that share its clock.
PIECE_SAMPLES = 40_000
# Length of the stretches of a spooled session that a diagnosis looks at.
STRETCH_SAMPLES = 4_000
# Of the choice of runs where a few are enough.
CHOICE_SEED = 0
CHANNELS = ("time", "q", "dq", "ddq", "tau", "temperature", "position_command", "state_noise")

T = TypeVar("T")


class OnDemand(Sequence[T], ABC, Generic[T]):
    """A sequence whose entries are made anew each time they are asked for; whoever holds none keeps no memory."""

    @abstractmethod
    def _make(self, index: int) -> T:
        """The entry of an index that exists."""

    def __getitem__(self, index: Any) -> Any:
        at = range(len(self))[index]
        return self._make(at) if isinstance(at, int) else tuple(self._make(k) for k in at)


class SpooledArrays(OnDemand[Float[Array, "..."]]):
    """Arrays of any shape and kind in one temporary file, or in that of others; entries are read-only maps, or changed.

    Attributes:
        change: What is made of an array when it is asked for, by its index; nothing if None.
    """

    def __init__(self, arrays: Iterable[Float[Array, "..."]] = (), beside: SpooledArrays | None = None) -> None:
        self.change: Callable[[int, Array], Array] | None = None
        self._file: IO[bytes] = TemporaryFile(prefix="armgap-") if beside is None else beside._file  # noqa: SIM115
        self._spots: list[tuple[int, tuple[int, ...], np.dtype[Any]]] = []
        for values in arrays:
            self.append(values)

    def __len__(self) -> int:
        return len(self._spots)

    def append(self, values: Float[Array, "..."]) -> None:
        """Writes one more array."""
        self._spots.append((-1, (-1,), np.dtype(float)))
        self[len(self) - 1] = values

    def __setitem__(self, index: int, values: Float[Array, "..."]) -> None:
        """Writes an array in the place of one; who holds that may see either.

        Raises:
            InputError: The disk of temporary files is full.
        """
        values, (offset, *kind) = np.asarray(values), self._spots[index]
        try:
            where = (offset, os.SEEK_SET) if kind == [values.shape, values.dtype] else (0, os.SEEK_END)
            self._spots[index] = self._file.seek(*where), values.shape, values.dtype
            self._file.write(values.tobytes())
            self._file.flush()
        except OSError as error:
            remedy = "free some space there, or name a roomier folder in the variable TMPDIR"
            raise InputError(gettempdir(), f"can't hold a long session: {error.strerror}", remedy) from None

    def _make(self, index: int) -> Float[Array, "..."]:
        offset, shape, kind = self._spots[index]
        if 0 in shape:
            return np.zeros(shape, dtype=kind)
        found = np.asarray(np.memmap(self._file, dtype=kind, mode="r", offset=offset, shape=shape))
        return found if self.change is None else self.change(index, found)


class SpooledMotions(OnDemand[Motion]):
    """The motions of a long session.

    Attributes:
        recorded: Number of runs; long ones are held in pieces.
        samples: Number of samples.
        most: Samples that are asked where a few are enough.
        bare: The motions without their signals.
    """

    def __init__(self, motions: Iterable[Motion], most: int | None = None) -> None:
        self.recorded, self.samples, self.most = 0, 0, most or HELD_SAMPLES
        self.bare: list[Motion] = []
        self._channels, nothing = {name: SpooledArrays() for name in CHANNELS}, np.zeros(0)
        for motion in motions:
            self.recorded += 1
            for piece in cut(motion, PIECE_SAMPLES):
                for name, channel in self._channels.items():
                    values = getattr(piece, name)
                    channel.append(nothing if values is None else values)
                self.bare.append(_with_channels(piece, dict.fromkeys(CHANNELS, nothing)))
                self.samples += len(piece.time)

    def __len__(self) -> int:
        return len(self.bare)

    def below(self, corner: float) -> SpooledMotions:
        """The same motions with a common filter of at most this corner [Hz]."""
        found = copy(self)
        found.bare = [motion.below(corner) for motion in self.bare]
        return found

    @property
    def every(self) -> int:
        """One of how many motions is asked where a few are enough."""
        return max(1, -(-self.samples // self.most))

    def _make(self, index: int) -> Motion:
        return _with_channels(self.bare[index], {name: values[index] for name, values in self._channels.items()})


def hold(motions: Iterable[Motion]) -> Sequence[Motion]:
    """Motions in memory, or on disk as soon as they are more than memory should hold."""
    coming = iter(motions)
    held: list[Motion] = []
    samples = 0
    for motion in coming:
        held.append(motion)
        samples += len(motion.time)
        if samples > HELD_SAMPLES:
            return SpooledMotions(chain(emptied(held), coming))
    return tuple(held)


def within_band(motions: Sequence[Motion], inertia: Float[Array, " n"]) -> Sequence[Motion]:
    """The same motions, their common filter's corner no higher than what is known of the motion bears on torques.

    Where torque is looked at beyond the band that states follow, speeds and accelerations that are half kept stand
    against torques that are whole: where that is more than a little (`torque_band`) it looks like elasticity, whose
    torque grows towards its resonance.
    """
    bare = motions.bare if isinstance(motions, SpooledMotions) else motions
    known = [(motion.band, motion.settings.whole_share) for motion in bare if motion.band is not None]
    # Of most joints in most runs; infinite where nobody knows.
    corner = known[0][1] * float(np.median(np.median([band for band, _ in known], axis=0))) if known else np.inf
    if np.isfinite(corner):
        corner = float(np.median([torque_band(motion, inertia, corner) for motion in few(motions)]))
    if isinstance(motions, SpooledMotions):
        return motions.below(corner)
    return tuple(motion.below(corner) for motion in motions)


def few(motions: Sequence[Motion]) -> Sequence[Motion]:
    """Enough motions for typical sizes: all that are held in memory, or an even choice of spooled ones."""
    if not isinstance(motions, SpooledMotions):
        return motions
    return tuple(motions[k] for k in choose_runs(len(motions), motions.every))


def choose_stretches(motions: Sequence[Motion]) -> tuple[Motion, ...]:
    """All motions of a session that is held in memory, or stretches from all over a spooled one.

    A standard error falls with the root of the number of samples, work grows with the number itself: so many samples
    as are held in memory are enough. Stretches of one recorded run count as pieces of it.
    """
    if not isinstance(motions, SpooledMotions):
        return tuple(motions)
    counts = [-(-len(motion.time) // STRETCH_SAMPLES) for motion in motions]
    chosen = np.zeros(sum(counts), dtype=bool)
    wanted = max(1, len(chosen) * motions.most // max(motions.samples, motions.most))
    edges = np.linspace(0, len(chosen), wanted + 1).astype(int)
    chosen[np.random.default_rng(CHOICE_SEED).integers(edges[:-1], edges[1:])] = True  # see `choose_runs`
    found, run, last = [], -1, -1
    for k, of_piece in enumerate(np.split(chosen, np.cumsum(counts)[:-1])):
        run += not motions.bare[k].continues
        for stretch in compress(cut(motions[k], STRETCH_SAMPLES), of_piece) if of_piece.any() else ():
            held = {name: np.array(values) for name in CHANNELS if (values := getattr(stretch, name)) is not None}
            found.append(replace(_with_channels(stretch, held), continues=run == last))
            last = run
    return tuple(found)


def choose_runs(count: int, every: int) -> list[int]:
    """Indices of one run out of each stretch of `every`, at a random but always the same place of it.

    Recordings often go through a few kinds of motion in turn. Runs at even distances, or at places that shift by an
    even step, may all be of the same few kinds; runs at random places are of all kinds in proportion.
    """
    starts = np.arange(0, count, every)
    places = np.random.default_rng(CHOICE_SEED).integers(np.minimum(every, count - starts))
    return [int(k) for k in starts + places]


def runs_recorded(motions: Sequence[Motion]) -> int:
    """Number of runs, pieces of one counted as one."""
    return motions.recorded if isinstance(motions, SpooledMotions) else len(motions)


def pieces_of(motions: Sequence[Motion], length: int) -> int:
    """In how many pieces a run of so many samples stands among motions."""
    return -(-length // PIECE_SAMPLES) if isinstance(motions, SpooledMotions) else 1


def select_joints(motions: Sequence[Motion], joints: tuple[str, ...]) -> Sequence[Motion]:
    """The same motions of some joints only."""
    chosen = (motion.select(joints) for motion in motions)
    return SpooledMotions(chosen) if isinstance(motions, SpooledMotions) else tuple(chosen)


def cut(motion: Motion, most: int) -> Iterator[Motion]:
    """A run in pieces of about equal length, each of at most so many samples; a short one as it is."""
    count = -(-len(motion.time) // most)
    if count <= 1:
        yield motion
        return
    edges = np.linspace(0, len(motion.time), count + 1).astype(int)
    for k, (start, end) in enumerate(pairwise(edges), start=1):
        given = {name: values for name in CHANNELS if (values := getattr(motion, name)) is not None}
        pieces = {name: values[start:end] for name, values in given.items()}
        name = f"{motion.name} ({k} of {count})"
        yield replace(_with_channels(motion, pieces), name=name, continues=motion.continues or k > 1)


def _with_channels(motion: Motion, values: dict[str, Array]) -> Motion:
    """The same run with other signals, those that it lacks left out."""
    given = {name: array for name, array in values.items() if getattr(motion, name) is not None}
    return replace(motion, **given)  # type: ignore[arg-type]


def emptied(held: list[T]) -> Iterator[T]:
    """Hands out what a list holds and lets it go."""
    while held:
        yield held.pop(0)
