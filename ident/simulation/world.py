"""A world: what a diagnosis has no right to know of the arm and sensors that made its recordings;
and its arms.

A world holds one value of every property below; a `WorldRange` holds bounds or choices, from which
worlds are drawn: uniformly, or uniformly in the logarithm where the bounds lie far apart. Ranges
are rows of `worlds.toml`. An individual arm of a world has its friction, drives, sensors and
controller, and the noise floor that they leave.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.records import Record
from ident.robot.arm import ArmModel
from ident.safe_read import read_toml
from ident.simulation.hardware import Hardware, draw_hardware
from ident.simulation.laws import change_law, heat_law, plain_friction
from ident.simulation.record import Channels
from ident.simulation.sensing import Sensing
from ident.simulation.simulator import middling_inertia
from ident.trajectories.reference import ReferenceMotion

EncoderSide = Literal["motor", "link"]
VelocityChannel = Literal["none", "differenced", "filtered", "true"]
FeedForward = Literal["none", "rigid", "friction"]
ReferenceShape = Literal["smooth", "jerk", "acceleration"]
SHORTEST_RUN_S = 3.0
# Log rates that controllers and drivers really have [Hz]; a drawn rate is the nearest of them.
RATES_HZ = (30.0, 50.0, 62.5, 100.0, 125.0, 200.0, 240.0, 250.0, 333.0, 500.0, 1000.0)
_TABLES = tomllib.loads(Path(__file__).with_name("worlds.toml").read_text(encoding="utf-8"))
FULL: dict[str, tuple[Any, ...]] = {key: tuple(values) for key, values in _TABLES["full"].items()}
"""Bounds of all that is a number, and choices of the rest: a world outside them is none that an arm
lives in.
"""
GROUPS: dict[str, tuple[str, ...]] = {
    group: tuple(names) for group, names in _TABLES["groups"].items()
}
"""Lists by name; a check takes the worlds of a list in turn."""
# Counts of a sliding joint: its encoder turns once in this travel over two pi [m].
SLIDE_LEVER_M = 0.1
# Largest errors of a mass, whatever is drawn: a link can't weigh nothing.
LEAST_MASS = 0.4
GREATEST_MASS = 2.5
# Share of rated torque that encoder noise may become in the loop: a drive's observer smooths what
# it feeds back.
LOOP_NOISE = 0.002
# Bandwidths between which a diagnosis can choose [Hz]; the upper is below any structure's
# resonance.
LEAST_BAND_HZ = 2.0
GREATEST_BAND_HZ = 25.0


@dataclass(frozen=True)
class World(Record):
    """One world."""

    name: str  # of the range that it was drawn from
    robot: str  # URDF path or name
    # standard deviation of a position reading before it is rounded [rad at the joint]
    encoder_noise_rad: float
    encoder_bits: int  # a turn of the encoder has two to this many counts
    encoder_at: EncoderSide  # whether the encoder that is logged sits on the motor or on the link
    rate_hz: float  # log rate [Hz]
    # largest deviation of a sample's instant from the even grid, as a share of the interval
    jitter: float
    lost: float  # share of samples that are missing
    # standard deviation of an unloaded joint's torque reading, as a share of rated torque
    torque_noise: float
    coloured_share: float  # share of that variance which is coloured; the rest is white
    corner_hz: float  # corner frequency of the coloured part [Hz]
    load_growth: float  # relative growth of the noise from no torque to rated torque
    friction_spread: float  # standard deviation of the relative change of friction from run to run
    # standard deviation of its relative change that has gathered by the session's end
    friction_drift: float
    # none, differences of the logged positions, the firmware's filter, or the truth
    velocity: VelocityChannel
    velocity_delay_s: float  # how late the firmware's filter is [s]
    bandwidth_hz: float  # of the position loop [Hz]
    # what the controller adds: gravity alone (`none`), the rigid model, or that and friction
    feed_forward: FeedForward
    # whether the reference is smooth, or has steps of jerk or of acceleration
    reference: ReferenceShape
    friction_scale: float  # factors on what an arm of this size usually has
    rotor_scale: float
    gear_scale: float
    runs: int  # number of runs
    duration_s: float  # of all of them together, roughly [s]
    link_error: float  # standard deviation of the relative error of the URDF's masses and inertias
    com_error_m: float  # root mean square distance of the centres of mass from the URDF's [m]
    copied_link: bool  # whether one link of the URDF has the mass of its neighbour

    @property
    def run_duration_s(self) -> float:
        """Rough duration of a run [s]."""
        return max(self.duration_s / max(self.runs, 1), SHORTEST_RUN_S)


@dataclass(frozen=True)
class WorldRange:
    """Where worlds are drawn from."""

    name: str
    about: str  # one line for a person
    # by field of `World`, two bounds of a number or what is chosen from
    values: Mapping[str, tuple[Any, ...]]

    def draw(self, rng: np.random.Generator) -> World:
        """Draws a world.

        The same generator draws the same place of every range, whatever the others.
        """
        places = {field.name: float(rng.random()) for field in fields(World)}
        drawn = {key: draw_value(key, options, places[key]) for key, options in self.values.items()}
        return World(**{**drawn, "name": self.name})

    def with_values(self, name: str, values: Mapping[str, Any], where: str | Path) -> WorldRange:
        """This range with some fields fixed or bounded anew, as a world's file tells them.

        Raises:
            InputError: An unknown field, or a value outside the bounds of all worlds.
        """
        checked: dict[str, tuple[Any, ...]] = {}
        for key, value in values.items():
            if key not in ("robot", *FULL):
                known = ", ".join(["preset", "robot", *FULL])
                raise InputError(where, f"a world has no {key!r}", f"choose from: {known}")
            if _is_choice(key):
                options = tuple(value) if isinstance(value, list) else (value,)
                remedy = _wrong_choice(key, options)
            else:
                options = tuple(value) if isinstance(value, list) else (value, value)
                remedy = _wrong_bounds(key, options)
            if remedy:
                raise InputError(where, f"{key} = {value!r}", remedy)
            checked[key] = options
        return replace(
            self,
            name=name,
            about=f"from {Path(str(where)).name}",
            values={**self.values, **checked},
        )


def _is_choice(name: str) -> bool:
    return name == "robot" or isinstance(FULL[name][0], str | bool)


def _wrong_choice(name: str, options: tuple[object, ...]) -> str:
    """What to give instead of some choices; nothing where they are right."""
    allowed = FULL.get(name)
    if allowed is None:
        right = all(isinstance(option, str) for option in options)
    else:
        right = all(option in allowed for option in options)
    if options and right:
        return ""
    known = "names of robots" if allowed is None else ", ".join(map(str, allowed))
    return f"choose from: {known}"


def _wrong_bounds(name: str, bounds: tuple[Any, ...]) -> str:
    """What to give instead of two bounds; nothing where they are right."""
    numeric = [isinstance(end, int | float) and not isinstance(end, bool) for end in bounds]
    if len(bounds) != 2 or not all(numeric) or not bounds[0] <= bounds[1]:
        return "give a number, or two in order: [low, high]"
    least, most = FULL[name]
    if bounds[0] < least or bounds[1] > most:
        return f"choose between {least:g} and {most:g}"
    return ""


def draw_value(name: str, options: tuple[Any, ...], place: float) -> Any:
    """What stands at a place between 0 and 1 of some choices, or between two bounds."""
    if _is_choice(name):
        return options[min(int(place * len(options)), len(options) - 1)]
    low, high = options
    decades = low > 0.0 and high / low > 5.0 and name != "encoder_bits"
    value = low + place * (high - low)
    if decades:
        value = low * (high / low) ** place
    if name in ("encoder_bits", "runs"):
        return round(value)
    if name == "rate_hz" and low != high:
        inside = [rate for rate in RATES_HZ if low <= rate <= high] or [value]
        return min(inside, key=lambda rate: abs(float(np.log(rate / value))))
    return float(f"{value:.4g}")


PRESETS: dict[str, WorldRange] = {}
for _name, _row in _TABLES["presets"].items():  # a row changes what it starts from
    _changes = dict(_row)
    _about = _changes.pop("about")
    _sound = _TABLES["sound"] if _changes.pop("sound", False) else {}
    _bounds = {**_TABLES["full"], **_TABLES["start"], **_sound, **_changes}
    _values = {key: tuple(ends) for key, ends in _bounds.items()}
    PRESETS[_name] = WorldRange(_name, _about, _values)
"""Ranges by name: what goes together in real cells, and `any`, where nothing does."""


def find_world(name: str | Path) -> WorldRange:
    """A range by its preset's name, or from a TOML file: fields of `World`, and `preset`, which it
    starts from.

    In a file a list of two numbers is a pair of bounds; a list of words is a choice.

    Raises:
        InputError: Neither, not a readable TOML file, an unknown preset or field, or a value out of
            bounds.
    """
    path = Path(name)
    listed = ", ".join(PRESETS)
    if str(name) in PRESETS:
        return PRESETS[str(name)]
    if path.suffix != ".toml" and not path.is_file():
        remedy = f"give a TOML file or one of: {listed}"
        raise InputError("--world", f"unknown world {str(name)!r}", remedy)
    values = read_toml(path, "give a TOML file of a world")
    preset = values.pop("preset", "any")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise InputError(path, f"unknown preset {preset!r}", f"choose from: {listed}")
    return PRESETS[preset].with_values(path.stem, values, path)


def find_worlds(text: str) -> tuple[WorldRange, ...]:
    """Ranges of a comma-separated list of presets, files and groups; `-NAME` takes one out of what
    stands before.

    Raises:
        InputError: An unknown name, or nothing left.
    """
    chosen: list[WorldRange] = []
    for word in filter(None, (word.strip() for word in text.split(","))):
        if word.startswith("-"):
            gone = find_world(word[1:]).name
            chosen = [world for world in chosen if world.name != gone]
        else:
            chosen += [find_world(name) for name in GROUPS.get(word, (word,))]
    if not chosen:
        remedy = f"choose from: {', '.join([*GROUPS, *PRESETS])}"
        raise InputError("--worlds", f"{text!r} names no world", remedy)
    return tuple(chosen)


def settle(worlds: WorldRange, seed: int, **asked: Any) -> World:
    """Draws the world of one session; what the user asks for beside it holds: the `robot`, the
    number of `runs`, their rough `duration` [s], the log `rate` [Hz], and whether there is a
    `velocity` channel.
    """
    world = worlds.draw(np.random.default_rng([seed, 6]))
    asked = {key: value for key, value in asked.items() if value is not None}
    given = {}
    for field, name in (("robot", "robot"), ("runs", "runs"), ("rate_hz", "rate")):
        if name in asked:
            given[field] = asked[name]
    if "duration" in asked:
        given["duration_s"] = asked["duration"] * asked.get("runs", world.runs)
    if "velocity" in asked and asked["velocity"] != (world.velocity != "none"):
        given["velocity"] = "true" if asked["velocity"] else "none"
    return replace(world, **given)


def draw_world_arm(arm: ArmModel, world: World, rng: np.random.Generator) -> Hardware:
    """Draws an individual arm of a world, before anything of the catalogue is wrong."""
    usual = draw_hardware(arm, rng, world.link_error)
    n = usual.n
    friction = usual.friction
    bodies = usual.bodies
    mass = np.array(bodies.mass_scale)
    if world.copied_link and n > 1:
        masses = np.array([body.mass for body in arm.model.inertias])[1:]
        link = int(rng.integers(1, n))
        mass[link] *= masses[link - 1] / max(masses[link], 1e-3)
    coulomb = world.friction_scale * friction.coulomb
    viscous = world.friction_scale * friction.viscous
    rotor = world.rotor_scale * usual.drive.rotor_inertia
    ratio = world.gear_scale * usual.drive.ripple_order / 2.0
    rated = usual.sensing.rated
    lever = np.where(arm.sliding_joints, SLIDE_LEVER_M, 1.0)
    turns = ratio if world.encoder_at == "motor" else np.ones_like(ratio)
    count = 2.0 * np.pi * lever / (2.0**world.encoder_bits * turns)
    noise = world.torque_noise * rated
    sensing = Sensing.typical(rated, ratio).replace(
        white=noise * np.sqrt(1.0 - world.coloured_share),
        coloured=noise * np.sqrt(world.coloured_share),
        corner_hz=world.corner_hz,
        load_growth=world.load_growth,
        count=count,
        count_noise=world.encoder_noise_rad * lever / count,
        link_side=world.encoder_at == "link",
    )
    return usual.replace(
        bodies=bodies.replace(
            mass_scale=np.clip(mass, LEAST_MASS, GREATEST_MASS),
            inertia_scale=np.clip(bodies.inertia_scale, LEAST_MASS, GREATEST_MASS),
            com_shift=world.com_error_m / np.sqrt(3.0) * rng.standard_normal((n, 3)),
        ),
        friction=plain_friction(coulomb, viscous, rotor),
        drive=change_law(usual.drive, rotor_inertia=rotor, ripple_order=2.0 * ratio),
        heat=heat_law(coulomb * 0.6 + viscous * 0.6**2),
        sensing=sensing,
        bandwidth=2.0 * np.pi * world.bandwidth_hz,
        friction_spread=0.0,
        feed_forward=world.feed_forward,
        loop_noise=LOOP_NOISE,
    )


def channels_of(world: World, commands: bool = True, temperature: bool = False) -> Channels:
    """What a world's log holds."""
    has_velocity = world.velocity != "none"
    return Channels(
        world.rate_hz,
        has_velocity,
        commands,
        temperature,
        world.velocity,
        world.velocity_delay_s,
        world.jitter,
        world.lost,
    )


