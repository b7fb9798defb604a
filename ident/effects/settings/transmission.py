"""Pull of another joint, and springs: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class TransmissionSettings(Numbers):
    """Pull of another joint, and springs."""

    largest_correlation: float = number(
        0.98,
        "1",
        "velocities of two joints that are this alike can't be distinguished",
        "chosen: a fiftieth is left",
    )
    coupling_width: float = number(
        0.01,
        "rad/s",
        "width of the sign of a sum of two joints' speeds in a patch",
        "chosen: as slow as noise",
    )
    farthest: int = number(
        6,
        "joints",
        "farther apart they share no gear, belt or cable",
        "chosen: those of one arm; of a long chain pairs would be most of all",
    )
    least_spring_range: float = number(
        0.2,
        "rad",
        "range over which a spring is told at least",
        "chosen: less is a step of play",
    )
    largest_spring_share: float = number(
        0.1,
        "rated torques a radian",
        "spring that a joint may have",
        "chosen: hoses and cables",
    )


TRANSMISSION = TransmissionSettings()
