"""The search of conventions: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ReadingSettings(Numbers):
    """What each reading of a log makes of its torques."""

    transition: float = number(
        0.02,
        "rad/s",
        "width of dry friction's transition",
        "chosen: a few times a filtered velocity's noise",
    )
    standing: float = number(
        0.02,
        "rad/s",
        "speed below which a joint stands",
        "chosen: as above",
    )
    rest_weight: float = number(
        0.3,
        "1",
        "weight of a standing joint's rows, friction holding it with an unknown part",
        "chosen: a tenth of the evidence",
    )
    offset_cost: float = number(
        0.1,
        "1",
        "share of an offset's square that counts as unexplained",
        "chosen: sensors' offsets are a tenth of what gravity makes; a level of the arm's weight "
        "is none",
    )
    least_travel: float = number(
        0.05,
        "rad",
        "travel below which a joint hardly moves: a unit that leaves no more is none of a "
        "recording",
        "chosen: as for excitation",
    )
    limit_margin: float = number(
        0.2,
        "rad or m",
        "how far beyond a limit a joint surely is out of it",
        "chosen: limits are nominal",
    )
    most_size: float = number(
        10000.0,
        "1",
        "largest factor of a size that is tried",
        "chosen: grams, and counts",
    )
    shares: tuple[float, ...] = number(
        (0.0, 0.25, 0.5, 0.75, 1.0),
        "1",
        "of the way from the usual size to the best one, sizes that are tried",
        "chosen: the best lies between",
    )
    told_share: float = number(
        0.001,
        "1",
        "share of the best told direction's evidence from which on a direction of gravity is told",
        "chosen: planar arms tell two",
    )
    floor: float = number(
        0.001,
        "1",
        "share of a torque's variance that no reading explains",
        "chosen: keeps logarithms finite",
    )


@dataclass(frozen=True)
class DescriptionSettings(Numbers):
    """How unlikely a reading is before the log is seen."""

    observations: float = number(
        4.12,
        "1",
        "independent observations that a joint's torque is worth, halved: nats for each logarithm "
        "of what it leaves",
        "fitted: bench fit_conventions, 250 drawn cases on 20 arms; 3.8 to 5.5 without a fifth of "
        "the arms",
    )
    size_spread: float = number(
        0.48,
        "1",
        "standard deviation of the logarithm of joints' torques over their models'",
        "fitted: as above; 0.47 to 0.50 without a fifth of the arms",
    )
    load_spread: float = number(
        0.29,
        "1",
        "root mean square of the logarithm of one and the rated load over an arm's weight",
        "measured: data sheets of UR3, UR5, UR10e, Panda, Gen3, iiwa 14, KR300, TM5-900 and "
        "xArm7: 0.17 to 0.49 of the weight",
    )


@dataclass(frozen=True)
class SearchSettings(Numbers):
    """How far readings are sought, and when one is sure."""

    states: int = number(
        240,
        "1",
        "states by which the best readings are compared",
        "chosen: more changes little",
    )
    screened: int = number(
        64,
        "1",
        "states by which all readings are compared",
        "chosen: limit of work",
    )
    refined: int = number(
        4,
        "1",
        "readings a round of which masses are asked and all states are used",
        "chosen: limit of work",
    )
    paired: int = number(
        6,
        "1",
        "changes of a reading that are tried two by two, the likeliest",
        "chosen: limit of work",
    )
    valued: int = number(
        3,
        "1",
        "places of which each change is tried with each of another's, the likeliest",
        "chosen: limit of work",
    )
    joints: int = number(
        2,
        "1",
        "joints of which all directions, zeros and gears are tried together, those likeliest "
        "changed",
        "chosen: limit of work",
    )
    beam: int = number(
        3,
        "1",
        "orders and units of all columns, the likeliest, in turn of which the next change is "
        "sought",
        "chosen: limit of work",
    )
    most_readings: int = number(
        800,
        "1",
        "readings of the motion in a row, none of them likelier, after which the search ends",
        "chosen: limit of work; up to half a second of processor time with six joints",
    )
    nearest_deg: float = number(
        20.0,
        "degrees",
        "angle from stated gravity below which a direction is no mount",
        "chosen: the bound of a tilt that a diagnosis finds",
    )
    snap_deg: float = number(
        8.0,
        "degrees",
        "angle from an axis of the base below which gravity is along that axis",
        "chosen: bases are mounted square",
    )
    well_explained: float = number(
        0.9,
        "1",
        "share of the torque that is explained where the search goes on only as long as it gains",
        "chosen: real arms read rightly reach 0.95",
    )
    limit_cost: float = number(
        0.49,
        "nats",
        "and joints out of their limits of position, of speed or of effort, each together; and "
        "each joint that another unit leaves without motion",
        "measured: limits of position hold for 12 of 13 real arms, so 2 of 15 by the rule of "
        "succession, over the observations; of speed for 9 of 10, of effort for 10 of 10",
    )
    sure_gain: float = number(
        3.7,
        "nats",
        "by how much another reading must explain more than any that leaves the log as it says, "
        "beyond its costs, to be taken, and by the joints that move alone",
        "fitted: bench fit_sure_gain, 310 logs of 20 arms as they are, none of 300 beyond with 95 "
        "%; 2.7 to 3.8 without a fifth of the arms, of which 0 of 310 logs lie beyond",
    )
    sure_odds: float = number(
        19.0,
        "1",
        "odds of one factor of all masses, under which the log is read as it says, to be told",
        "law: 95 %",
    )


@dataclass(frozen=True)
class MassSettings(Numbers):
    """What is left to the URDF's masses once a log is read."""

    scatter: float = number(
        0.05,
        "1",
        "by how much sizes of joints scatter at least (logarithm)",
        "chosen: URDFs are no better",
    )
    independent: float = number(
        20.0,
        "1",
        "states of a recording that tell a size independently",
        "chosen: some seconds each",
    )
    fewest_sizes: float = number(
        1.5,
        "1",
        "joints that must tell their sizes for a factor to be common",
        "chosen: more than one",
    )
    usual_factor: float = number(
        1.5,
        "1",
        "common factor up to which URDFs and gains are off",
        "measured: 1.36 at most on 80 untouched sessions",
    )
    usual_density: float = number(
        12.5,
        "kg/m³",
        "what an arm weighs, over the cube of its length",
        "measured: 4 to 26, median 12.4, on 15 arms from 0.5 to 925 kg",
    )
    other_unit: float = number(
        3.0,
        "1",
        "factor of one joint's size from which on its effort is in another unit",
        "chosen: gains are off by less",
    )
    rounds: int = number(
        4,
        "1",
        "rounds in which joints are weighed anew by what they leave",
        "chosen: settles",
    )
    ridge: float = number(
        1e-06,
        "1",
        "ridge of a body's parameters, scaled",
        "chosen: numerical",
    )


READINGS = ReadingSettings()
DESCRIPTION = DescriptionSettings()
SEARCH = SearchSettings()
MASSES = MassSettings()
