"""Positions of joints: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class AngleSettings(Numbers):
    """Spikes, wraps and units of positions."""

    fastest_rad_s: float = number(
        12.0,
        "rad/s",
        "speed that joints whose limit is unknown do not exceed",
        "chosen: the fastest small industrial ones reach 8 at the wrist",
    )
    farthest_rad: float = number(
        12.566370614359172,
        "rad",
        "position beyond which no joint with a cable goes, where its limit is unknown",
        "chosen: two turns from zero",
    )
    model_tells: float = number(
        0.5,
        "1",
        "share of the torque that the model must explain in one of both units to be asked",
        "chosen: most of it",
    )
    wrap_rest: float = number(
        0.5,
        "rad",
        "what is left of a step after a wrap is taken out: motion within one sample",
        "chosen: beyond any speed at usual rates",
    )
    spike_rad: float = number(
        0.2,
        "rad",
        "how far a sample that comes back at once must leave its neighbours",
        "chosen: no motion at any rate of sampling",
    )
    spike_noises: float = number(
        30.0,
        "1",
        "and in multiples of how far samples usually do",
        "chosen: far beyond noise",
    )
    jump_speeds: float = number(
        3.0,
        "1",
        "times the speed that a joint has in the run from which on a step is a jump",
        "chosen: motion comes to a speed through those on the way",
    )
    most_jumps: float = number(
        0.01,
        "1",
        "share of samples that jump, from which on a run is no recording of an arm",
        "chosen: a few jumps part a run",
    )
    absurd: float = number(
        1000000000000.0,
        "any",
        "cells beyond are no figure of an arm in any unit",
        "chosen: encoder ticks of many turns stay below",
    )
    absurd_time: float = number(
        1e20,
        "any",
        "and times",
        "chosen: nanoseconds since 1970 are 2e18",
    )
    share: float = number(
        0.97,
        "1",
        "share of all samples whose distance sets the measure of spikes",
        "chosen: no fewer bad samples than the rest can raise it",
    )
    times: float = number(
        8.0,
        "1",
        "times that distance from which on a sample is a spike",
        "chosen: far beyond noise",
    )
    widths: tuple[tuple[int, float], ...] = number(
        ((1, 0.5), (5, 2.0)),
        "samples, 1",
        "samples on each side that are asked, and the least share of the channel's own range (2nd "
        "to 98th percentile)",
        "calibrated: clean channels reach 0.18 and 0.42, a reversal of five samples one; what "
        "lasts longer is another fault, or true",
    )
    tremble: float = number(
        0.02,
        "1",
        "share of the widest joint's range below which nothing is a spike",
        "chosen: a tremble beside the arm's motion",
    )
    slow_s: float = number(
        0.025,
        "s",
        "interval beyond which friction that turns round for a moment is a single sample too",
        "chosen: as long as a reversal",
    )
    most_rows: float = number(
        0.02,
        "1",
        "share of bad rows beyond which the channel can't be trusted",
        "chosen: no hiccup",
    )
    gap: float = number(
        3.0,
        "1",
        "times farther out than all else that a far cell must lie",
        "calibrated: torques, speeds and positions of 82 clean sessions, five of them of real "
        "arms, stay below 1.25",
    )
    wide_gap: float = number(
        10.0,
        "1",
        "the same where samples are rare, or steps coarse",
        "calibrated: temperatures in whole steps stay below 2",
    )
    reach_share: float = number(
        0.95,
        "1",
        "share of the other joints' samples whose distance is nothing",
        "chosen: a torque that is friction alone jumps to its level, and one at rest has next to "
        "no reach",
    )


ANGLES = AngleSettings()
