"""The inference: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class UrdfSettings(Numbers):
    """Scales of the URDF's error that are tried, and their prior."""

    scales: tuple[float, ...] = number(
        (0.5, 0.7, 1.0, 1.5, 2.2, 3.3, 5.0, 8.0),
        "1",
        "scales of the URDF's error that are tried, in units of its tolerance",
        "chosen: beyond a fifth (five times 4 %) a URDF is of another arm",
    )
    usual_factor: float = number(
        2.0,
        "1",
        "standard deviation of the log scale, as a factor, in its prior",
        "chosen: a guess",
    )
    com_m: tuple[float, ...] = number(
        (0.0, 0.005, 0.01, 0.02),
        "m",
        "errors of all centres of mass that are tried",
        "chosen: beyond two centimetres a URDF is of another arm",
    )
    usual_com_m: float = number(
        0.008,
        "m",
        "standard deviation of that error in its prior",
        "chosen: a guess",
    )


URDF = UrdfSettings()
