"""Gears that give way: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class GearSettings(Numbers):
    """Gears that give way."""

    largest_twist: float = number(
        1.0,
        "rad",
        "deflection from which on the link's equation, linear in small ones, says nothing of any "
        "arm",
        "chosen: velocity torques or a negative inertia swing it up without bound",
    )
    fine_factors: tuple[float, ...] = number(
        (0.5, 0.6, 0.7, 0.84, 1.0, 1.2, 1.4, 1.7, 2.0),
        "1",
        "factors of the finer grids around the best stiffness or gap",
        "chosen: ratios of about 1.2",
    )
    resonances: tuple[float, ...] = number(
        (2.2, 4.5, 6.5, 9.0, 12.5, 18.0, 30.0),
        "Hz",
        "resonances of the link on its gear; above the last the deflection follows the load at "
        "once",
        "chosen: one point serves all beyond",
    )
    largest_wind_up: float = number(
        2.0,
        "rad",
        "wind-up at the rated torque of springs in series",
        "chosen: softer is no joint",
    )
    least_wind_up: float = number(
        0.0005,
        "rad",
        "and of what is as good as rigid",
        "makers: cycloidal gears wind up by 0.9 to 1 mrad at their rated torque (Nabtesco RV-20E: "
        "167 N m, 49 N m per minute of arc), strain wave gears by more; half of it",
    )
    damping_ratio: float = number(
        0.06,
        "1",
        "damping ratio of the search",
        "chosen: as gears have",
    )
    fine_damping_ratios: tuple[float, ...] = number(
        (0.025, 0.06, 0.14),
        "1",
        "and of the finer grid",
        "chosen: ratios of about 2.4",
    )
    damping_doubt: float = number(
        4.0,
        "1",
        "times by which a damping may be more or less and looks the same",
        "chosen: the grid's reach",
    )
    low_frequency: float = number(
        2.0,
        "Hz",
        "torque above this frequency shows elasticity",
        "chosen: arms move below",
    )
    least_high_share: float = number(
        0.002,
        "1",
        "share of the rated torque that must lie above it",
        "chosen: less is noise",
    )
    narrow_gaps: tuple[float, ...] = number(
        (0.0005, 0.002),
        "rad",
        "full widths of play that the link is through before the filter sees it: what is left is "
        "proportional to the width",
        "chosen: new gears",
    )
    wide_gaps: tuple[float, ...] = number(
        (
            0.0025,
            0.003137,
            0.003937,
            0.00494,
            0.006198,
            0.007778,
            0.00976,
            0.01225,
            0.01537,
            0.01928,
            0.0242,
            0.03037,
            0.0381,
            0.04782,
            0.06,
        ),
        "rad",
        "widths of play, of which those that look most like what is left go on to the search",
        "chosen: ratios of about 1.25, up to a loose coupling",
    )
    wide_kept: int = number(
        2,
        "1",
        "wide gaps that go on to the search, those most like what the tuned model leaves",
        "chosen: a limit on work",
    )
    contact_stiffness: float = number(
        150.0,
        "rated torques a radian",
        "stiffness of the gear in contact",
        "chosen: as in the law of written files",
    )
    contact_damping_ratio: float = number(
        0.3,
        "1",
        "its damping ratio",
        "chosen: tooth contact hardly rebounds",
    )
    fine_contact_ratios: tuple[float, ...] = number(
        (0.3, 0.6, 1.0),
        "1",
        "those of the finer grid",
        "chosen: up to no rebound",
    )
    wide_contact_ratio: float = number(
        1.0,
        "1",
        "that behind a wide gap",
        "chosen: no rebound",
    )
    least_load_share: float = number(
        0.002,
        "1",
        "load to either side of zero that counts, as a share of the rated torque",
        "chosen: less is noise",
    )
    fine_wide_factors: tuple[float, ...] = number(
        (0.82, 0.88, 0.92, 0.96, 1.0, 1.04, 1.08, 1.13, 1.2),
        "1",
        "factors of the finer grid around a wide gap",
        "chosen: each width looks different",
    )


GEAR = GearSettings()
