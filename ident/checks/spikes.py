"""Single wild cells of any channel: cut out before anything else looks at the numbers.

A cell is absurd if no unit makes it a figure of an arm. It is a spike if it leaves the samples
around it, which agree among themselves, much farther than nearly all samples do: the measure is a
high quantile of the same distance over all runs, so that fast motion, coarse channels and noise
each set their own level, and no few samples can raise it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from ident.arrays import Array, Bool, Float
from ident.checks.angles import TURN
from ident.checks.report import Findings
from ident.checks.settings import ANGLES as LIMIT
from ident.errors import plural
from ident.recordings.recording import Session, TelemetryIssue

# Commands may leap: nobody but the checks of `ident.checks.channels` reads them.
WATCHED = ("effort", "position", "velocity", "current", "acceleration", "temperature")

# Nobody needs these: where they are broken they are left out, and the session is used without them.
OPTIONAL = ("velocity", "acceleration", "temperature")


def mend_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows in which a position leaves its neighbours for one sample.

    Where more than 1 % of a run's rows do so, they stay.
    """
    findings = Findings(session)
    for run in session.runs:
        wild = find_spikes(run.position)
        rows: Bool[Array, " T"] = np.asarray(wild.any(axis=1))
        # Many such rows are no hiccup but a channel that can't be trusted; the velocity check will
        # tell.
        if rows.any() and rows.mean() <= 0.01:
            first = run.time[rows][0]
            words = f"position leaves its neighbours for one sample {rows.sum()} times"
            columns = np.flatnonzero(wild.any(axis=0))
            findings.note(run, f"{words}, first at {first:.3f} s", columns)
            findings.runs.append(run.at(~rows))
        else:
            findings.runs.append(run)
    return findings.left(), findings.issues("garbage_cells")


def find_spikes(q: Float[Array, "T n"]) -> Bool[Array, "T n"]:
    """Samples far from both neighbours while these are close to each other; wraps are none."""
    wild = np.zeros(q.shape, dtype=bool)
    if len(q) < 5:
        return wild
    expected = 0.5 * (q[:-2] + q[2:])
    off = q[1:-1] - expected
    noise = np.median(np.abs(off), axis=0)
    beyond = np.abs(off) > np.maximum(LIMIT.spike_rad, LIMIT.spike_noises * noise)
    between = np.abs(q[2:] - q[:-2])
    returns = between < 0.2 * np.abs(off)
    turns = np.abs(np.abs(off) - TURN) < LIMIT.wrap_rest
    wild[1:-1] = beyond & returns & ~turns
    return wild


