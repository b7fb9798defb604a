"""Clocks and filters: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ClockSettings(Numbers):
    """Time stamps, gaps and rates."""

    slow_hz: float = number(
        30.0,
        "Hz",
        "rate below which a recording is told to be slow",
        "chosen: the slowest rate that robots publish joint states at by default is above",
    )
    few_rows: float = number(
        0.01,
        "1",
        "share of rows dropped for their time that is a hiccup",
        "chosen: beyond it is another clock",
    )
    most_restarts: int = number(
        20,
        "1",
        "restarts of the clock in one file",
        "chosen: beyond it is no order",
    )
    gap_intervals: float = number(
        5.0,
        "1",
        "intervals that a gap is longer than",
        "chosen: longer than any jitter",
    )
    gap_s: float = number(
        0.05,
        "s",
        "and a time",
        "chosen: an arm's motion changes in it",
    )
    shortest_piece_s: float = number(
        0.5,
        "s",
        "least length of a piece",
        "chosen: motion can be seen in it",
    )
    shortest_piece: int = number(
        30,
        "1",
        "and its least samples",
        "chosen: motion can be seen in them",
    )
    jump_intervals: float = number(
        100000.0,
        "1",
        "intervals that a leap of the clock is longer than",
        "chosen: no pause",
    )
    jump_runs: float = number(
        10.0,
        "1",
        "and times the whole run",
        "chosen: no pause",
    )
    jitter: float = number(
        0.1,
        "1",
        "spread of the intervals (1st to 99th percentile), in medians, from which sampling is "
        "uneven",
        "chosen: less bends nothing",
    )
    even_clock_gain: float = number(
        4.0,
        "1",
        "times that positions fit an even clock better (mean square) where only the stamps tremble",
        "chosen: beyond chance",
    )
    even_clock_off: float = number(
        2.0,
        "1",
        "intervals that stamps may be off an even clock",
        "chosen: else samples are missing",
    )
    clock_off: float = number(
        0.03,
        "1",
        "by how much all velocities are off together where the time base is",
        "calibrated: all joints of the real logs lie within 1.1 % of slope 1 (30 Hz)",
    )
    clock_spread: float = number(
        0.03,
        "1",
        "and differ among each other",
        "calibrated: as above",
    )
    clock_correlation: float = number(
        0.95,
        "1",
        "and correlate",
        "calibrated: real logs by 0.997 or more",
    )
    slope_low: float = number(
        0.9,
        "1",
        "least slope of a velocity that is the positions' derivative",
        "calibrated: as above",
    )
    slope_high: float = number(
        1.1,
        "1",
        "and the largest",
        "calibrated: as above",
    )
    correlation: float = number(
        0.9,
        "1",
        "and its least correlation",
        "calibrated: as above",
    )
    least_ticks: float = number(
        200.0,
        "1",
        "whole ticks from sample to sample that can only be of a micro- or nanosecond clock",
        "chosen: no logger waits so many seconds",
    )
    slowest_interval_s: float = number(
        0.5,
        "s",
        "interval that no logger of an arm's motion has",
        "chosen: time is in another unit",
    )
    fastest_interval_s: float = number(
        2e-05,
        "s",
        "and the shortest",
        "chosen: time is in another unit",
    )
    inertia_low: float = number(
        0.15,
        "1",
        "inertial torque against gravity's, where no velocity is measured: it goes with time to "
        "the -2",
        "calibrated: 0.49 to 3.4 in the real logs, rotors and friction included",
    )
    inertia_high: float = number(
        6.0,
        "1",
        "and the largest",
        "calibrated: as above",
    )
    visible_inertia: float = number(
        0.03,
        "1",
        "share of gravity's change from which on inertia shows",
        "chosen: less says nothing of time",
    )
    loaded_Nm: float = number(
        5.0,
        "N m",
        "change of gravity of joints that carry much",
        "chosen: on a wrist the rotor's inertia exceeds the links' by any factor",
    )
    over_limit: float = number(
        1.5,
        "1",
        "times its own limit that no arm moves faster than",
        "chosen: limits are nominal",
    )


@dataclass(frozen=True)
class FilterSettings(Numbers):
    """The motion of a run as the checks see it."""

    cutoff_hz: float = number(
        5.0,
        "Hz",
        "cut-off of the checks' filter",
        "chosen: arms move below some hertz; above is mostly noise of currents and differentiated "
        "encoders",
    )
    edge_periods: float = number(
        1.5,
        "periods",
        "of the cut-off, that the filter's transient lasts at both ends of a run",
        "chosen: it has settled",
    )
    samples_per_period: int = number(
        4,
        "1",
        "samples kept a period of the cut-off",
        "chosen: twice Nyquist's two, so that nothing folds",
    )
    least_samples: int = number(
        30,
        "1",
        "samples of a run that can be filtered",
        "chosen: thirty",
    )
    filter_order: int = number(
        4,
        "1",
        "order of the filter",
        "chosen: no ripple",
    )
    moving_rad_s: float = number(
        0.02,
        "rad/s",
        "a joint's velocity is compared where it moves",
        "chosen: at rest both are noise",
    )
    most_grid: float = number(
        100.0,
        "1",
        "times an even grid is as long as the samples that it is made of",
        "chosen: a clock that leaps makes it longer",
    )


@dataclass(frozen=True)
class LatenessSettings(Numbers):
    """Torques that are late."""

    longest_s: float = number(
        0.05,
        "s",
        "delay of a torque up to which a diagnosis finds it",
        "law: the bound of torque_delay in effects.toml",
    )
    steps: int = number(
        4,
        "1",
        "steps of the filtered states by which a torque is tried late or early",
        "chosen: limit of work",
    )


CLOCK = ClockSettings()
FILTER = FilterSettings()
LATENESS = LatenessSettings()