def friction_path(
    world: World,
    n: int,
    motions: Sequence[ReferenceMotion],
    pauses: Sequence[float],
    rng: np.random.Generator,
) -> Float[Array, "R 2 n"]:
    """Factors on dry and viscous friction of each run: its own change, and a drift that gathers as
    a random walk.
    """
    runs = zip(pauses, motions, strict=True)
    spans = np.array([pause + motion.duration for pause, motion in runs])
    gathered = np.sqrt(spans / spans.sum())
    steps = rng.standard_normal((len(spans), 1, n)) * gathered[:, None, None]
    walk = np.cumsum(steps, axis=0)
    scatter = rng.standard_normal((len(spans), 2, n))
    return np.exp(world.friction_spread * scatter + world.friction_drift * walk)


def noise_floor(
    hardware: Hardware, world: World, motions: Sequence[ReferenceMotion]
) -> Float[Array, " n"]:
    """What the best model leaves at each joint in this world [N m].

    Three parts: the noise of the torque reading; encoder noise, differentiated twice and multiplied
    by the joint's inertia, in the band in which it is smaller than the torque's noise; and friction
    that changes from run to run.
    """
    disturbance = _disturbance(hardware)
    band = usable_band(hardware, world)
    accelerating = 2.0 * disturbance**2 / world.rate_hz * (2.0 * np.pi) ** 4 * band**5 / 5.0
    squares = [np.mean(motion.dq**2, axis=0) for motion in motions]
    speed = np.sqrt(np.mean(squares, axis=0))
    change = np.hypot(world.friction_spread, world.friction_drift / np.sqrt(2.0))
    rubbing = change * np.hypot(hardware.friction.coulomb, hardware.friction.viscous * speed)
    return np.sqrt(hardware.sensing.noise_floor**2 + accelerating + rubbing**2)


