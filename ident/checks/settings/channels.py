"""Channels that hold still, and flat tops: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ChannelSettings(Numbers):
    """Stuck values, flat tops, commands that pose as measurements."""

    stuck_s: float = number(
        0.3,
        "s",
        "time for which a stuck channel repeats one value while its joint moves",
        "chosen: no usual repetition",
    )
    stuck_samples: int = number(
        10,
        "1",
        "and samples",
        "chosen: no usual repetition",
    )
    stuck_repetitions: float = number(
        10.0,
        "1",
        "times its usual repetition, as coarse channels repeat values too",
        "chosen: far beyond it",
    )
    hidden_travel: float = number(
        0.02,
        "rad",
        "motion that a frozen position hides, by the velocity or the command",
        "chosen: well above what velocity noise sums up to",
    )
    lag_times: float = number(
        2.0,
        "1",
        "times what a joint lags behind its command elsewhere from which on its encoder is frozen",
        "chosen: a controller that lets a joint stand while its command creeps lags as elsewhere",
    )
    lag_share: float = number(
        0.99,
        "1",
        "share of the other samples that lag no farther",
        "chosen: nearly all",
    )
    jump_steps: float = number(
        5.0,
        "1",
        "or a step out of the freeze that is so many times its largest usual ones",
        "chosen: no motion",
    )
    jump_rad: float = number(
        0.005,
        "rad",
        "and so large",
        "chosen: no motion",
    )
    most_lost: float = number(
        0.3,
        "1",
        "share of lost samples beyond which the channel itself is broken",
        "chosen: a third",
    )
    top_pile: float = number(
        2.0,
        "1",
        "times the samples of any slice below that a cut-off value holds",
        "chosen: a cut piles up what would lie above",
    )
    top_slices: int = number(
        5,
        "1",
        "slices below",
        "chosen: just below",
    )
    top_range: float = number(
        0.005,
        "1",
        "width of each, as a share of the range",
        "chosen: just below",
    )
    top_samples: int = number(
        10,
        "1",
        "least samples at the top",
        "chosen: more than chance",
    )
    top_stretch: int = number(
        5,
        "1",
        "least samples at the top in a row",
        "chosen: more than chance",
    )
    top_level: float = number(
        0.3,
        "1",
        "least height of a limit, as a share of the largest size",
        "chosen: a limit lies far out",
    )
    coarse: float = number(
        0.02,
        "1",
        "share of its range that a coarse channel's values stand apart",
        "chosen: repetitions then mean nothing",
    )
    command_share: float = number(
        0.99,
        "1",
        "share of moving samples that equal the command where it poses as a measurement",
        "chosen: nearly all",
    )


CHANNELS = ChannelSettings()
