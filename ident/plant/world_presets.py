"""Named ranges of worlds: what goes together in real cells, and `any`, where nothing does.

Bounds are chosen within the full table, so that between them the presets cover it; a servo that is cheap is cheap in
everything. `ours` is the world of `ident simulate` without a world.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.plant.world import FULL_CHOICES, FULL_TABLE, Bounds, Choices, World, WorldRange, read_world_file

ARMS = ("tm5-900", "tm5-900", "ur5", "ur10", "panda", "kinova", "scara")
"""Arms of worlds that do not name one; the TM5-900 is twice as likely as any other."""
# Sessions of a check stay short, or hundreds of them take days [s].
CHECK_DURATION_S = 30.0, 160.0


def _range(name: str, about: str, **changes: Bounds | Choices) -> WorldRange:
    numbers = {**FULL_TABLE, "duration_s": CHECK_DURATION_S}
    choices = {**FULL_CHOICES, "robot": ARMS, "copied_link": (False,) * 9 + (True,)}
    for key, value in changes.items():
        if key in FULL_TABLE:
            numbers[key] = value
        else:
            choices[key] = tuple(value)
    return WorldRange(name, about, numbers, choices)


def _sound(name: str, about: str, **changes: Bounds | Choices) -> WorldRange:
    """A range of well-kept arms, but for what is changed."""
    usual: dict[str, Bounds | Choices] = {
        "encoder_noise_rad": (2e-6, 4e-5),
        "encoder_bits": (17, 22),
        "rate_hz": (100.0, 500.0),
        "jitter": (0.0, 0.03),
        "lost": (0.0, 0.002),
        "torque_noise": (1.5e-3, 6e-3),
        "coloured_share": (0.2, 0.8),
        "corner_hz": (2.0, 20.0),
        "friction_spread": (0.0, 0.015),
        "friction_drift": (0.0, 0.03),
        "bandwidth_hz": (6.0, 20.0),
        "friction_scale": (0.6, 1.7),
        "rotor_scale": (0.6, 1.7),
        "gear_scale": (0.7, 1.6),
        "runs": (6, 14),
        "duration_s": (50.0, 110.0),
        "link_error": (0.0, 0.05),
        "com_error_m": (0.0, 0.004),
        "copied_link": (False,),
    }
    return _range(name, about, **{**usual, **changes})


PRESETS: dict[str, WorldRange] = {
    one.name: one
    for one in (
        _sound(
            "ours",
            "the arm and sensors of ident simulate",
            robot=("tm5-900",),
            encoder_noise_rad=(1e-6, 1e-6),
            encoder_bits=(16, 16),
            encoder_at=("motor",),
            rate_hz=(250.0, 250.0),
            jitter=(0.0, 0.0),
            lost=(0.0, 0.0),
            torque_noise=(2.5e-3, 2.5e-3),
            coloured_share=(0.64, 0.64),
            corner_hz=(15.0, 15.0),
            load_growth=(1.0, 1.0),
            friction_spread=(0.01, 0.01),
            friction_drift=(0.0, 0.0),
            velocity=("true",),
            bandwidth_hz=(12.7, 12.7),
            feed_forward=("rigid",),
            reference=("smooth",),
            friction_scale=(1.0, 1.0),
            rotor_scale=(1.0, 1.0),
            gear_scale=(1.0, 1.0),
            runs=(10, 10),
            duration_s=(80.0, 80.0),
            link_error=(0.03, 0.03),
        ),
        _sound(
            "fine-encoder",
            "laboratory arms: fine encoders, quick logs, little noise",
            encoder_noise_rad=(1e-6, 5e-6),
            encoder_bits=(20, 24),
            rate_hz=(250.0, 1000.0),
            torque_noise=(5e-4, 3e-3),
            bandwidth_hz=(10.0, 30.0),
            velocity=("filtered", "true"),
            feed_forward=("rigid", "friction"),
        ),
        _sound(
            "industrial",
            "arms of factories and their controllers' logs",
            encoder_at=("motor",),
            rate_hz=(100.0, 250.0),
            feed_forward=("rigid", "friction"),
            reference=("jerk", "acceleration"),
            velocity=("none", "differenced", "filtered"),
        ),
        _sound(
            "industrial-30Hz",
            "the same arms, seen through a slow status port",
            encoder_at=("motor",),
            rate_hz=(30.0, 30.0),
            jitter=(0.0, 0.15),
            lost=(0.0, 0.02),
            bandwidth_hz=(10.0, 30.0),
            feed_forward=("rigid", "friction"),
            reference=("jerk",),
            velocity=("none", "differenced"),
            duration_s=(80.0, 200.0),
        ),
        _sound(
            "noisy-torque",
            "drives whose current is a rough guess of the torque",
            torque_noise=(0.012, 0.03),
            coloured_share=(0.3, 0.9),
            corner_hz=(0.1, 5.0),
            load_growth=(0.5, 2.0),
        ),
        _sound(
            "noisy-encoder",
            "coarse encoders on an otherwise sound arm",
            encoder_noise_rad=(5e-5, 1e-3),
            encoder_bits=(12, 17),
            encoder_at=("link",),
        ),
        _sound(
            "drifting-friction",
            "gears that run differently every time, and drift",
            friction_spread=(0.02, 0.05),
            friction_drift=(0.08, 0.2),
            friction_scale=(1.0, 3.0),
        ),
        _sound(
            "wrong-urdf",
            "arms whose description was drawn, not weighed",
            link_error=(0.08, 0.2),
            com_error_m=(0.008, 0.02),
            copied_link=(False, True),
        ),
        _sound(
            "loose-loop",
            "soft controllers that follow late",
            bandwidth_hz=(2.0, 5.0),
            feed_forward=("none", "rigid"),
            reference=("acceleration", "jerk"),
        ),
        _sound("short", "a few runs and no more", runs=(1, 4), duration_s=(20.0, 45.0)),
        _sound(
            "scara",
            "a four-joint arm with a sliding joint",
            robot=("scara",),
            rate_hz=(100.0, 1000.0),
            bandwidth_hz=(8.0, 30.0),
        ),
        _range(
            "cheap-servo",
            "cheap drives: coarse, noisy, late, uneven",
            encoder_noise_rad=(8e-5, 5e-4),
            encoder_bits=(14, 16),
            encoder_at=("link",),
            rate_hz=(50.0, 200.0),
            jitter=(0.05, 0.2),
            lost=(0.0, 0.02),
            torque_noise=(8e-3, 0.03),
            coloured_share=(0.2, 0.8),
            corner_hz=(0.5, 10.0),
            friction_spread=(0.01, 0.05),
            friction_drift=(0.0, 0.1),
            velocity=("none", "filtered"),
            bandwidth_hz=(3.0, 8.0),
            feed_forward=("none", "rigid"),
            friction_scale=(1.0, 3.0),
            gear_scale=(1.0, 3.0),
            link_error=(0.03, 0.12),
            com_error_m=(0.002, 0.012),
        ),
        _range(
            "hobby",
            "an arm from a kit",
            encoder_noise_rad=(3e-4, 1e-3),
            encoder_bits=(12, 12),
            encoder_at=("link",),
            rate_hz=(30.0, 100.0),
            jitter=(0.1, 0.2),
            lost=(0.005, 0.02),
            torque_noise=(0.01, 0.03),
            coloured_share=(0.3, 0.9),
            corner_hz=(0.1, 3.0),
            friction_spread=(0.02, 0.05),
            friction_drift=(0.05, 0.2),
            velocity=("none", "differenced"),
            bandwidth_hz=(2.0, 5.0),
            feed_forward=("none",),
            friction_scale=(1.5, 3.0),
            link_error=(0.05, 0.2),
            com_error_m=(0.005, 0.02),
        ),
        _range("any", "everything drawn on its own over the full table"),
    )
}
"""Ranges by name."""
DEVELOPMENT = ("ours", "fine-encoder", "industrial", "noisy-encoder", "drifting-friction", "cheap-servo", "scara")
QUOTED = tuple(name for name in PRESETS if name not in (*DEVELOPMENT, "any"))
GROUPS: dict[str, tuple[str, ...]] = {
    # Half of all cases of a check are of no preset.
    "all": tuple(name for preset in PRESETS if preset not in ("any", "ours") for name in (preset, "any")),
    "development": DEVELOPMENT,
    "quoted": QUOTED,
}
"""Lists by name; a check takes the worlds of a list in turn. `development` and `quoted` have none in common."""


def find_world(name: str | Path) -> WorldRange:
    """A range by its preset's name or from a TOML file.

    Raises:
        InputError: Neither.
    """
    if str(name) in PRESETS:
        return PRESETS[str(name)]
    path = Path(name)
    if path.suffix == ".toml" or path.is_file():
        return read_world_file(path, PRESETS)
    listed = ", ".join(PRESETS)
    raise InputError("--world", f"unknown world {str(name)!r}", f"give a TOML file or one of: {listed}")


def find_worlds(text: str) -> tuple[WorldRange, ...]:
    """Ranges of a comma-separated list of presets, files and groups; `-NAME` takes one out of what stands before.

    Raises:
        InputError: An unknown name, or nothing left.
    """
    chosen: list[WorldRange] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        if part.startswith("-"):
            gone = find_world(part[1:]).name
            chosen = [one for one in chosen if one.name != gone]
        else:
            chosen += [find_world(name) for name in GROUPS.get(part, (part,))]
    if not chosen:
        raise InputError("--worlds", f"{text!r} names no world", f"choose from: {', '.join([*GROUPS, *PRESETS])}")
    return tuple(chosen)


def settle(
    worlds: WorldRange,
    seed: int,
    robot: str | None = None,
    runs: int | None = None,
    run_duration: float | None = None,
    rate: float | None = None,
    velocity: bool | None = None,
) -> World:
    """Draws the world of one session; what the user asks for beside it holds.

    Args:
        worlds: Where from.
        seed: Of the session.
        robot, runs, rate: Instead of the world's own, where given; the rate in Hz.
        run_duration: Rough duration of a run [s].
        velocity: Whether there is a velocity channel.
    """
    world = worlds.draw(np.random.default_rng([seed, 6]))
    world = replace(
        world,
        robot=world.robot if robot is None else robot,
        runs=world.runs if runs is None else runs,
        rate_hz=world.rate_hz if rate is None else rate,
    )
    if run_duration is not None:
        world = replace(world, duration_s=run_duration * world.runs)
    if velocity is not None:
        own = world.velocity if world.velocity != "none" else "true"
        world = replace(world, velocity=own if velocity else "none")
    return world