def _disturbance(hardware: Hardware) -> Float[Array, " n"]:
    """Inertia of each joint at a middling pose times the deviation of its encoder's reading,
    rounded [N m s²].
    """
    count = hardware.sensing.count
    noise = np.hypot(hardware.sensing.count_noise * count, count / np.sqrt(12.0))
    return np.asarray(middling_inertia(hardware) * noise)


def usable_band(hardware: Hardware, world: World) -> Float[Array, " n"]:
    """Frequency at each joint where encoder noise, as torque, becomes as strong as the torque's
    noise [Hz].
    """
    highest = max(min(GREATEST_BAND_HZ, 0.4 * world.rate_hz), LEAST_BAND_HZ)
    f = np.geomspace(LEAST_BAND_HZ, highest, 200)
    torque, encoder = _densities(hardware, world, f)
    below = (encoder < torque).sum(axis=0)
    return f[np.clip(below - 1, 0, len(f) - 1)]


def _densities(
    hardware: Hardware, world: World, frequencies: Float[Array, " F"]
) -> tuple[Array, Array]:
    """Spectral densities, one-sided, of an unloaded joint's torque noise, and of what encoder noise
    becomes as torque of inertia [(N m)²/Hz]; shape (F, n) each.
    """
    f = frequencies[:, None]
    sensing = hardware.sensing
    corner = sensing.corner_hz
    coloured = sensing.coloured**2 * (2.0 / np.pi) * corner / (corner**2 + f**2)
    white = 2.0 * sensing.white**2 / world.rate_hz
    in_radians = 2.0 * np.pi * f
    encoder = 2.0 * _disturbance(hardware) ** 2 / world.rate_hz * in_radians**4
    return white + coloured, encoder


def noise_density(
    hardware: Hardware, world: World, frequencies: Float[Array, " F"]
) -> Float[Array, "F n"]:
    """Spectral density, one-sided, of all noise in a torque residual [(N m)²/Hz].

    Above half of the log rate nothing is seen: the density there is without bound.
    """
    torque, encoder = _densities(hardware, world, np.asarray(frequencies, dtype=float))
    return np.where(frequencies[:, None] <= 0.5 * world.rate_hz, torque + encoder, np.inf)
