"""Channels that come in rows of their own: merged topics, whose rates and stamps differ.

The rows of the channel that comes most rarely are kept, and the others are interpolated to their
stamps: nothing is made up between two torques.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float

# Share of the rows with any state that may lack a channel: more is another topic's rate.
MANY_ROWS = 0.1
# A stretch without a sample between which nothing is interpolated, in usual intervals of the
# channel (chosen: as long as a few messages that were lost).
LONGEST_GAP = 6.0


@dataclass(frozen=True, eq=False)
class RarestRows:
    """Rows of the channel that comes most rarely, where the others are known."""

    rarest: str  # the channel
    others: str  # the other channels, in words
    rows: Bool[Array, " R"]  # which rows are used


def rows_of_rarest(
    time: Float[Array, " R"], held: Mapping[str, Bool[Array, " R"]]
) -> RarestRows | None:
    """Rows of the channel that comes most rarely, at or between samples of all others.

    Args:
        time: Of all rows [s, or any unit].
        held: By channel, which rows hold it.

    Returns:
        None where time decreases, where state comes in the same rows, and where no row is left.
    """
    if not np.all(np.diff(time) >= 0.0):
        return None
    rarest = rarest_channel(held)
    if rarest is None:
        return None
    rows = held[rarest]
    for with_channel in held.values():
        rows = between_samples(time, with_channel, rows)
    if not rows.any():
        return None
    others = " and ".join(channel for channel in held if channel != rarest)
    return RarestRows(rarest, others, rows)


def rarest_channel(held: Mapping[str, Bool[Array, " R"]]) -> str | None:
    """The channel that the fewest rows hold, where many rows with a state lack one.

    Args:
        held: By channel, which rows hold it.

    Returns:
        None where nearly all rows with a state hold all channels, and where a channel has no row.
    """
    if len(held) < 2 or not all(rows.any() for rows in held.values()):
        return None
    counts = {channel: int(rows.sum()) for channel, rows in held.items()}
    any_state = np.any(list(held.values()), axis=0)
    rarest = min(counts, key=lambda channel: counts[channel])
    is_rare = counts[rarest] < (1.0 - MANY_ROWS) * int(any_state.sum())
    return rarest if is_rare else None


def between_samples(
    time: Float[Array, " R"], held: Bool[Array, " R"], rows: Bool[Array, " R"]
) -> Bool[Array, " R"]:
    """Which of some rows lie at a channel's own sample, or between two that follow one another.

    Args:
        time: Of all rows, increasing [s, or any unit].
        held: Rows that hold the channel.
        rows: Rows that are asked about.
    """
    stamps = time[held]
    if len(stamps) < 2:
        return rows & held
    after = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    intervals = np.diff(stamps)
    is_near = intervals[after - 1] <= LONGEST_GAP * np.median(intervals)
    is_inside = (time >= stamps[0]) & (time <= stamps[-1])
    return rows & (held | (is_near & is_inside))


def at_rows(
    time: Float[Array, " R"], values: Float[Array, " R"], rows: Bool[Array, " R"]
) -> Float[Array, " K"]:
    """A channel's values at some rows: its own, and between them on the straight line.

    Over half of the channel's range nothing steps from one sample to the next but the count of an
    angle that wraps: there the nearer sample is taken.
    """
    held = np.isfinite(values)
    stamps = time[held]
    samples = values[held]
    wanted = time[rows]
    line = np.interp(wanted, stamps, samples)
    if len(samples) < 2:
        return np.asarray(line)
    after = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    steps = np.abs(samples[after] - samples[after - 1])
    is_wrap = 2.0 * steps > np.ptp(samples)
    is_later = wanted - stamps[after - 1] > stamps[after] - wanted
    nearer = np.where(is_later, samples[after], samples[after - 1])
    return np.where(is_wrap, nearer, line)
