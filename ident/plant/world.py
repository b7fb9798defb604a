"""A world: what a diagnosis has no right to know of the arm and sensors that made its recordings.

A world holds one value of every property below; a `WorldRange` holds bounds or choices, from which worlds are drawn:
uniformly, or uniformly in the logarithm where the bounds lie more than a decade apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ident.errors import InputError
from ident.untrusted_files import read_toml

EncoderSide = Literal["motor", "link"]
VelocityChannel = Literal["none", "differenced", "filtered", "true"]
FeedForward = Literal["none", "rigid", "friction"]
ReferenceShape = Literal["smooth", "jerk", "acceleration"]


@dataclass(frozen=True)
class World:
    """One world.

    Attributes:
        name: Of the range that it was drawn from.
        robot: URDF path or name.
        encoder_noise_rad: Standard deviation of a position reading before it is rounded [rad at the joint].
        encoder_bits: A turn of the encoder has two to this many counts.
        encoder_at: Whether the encoder that is logged sits on the motor or on the link.
        rate_hz: Log rate [Hz].
        jitter: Largest deviation of a sample's instant from the even grid, as a share of the interval.
        lost: Share of samples that are missing.
        torque_noise: Standard deviation of an unloaded joint's torque reading, as a share of rated torque.
        coloured_share: Share of that variance which is coloured; the rest is white.
        corner_hz: Corner frequency of the coloured part [Hz].
        load_growth: Relative growth of the noise from no torque to rated torque.
        friction_spread: Standard deviation of the relative change of friction from run to run.
        friction_drift: Standard deviation of the relative change of friction that has gathered by the session's end.
        velocity: Velocity channel: none, differences of the logged positions, the firmware's filter, or the truth.
        velocity_delay_s: How late the firmware's filter is [s].
        bandwidth_hz: Of the position loop [Hz].
        feed_forward: What the controller adds: gravity alone (`none`), the rigid model, or that and friction.
        reference: Whether the reference is smooth, or has steps of jerk or of acceleration.
        friction_scale, rotor_scale, gear_scale: Factors on what an arm of this size usually has.
        runs: Number of runs.
        duration_s: Of all of them together, roughly [s].
        link_error: Standard deviation of the relative error of the URDF's masses and inertias.
        com_error_m: Root mean square distance of the centres of mass from the URDF's [m].
        copied_link: Whether one link of the URDF has the mass of its neighbour.
    """

    name: str
    robot: str
    encoder_noise_rad: float
    encoder_bits: int
    encoder_at: EncoderSide
    rate_hz: float
    jitter: float
    lost: float
    torque_noise: float
    coloured_share: float
    corner_hz: float
    load_growth: float
    friction_spread: float
    friction_drift: float
    velocity: VelocityChannel
    velocity_delay_s: float
    bandwidth_hz: float
    feed_forward: FeedForward
    reference: ReferenceShape
    friction_scale: float
    rotor_scale: float
    gear_scale: float
    runs: int
    duration_s: float
    link_error: float
    com_error_m: float
    copied_link: bool

    @property
    def run_duration_s(self) -> float:
        """Rough duration of a run [s]."""
        return max(self.duration_s / max(self.runs, 1), SHORTEST_RUN_S)

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> World:
        """Inverse of `to_dict` after a passage through JSON."""
        return cls(**values)


SHORTEST_RUN_S = 3.0
Bounds = tuple[float, float]
Choices = tuple[Any, ...]
# Log rates that controllers and drivers really have [Hz]; a drawn rate is the nearest of them.
RATES_HZ = (30.0, 50.0, 62.5, 100.0, 125.0, 200.0, 240.0, 250.0, 333.0, 500.0, 1000.0)

FULL_TABLE: dict[str, Bounds] = {
    "encoder_noise_rad": (1e-6, 1e-3),
    "encoder_bits": (12, 24),
    "rate_hz": (30.0, 1000.0),
    "jitter": (0.0, 0.2),
    "lost": (0.0, 0.02),
    "torque_noise": (5e-4, 0.03),
    "coloured_share": (0.0, 0.9),
    "corner_hz": (0.1, 30.0),
    "load_growth": (0.0, 2.0),
    "friction_spread": (0.0, 0.05),
    "friction_drift": (0.0, 0.2),
    "velocity_delay_s": (0.002, 0.02),
    "bandwidth_hz": (2.0, 30.0),
    "friction_scale": (0.3, 3.0),
    "rotor_scale": (0.3, 3.0),
    "gear_scale": (0.3, 3.0),
    "runs": (1, 40),
    "duration_s": (20.0, 3600.0),
    "link_error": (0.0, 0.2),
    "com_error_m": (0.0, 0.02),
}
"""Bounds of all that is a number: a world outside them is none that an arm lives in."""
FULL_CHOICES: dict[str, Choices] = {
    "encoder_at": ("motor", "link"),
    "velocity": ("none", "differenced", "filtered", "true"),
    "feed_forward": ("none", "rigid", "friction"),
    "reference": ("smooth", "jerk", "acceleration"),
    "copied_link": (False, True),
}
"""All that is chosen from a list; robots may be any."""


@dataclass(frozen=True)
class WorldRange:
    """Where worlds are drawn from.

    Attributes:
        name: Of the range.
        about: One line for a person.
        numbers: Bounds by field of `World`; equal bounds fix a value.
        choices: Possible values by field; repeated ones are more likely.
    """

    name: str
    about: str
    numbers: Mapping[str, Bounds]
    choices: Mapping[str, Choices]

    def draw(self, rng: np.random.Generator) -> World:
        """Draws a world. The same generator draws the same place of every range, whatever the others."""
        values: dict[str, Any] = {"name": self.name}
        for field in fields(World):
            place = float(rng.random())
            if field.name in self.choices:
                options = self.choices[field.name]
                values[field.name] = options[min(int(place * len(options)), len(options) - 1)]
            elif field.name in self.numbers:
                values[field.name] = _between(field.name, self.numbers[field.name], place)
        return World(**values)

    def with_values(self, name: str, values: Mapping[str, Any], where: str | Path) -> WorldRange:
        """This range with some fields fixed or bounded anew, as a world's file tells them.

        Raises:
            InputError: An unknown field, or a value outside the bounds of all worlds.
        """
        numbers, choices = dict(self.numbers), dict(self.choices)
        for key, value in values.items():
            if key in FULL_TABLE:
                numbers[key] = _checked_bounds(key, value, where)
            elif key in FULL_CHOICES or key == "robot":
                choices[key] = _checked_choices(key, value, where)
            else:
                known = ", ".join(["preset", "robot", *FULL_TABLE, *FULL_CHOICES])
                raise InputError(where, f"a world has no {key!r}", f"choose from: {known}")
        return replace(self, name=name, about=f"from {Path(str(where)).name}", numbers=numbers, choices=choices)


def _between(name: str, bounds: Bounds, place: float) -> float | int:
    low, high = bounds
    decades = low > 0.0 and high / low > 5.0 and name != "encoder_bits"
    value = low * (high / low) ** place if decades else low + place * (high - low)
    if name in ("encoder_bits", "runs"):
        return round(value)
    if name == "rate_hz" and low != high:
        inside = [rate for rate in RATES_HZ if low <= rate <= high] or [value]
        return min(inside, key=lambda rate: abs(float(np.log(rate / value))))
    return float(f"{value:.4g}")


def _checked_bounds(key: str, value: Any, where: str | Path) -> Bounds:
    pair = value if isinstance(value, list) else [value, value]
    numeric = len(pair) == 2 and all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in pair)
    if not numeric or not pair[0] <= pair[1]:
        raise InputError(where, f"{key} = {value!r}", "give a number, or two in order: [low, high]")
    low, high = FULL_TABLE[key]
    if pair[0] < low or pair[1] > high:
        raise InputError(where, f"{key} = {value!r}", f"choose between {low:g} and {high:g}")
    return pair[0], pair[1]


def _checked_choices(key: str, value: Any, where: str | Path) -> Choices:
    options = tuple(value) if isinstance(value, list) else (value,)
    allowed = FULL_CHOICES.get(key)
    wrong = [one for one in options if (one not in allowed if allowed else not isinstance(one, str))]
    if not options or wrong:
        listed = ", ".join(map(str, allowed)) if allowed else "names of robots"
        raise InputError(where, f"{key} = {value!r}", f"choose from: {listed}")
    return options


def read_world_file(path: Path, presets: Mapping[str, WorldRange]) -> WorldRange:
    """A range of worlds from a TOML file: fields of `World`, and `preset`, the range that it starts from.

    A list of two numbers is a pair of bounds; a list of words is a choice.

    Raises:
        InputError: Not a readable TOML file, an unknown preset or field, or a value out of bounds.
    """
    values = read_toml(path, "give a TOML file of a world")
    preset = values.pop("preset", "any")
    if not isinstance(preset, str) or preset not in presets:
        raise InputError(path, f"unknown preset {preset!r}", f"choose from: {', '.join(presets)}")
    return presets[preset].with_values(path.stem, values, path)