def mend_absurd(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows with a cell, the time included, that no arm can have had."""
    wild = []
    for run in session.runs:
        far = [np.abs(values) > LIMIT.absurd for values in run.channels().values()]
        far_in_time = np.abs(run.time) > LIMIT.absurd_time
        wild.append(np.any(far, axis=0) | far_in_time[:, None])
    return _drop(session, wild, "garbage_cells", "cells beyond any figure of an arm", "")


def mend_channel_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows in which a channel leaves the samples around it for a moment."""
    issues: list[TelemetryIssue] = []
    intervals = [run.sample_interval for run in session.runs if len(run) > 1]
    slow = float(np.median(intervals or [0.0])) > LIMIT.slow_s
    for channel in WATCHED:
        if not all(channel in run.channels() for run in session.runs):
            continue
        values = [np.asarray(run.channels()[channel]) for run in session.runs]
        wide = slow or channel in ("position", "temperature")
        gap = LIMIT.wide_gap if wide else LIMIT.gap
        floor = LIMIT.spike_rad if channel == "position" else 0.0
        wild = find_wild(values, floor, slow, gap)
        issue = "effort_spike" if channel in ("effort", "current") else "garbage_cells"
        words = f"{channel} leaves the samples around it"
        session, issues_of_channel = _drop(session, wild, issue, words, channel)
        issues += issues_of_channel
    return session, issues


def find_far(
    runs: list[Float[Array, "T n"]], gap: float = LIMIT.gap, floor: float = 0.0
) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel lie far from all else, by run, however many they are.

    A motion, a torque or a temperature comes to a value through those on the way. Walking outwards
    from a channel's median, sample by sample in order of distance, the first stretch without any
    sample that is several times as wide as all that lies within parts the channel from what is not
    its own. Half of the samples may be bad.

    Args:
        runs: The channel.
        gap: How many times the reach of all that lies within the stretch must span.
        floor: Reach below which nothing is far, in the channel's unit.
    """
    whole = np.concatenate(runs)
    if len(whole) < 3:
        return [np.zeros(values.shape, dtype=bool) for values in runs]
    middle = np.median(whole, axis=0)
    reach = np.abs(whole - middle)
    usual = np.quantile(reach, LIMIT.reach_share, axis=0)
    limit = np.full(len(middle), np.inf)
    for joint in range(len(middle)):
        of_others = np.delete(usual, joint) if len(usual) > 1 else usual
        least = max(float(of_others.max()), floor)
        limit[joint] = _end_of(reach[:, joint], gap, least)
    return [np.abs(values - middle) > limit for values in runs]


def _end_of(reach: Float[Array, " T"], gap: float, least: float) -> float:
    """Where a channel ends: before the first empty stretch beyond half of its samples.

    Args:
        reach: Distance of the samples from the median.
        gap: How many times the reach of all within, or `least`, such a stretch spans.
        least: Reach of the other joints.
    """
    if least <= 0.0:
        return np.inf
    half = len(reach) // 2
    outer = np.sort(reach)[half:]
    within = np.maximum(outer[:-1], least)
    empty = outer[1:] > gap * within
    if not empty.any():
        return np.inf
    return float(outer[np.argmax(empty)])


def find_wild(
    runs: list[Float[Array, "T n"]],
    floor: float = 0.0,
    slow: bool = False,
    gap: float = LIMIT.gap,
) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel are spikes, by run.

    Args:
        runs: The channel.
        floor: Of positions: less than this is no spike [rad], and a turn is a wrap; an encoder may
            have been set anew.
        slow: Whether a single sample may be true where it stands out by the channel's range.
        gap: How far beyond an empty stretch a cell must lie, see `find_far`.
    """
    masks = find_far(runs, gap, TURN if floor else 0.0)
    for width, share_of_range in LIMIT.widths:
        long = [number for number, values in enumerate(runs) if len(values) > 4 * width]
        if not long:
            continue
        sizes = {number: np.abs(distance(runs[number], width)) for number in long}
        every_size = np.concatenate(list(sizes.values()))
        level = np.quantile(every_size, LIMIT.share, axis=0)
        whole = np.concatenate([runs[number] for number in long])
        low, high = np.percentile(whole, [2, 98], axis=0)
        spread = high - low
        least = LIMIT.widths[-1][1] if slow else share_of_range
        limit = np.maximum(LIMIT.times * level, least * spread)
        limit = np.maximum(limit, floor)
        # A joint at rest has next to no range of its own: what is a tremble beside the arm's motion
        # is no fault.
        tremble = LIMIT.tremble * float(np.max(spread))
        limit = np.maximum(limit, tremble)
        for number, size in sizes.items():
            # A channel that never changes has no limit either: any change would be a spike.
            spikes = (size > limit) & (limit > 0.0)
            if floor:
                spikes &= np.abs(size - TURN) >= LIMIT.wrap_rest
            masks[number] |= spikes
    return masks


def distance(values: Float[Array, "T n"], width: int) -> Float[Array, "T n"]:
    """How far each sample lies from the median of those around it.

    The first and last ones have the window at the run's end: a mirrored neighbour would count
    twice.

    Args:
        values: A channel of one run.
        width: Samples on each side that are counted, beside the sample itself.
    """
    count = len(values)
    every = median_filter(values, (2 * width + 1, 1))
    medians = every[width : count - width]
    rows = np.arange(count) - width
    nearest = np.clip(rows, 0, len(medians) - 1)
    return np.asarray(values - medians[nearest])


def _drop(
    session: Session, wild: list[Bool[Array, "T n"]], issue: str, words: str, channel: str
) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows with wild cells, and tells; where there are too many, refuses.

    Args:
        session: The recordings.
        wild: Which cells, by run.
        issue: Wording of the issue.
        words: What was seen.
        channel: Where; "" if in several.
    """
    findings = Findings(session)
    lost = 0
    for run, mask in zip(session.runs, wild, strict=True):
        rows = np.asarray(mask.any(axis=1))
        if not rows.any():
            findings.runs.append(run)
            continue
        count = int(rows.sum())
        lost += count
        first = int(np.flatnonzero(rows)[0])
        joint = int(np.argmax(mask[first]))
        place = f"{run.joints[joint]} in row {first + 1}"
        if channel:
            place += f", {run.channels()[channel][first, joint]:.4g}"
        columns = np.flatnonzero(mask.any(axis=0))
        findings.note(run, f"{words} in {plural(count, 'row')}, first of {place}", columns)
        findings.runs.append(run.at(~rows))
    if lost <= max(LIMIT.most_rows * session.samples, 1):
        is_little = lost < 0.001 * session.samples
        return findings.left(), findings.issues(issue, "note" if is_little else "warning")
    if channel in OPTIONAL:
        findings.runs = [run.replace(**{channel: None}) for run in session.runs]
        return findings.left(), findings.issues("broken_channel", channel=channel)
    refusal = "wild_cells" if issue == "garbage_cells" else "wild_effort"
    return findings.left(), findings.issues(refusal)
