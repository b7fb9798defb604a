"""A comparison: its search, its prior, and the permutation of runs: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ChangeSettings(Numbers):
    """What counts as a change between two sets."""

    most_runs: int = number(
        100,
        "1",
        "largest number of runs of a set that are used, an even choice of more",
        "chosen: some dozens determine the between-run variance",
    )
    folds: int = number(
        5,
        "1",
        "number of parts of each set that are left out in turn",
        "chosen: usual where data are few",
    )
    pieces: int = number(
        3,
        "1",
        "number of pieces of a set with fewer runs than that",
        "chosen: the fewest that leave most of a set",
    )
    side_blocks: int = number(
        64,
        "1",
        "largest number of blocks of each set",
        "chosen: both together as many as a diagnosis has",
    )
    fewest_blocks: int = number(
        8,
        "1",
        "least number of blocks of a set for any test",
        "law: with fewer all signs are alike by chance in one of a hundred cases",
    )
    urdf_share: float = number(
        0.5,
        "1",
        "standard deviation of a URDF's inertias, as a share of each link's own",
        "chosen: two sets of recordings need no good URDF",
    )
    shared_laws: float = number(
        1.0,
        "1",
        "standard deviation of a shared law's coefficients, in units of their largest plausible "
        "size",
        "chosen: twice that of a diagnosis",
    )
    grid_points: int = number(
        2,
        "1",
        "points of an effect's grid that are tried; a change is found at the nearest one",
        "chosen: work",
    )
    points_even: int = number(
        6,
        "1",
        "nodes of the part of an unlisted change that depends on the angle alone",
        "chosen: bends of a sixth of the travel",
    )
    points_odd: int = number(
        4,
        "1",
        "nodes of its part that changes sign with the direction",
        "chosen: likewise",
    )
    least_seen: float = number(
        0.02,
        "1",
        "least share of a change's power that the shared baseline must leave",
        "chosen: a fiftieth",
    )
    day_to_day: float = number(
        0.02,
        "1",
        "between-day standard deviation of a joint's friction, as a share",
        "chosen: two kelvin",
    )
    fewest_rows: float = number(
        2.0,
        "1",
        "whitened samples or holds of a joint in each part of a set for what is foretold to be "
        "compared",
        "law: of one alone no scatter is known",
    )
    usual_rise: float = number(
        0.2,
        "1",
        "logarithm of the mean square by which residuals differ between two sets at the least",
        "chosen: a tenth of their size",
    )
    risen_by_chance: float = number(
        0.01,
        "1",
        "chance of a joint of an unchanged arm, below which its residual has risen",
        "chosen: one in a hundred",
    )


@dataclass(frozen=True)
class ChangePriorSettings(Numbers):
    """What both sets say of the laws that they share."""

    least: float = number(
        0.01,
        "1",
        "least variance of a shared law, as a share of the square of its largest size",
        "chosen: that these runs need none says little of others",
    )
    least_urdf: float = number(
        0.04,
        "1",
        "least variance of the URDF's error, as a share of its largest",
        "chosen: a fifth of it",
    )
    absent: float = number(
        1e-07,
        "1",
        "variance below which a law is left out",
        "chosen: far below any that is seen",
    )
    shrink: float = number(
        0.03,
        "1",
        "least factor on a variance in one round",
        "chosen: steps that do not overshoot",
    )
    rounds: int = number(
        12,
        "1",
        "largest number of rounds",
        "chosen: work",
    )
    close: float = number(
        0.1,
        "1",
        "change of a variance's logarithm below which it has converged",
        "chosen: a tenth",
    )


@dataclass(frozen=True)
class PermutedSettings(Numbers):
    """Sets of permuted parts."""

    dealings: int = number(
        6,
        "1",
        "number of permutations of the runs between the sets",
        "chosen: work",
    )
    most_parts: int = number(
        6,
        "1",
        "largest number of parts of each side that are permuted: its runs, or every sixth together",
        "chosen: 20 ways for each side",
    )
    pieces: int = number(
        3,
        "1",
        "number of parts of a side that has one run",
        "chosen: the fewest of which a half is not one",
    )
    prior_freedom: float = number(
        2.0,
        "1",
        "degrees of freedom of a null variance from fewer than three laws",
        "chosen: hardly any",
    )
    most_freedom: float = number(
        20.0,
        "1",
        "largest prior degrees of freedom of a null variance",
        "chosen: they are not independent",
    )
    least: float = number(
        0.001,
        "1",
        "least mean gain a column, for its logarithm",
        "chosen: far below one",
    )


CHANGE = ChangeSettings()
PRIOR = ChangePriorSettings()
PERMUTED = PermutedSettings()
