"""Numbers that decide, each with its unit, its meaning and where it comes from: how time
is cut, what counts as seen, how much friction varies from run to run.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.recordings.blocks import SHORTEST_SUMMED_S
from ident.records import Numbers, number


@dataclass(frozen=True)
class RegressionSettings(Numbers):
    """What the sums are made of, and what is known beforehand."""

    inertia_share: float = number(
        0.04,
        "1",
        "standard deviation of a URDF's inertial numbers, as a share of the link's mass, mass x "
        "length, mass x length²",
        "chosen: arms come out of the factory within some per cent of their drawing",
    )
    known_share: float = number(
        0.005,
        "1",
        "the same of inertias that were identified on this very arm",
        "chosen: what a fit on rich motion leaves open",
    )
    folds: int = number(
        10,
        "1",
        "parts of a session that are left out in turn",
        "chosen: usual",
    )
    fewest_runs: int = number(
        5,
        "1",
        "runs below which folds are pieces of runs",
        "chosen: else each is judged by a model of another motion",
    )
    most_blocks: int = number(
        128,
        "1",
        "blocks of time, at the most",
        "chosen: enough for a covariance between blocks, few enough to hold",
    )
    most_sums_mb: float = number(
        512.0,
        "MB",
        "size of the sums of all blocks, beyond which blocks are fewer",
        "chosen: memory; up to ten joints none are",
    )
    fewest_blocks: int = number(
        16,
        "1",
        "blocks that no lack of memory goes below",
        "law: their signs are drawn in 32,768 ways",
    )
    fewest_folds: int = number(
        5,
        "1",
        "and folds",
        "chosen: usual where data are few",
    )
    shortest_block_s: float = number(
        SHORTEST_SUMMED_S,
        "s",
        "and their least length",
        "chosen: some correlation times of what an arm's model leaves",
    )
    most_lone_runs: int = number(
        256,
        "1",
        "runs that have blocks of their own; of more, several share one",
        "chosen: memory",
    )
    block_draws: int = number(
        4000,
        "1",
        "samples, after decimation, of a block that runs share for which encoder noise is drawn "
        "once more",
        "law: squares of so many samples vary by 2 %; over all blocks by far less than the "
        "noise's ridge allows",
    )
    stretch_s: float = number(
        12.0,
        "s",
        "time over which friction keeps its level",
        "chosen: about the length of a run",
    )
    noise_samples: int = number(
        15000,
        "1",
        "samples, after decimation, that the noise is estimated from",
        "chosen: work",
    )
    noise_order: int = number(
        4,
        "1",
        "order of the noise's autoregression",
        "chosen: more changes no whitened spectrum",
    )
    burst_samples: int = number(
        100,
        "1",
        "samples in a row whose power is separated from bursts",
        "chosen: two seconds, some motions to and fro",
    )
    burst_power: float = number(
        10.0,
        "1",
        "mean square of such a stretch, in units of the middle one's, from which on it is no noise",
        "chosen: noise of drives trebles from no load to rated load at most",
    )
    least_own_noise: float = number(
        0.05,
        "1",
        "share of a residual's mean square that is the torque's own noise, whatever encoders add",
        "chosen: some is",
    )
    mostly_noise: float = number(
        0.5,
        "1",
        "share of a candidate's column that may be encoder noise for it to explain any of the "
        "torque's noise",
        "law: more of it is noise than motion",
    )
    least_visible: float = number(
        1e-05,
        "1",
        "share of a column's power that a model must leave for it to be seen",
        "chosen: far above rounding",
    )
    least_over_noise: float = number(
        0.3,
        "1",
        "and the least multiple of its encoder noise",
        "calibrated: coarse encoders",
    )
    noise_ridge: float = number(
        0.05,
        "1",
        "ridge, as a share of the encoder noise that was taken off a column",
        "calibrated: coarse encoders; what is left of it is an estimate",
    )
    usual_spread: float = number(
        0.01,
        "1",
        "usual variation of friction from run to run, as a share",
        "calibrated: a warm UR10e",
    )
    usual_runs: float = number(
        2.0,
        "1",
        "runs that the usual variation counts as",
        "chosen: less than any session has",
    )
    wide_spread: float = number(
        0.05,
        "1",
        "variation beside which an effect must show before anything is known of it",
        "chosen: more than a warm arm shows",
    )


@dataclass(frozen=True)
class DwellSettings(Numbers):
    """Holds, at which dry friction leans to one side."""

    kept_share: float = number(
        0.3333333333333333,
        "1",
        "share of a hold that is kept at the least when its ends, which filter and smoother blur, "
        "are cut off",
        "chosen: a third",
    )
    shortest_s: float = number(
        0.1,
        "s",
        "shortest stretch of a hold between two jumps of its torque",
        "chosen: some samples of any log",
    )
    jump_levels: float = number(
        2.0,
        "1",
        "change of torque that parts a hold, in levels of static friction",
        "law: from one side of the cone to the other",
    )
    jump_noise: float = number(
        6.0,
        "1",
        "and in standard deviations of its noise",
        "law: never by chance",
    )
    leaning: float = number(
        0.5,
        "1",
        "standard deviation of what friction leans to after a motion, in units of its level",
        "chosen: anything within the cone",
    )
    same_angle: float = number(
        0.001,
        "rad or m",
        "change of an angle, beside the encoder's noise, within which a joint has kept it from "
        "one run to the next",
        "chosen: far below any motion",
    )


@dataclass(frozen=True)
class UnusualSettings(Numbers):
    """Torque that the same states do not leave at other times."""

    shortest_piece: float = number(
        4.0,
        "s",
        "shortest piece of time that is predicted by the others",
        "chosen: longer than a push",
    )
    fewest_pieces: int = number(
        4,
        "1",
        "pieces of a short session",
        "chosen: one of them stays where a piece and its neighbours go",
    )
    most_pieces: int = number(
        24,
        "1",
        "pieces of a long one",
        "chosen: a limit on work",
    )
    far_out: float = number(
        4.0,
        "1",
        "median sizes of what is left, from which on it weighs less",
        "chosen: three standard deviations",
    )
    ridges: tuple[float, ...] = number(
        (0.0001, 0.001, 0.01, 0.1, 1.0),
        "1",
        "ridges that are tried, in mean squares of a feature over the session",
        "chosen: from a free function to a stiff one",
    )
    most_left: float = number(
        0.8,
        "1",
        "share of the median size that may be left at the most, or nothing is taken off",
        "calibrated: of 148 joints of 26 healthy simulated arms 4 have less left",
    )


@dataclass(frozen=True)
class DiscrepancySettings(Numbers):
    """The flexible function beside the named laws."""

    state_columns: int = number(
        64,
        "1",
        "features of a joint's own state",
        "calibrated: twice as many change no variance by more than its error",
    )
    coupling_columns: int = number(
        32,
        "1",
        "features of the other joints",
        "calibrated: likewise",
    )
    lengths: tuple[float, ...] = number(
        (0.5, 1.0, 2.0),
        "1",
        "length scales of the features, in standard deviations of their inputs",
        "chosen: bends within the motion, once and not",
    )
    travels_rad: tuple[float, ...] = number(
        (0.005, 0.02, 0.1),
        "rad or m",
        "travel over which a joint forgets its last reversal",
        "chosen: teeth, gears, cables",
    )
    ages_s: tuple[float, ...] = number(
        (0.1, 0.5),
        "s",
        "and time",
        "chosen: within a motion",
    )
    waves: int = number(
        4,
        "1",
        "waves of the session's time",
        "chosen: slower than any motion",
    )


USUAL_REGRESSION = RegressionSettings()
DWELLS = DwellSettings()
UNUSUAL = UnusualSettings()
DISCREPANCY = DiscrepancySettings()
