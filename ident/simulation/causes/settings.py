"""Numbers that decide, each with its unit, its meaning and where it comes from: those of
the simulated arm's causes that no draw changes.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class SimulatedGearSettings(Numbers):
    """Gears that give way."""

    play_stiffness: float = number(
        600.0,
        "1/rad",
        "stiffness of the meshing teeth, behind which the play lies, per rated torque",
        "K3 and rated torques of the CSG series, Harmonic Drive SE, engineering data: strain-wave "
        "gears under load",
    )
    damping_ratio: float = number(
        0.05,
        "1",
        "share of critical damping of the drive's own oscillation; twice that across play",
        "chosen",
    )


@dataclass(frozen=True)
class LubricantSettings(Numbers):
    """Grease that warms up."""

    rated_rise: float = number(
        25.0,
        "K",
        "its rise at steady rated work, to which thermal changes refer",
        "chosen",
    )


GEAR = SimulatedGearSettings()
LUBRICANT = LubricantSettings()
