"""How the arm is mounted and what it feels: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ArrangementSettings(Numbers):
    """Columns, mounts and signs."""

    least_turn_deg: float = number(
        20.0,
        "degrees",
        "angle from which on a base is mounted otherwise",
        "chosen: the bound of a tilt that a diagnosis finds; up to there a wrong zero looks alike "
        "(0.24 rad as 13 degrees)",
    )
    least_gain: float = number(
        1.5,
        "1",
        "factor by which the residuals of all joints that feel gravity must shrink together",
        "measured: 1.02 at most where the gravity that fits best lies 20 degrees or more from a "
        "right one (about 310 sessions)",
    )
    least_explained: float = number(
        0.5,
        "1",
        "share of a torque that is then explained",
        "chosen: most of it",
    )
    scales: tuple[float, float] = number(
        (0.3, 3.0),
        "1",
        "sizes of gravity that masses and gains may have",
        "chosen: beyond lie other units",
    )
    own_size: float = number(
        0.1,
        "1",
        "part of a torque's variance, as a share, that gravity of another size than the model's "
        "leaves more, for each squared factor e",
        "chosen: decides between directions that leave about the same",
    )
    floor: float = number(
        0.001,
        "1",
        "part of a torque's variance that no direction explains",
        "chosen: keeps logarithms finite",
    )
    directions: int = number(
        800,
        "1",
        "directions that are tried at once",
        "chosen: five degrees apart",
    )
    states: int = number(
        1500,
        "1",
        "states that are compared",
        "chosen: more changes nothing",
    )
    least_factor: float = number(
        3.0,
        "1",
        "factor by which the residuals of joints that change places must shrink, each",
        "chosen: beyond chance",
    )
    order_explains: float = number(
        0.6,
        "1",
        "share of their torque that is then explained",
        "chosen: most of it",
    )
    order_floor: float = number(
        0.01,
        "1",
        "part of a torque's variance that no order explains",
        "chosen: keeps logarithms finite",
    )
    order_states: int = number(
        400,
        "1",
        "states that orders are compared by",
        "chosen: more changes nothing",
    )
    far: float = number(
        4.0,
        "1",
        "radii of gyration from all of its joints beyond which a link's centre of mass is in "
        "another frame",
        "calibrated: moving links of 60 public URDFs reach 2.6; one in its base's frame 5 to 38",
    )
    well: float = number(
        0.4,
        "1",
        "share that its joint's model leaves of a torque where it belongs",
        "chosen: less than half",
    )
    inertia_rounding: float = number(
        0.01,
        "1",
        "share of the largest principal moment by which a URDF's few digits are off",
        "chosen: two digits",
    )


@dataclass(frozen=True)
class BetweenRunsSettings(Numbers):
    """Runs against the others of their session."""

    states: int = number(
        100,
        "1",
        "states of a run that are compared",
        "chosen: limit of work",
    )
    rounds: int = number(
        3,
        "1",
        "rounds in which the prior is weighed against the noise",
        "chosen: limit of work",
    )
    chance: float = number(
        0.05,
        "1",
        "chance that a sound session is told to hold an odd run",
        "law: one in twenty, over all alternatives",
    )
    suspects: int = number(
        8,
        "1",
        "partings that are looked into",
        "chosen: limit of work",
    )
    closer: int = number(
        3,
        "1",
        "changes of a parting by which all runs are foretold anew",
        "chosen: limit of work",
    )
    halvings: int = number(
        5,
        "1",
        "halvings of the step by which a zero is followed",
        "chosen: limit of work",
    )


ARRANGEMENT = ArrangementSettings()
BETWEEN_RUNS = BetweenRunsSettings()
