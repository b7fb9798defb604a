"""An individual arm of a world: its friction, drives, sensors and controller, and the noise floor that they leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from ident.simulation.friction import plain_friction
from ident.simulation.hardware import Hardware, draw_hardware
from ident.simulation.laws import change_law
from ident.simulation.mjcf import Bodies
from ident.simulation.record import Channels
from ident.simulation.sensing import Sensing
from ident.simulation.simulator import mass_matrix
from ident.simulation.thermal import heat_law
from ident.simulation.world import World
from ident.trajectories.reference import ReferenceMotion

# Counts of a sliding joint: its encoder turns once in this travel over two pi [m].
SLIDE_LEVER_M = 0.1
# Largest errors of a mass, whatever is drawn: a link can't weigh nothing.
LEAST_MASS, GREATEST_MASS = 0.4, 2.5
# Share of rated torque that encoder noise may become in the loop: a drive's observer smooths what it feeds back.
LOOP_NOISE = 0.002
# Bandwidths between which a diagnosis can choose [Hz]; the upper is below any structure's resonance.
LEAST_BAND_HZ, GREATEST_BAND_HZ = 2.0, 25.0


def draw_world_arm(arm: ArmModel, world: World, rng: np.random.Generator) -> Hardware:
    """Draws an individual arm of a world, before anything of the catalogue is wrong."""
    usual = draw_hardware(arm, rng, world.link_error)
    own = usual.friction
    coulomb, viscous = world.friction_scale * own.coulomb, world.friction_scale * own.viscous
    rotor = world.rotor_scale * usual.drive.rotor_inertia
    sliding = arm.sliding_joints
    ratio = world.gear_scale * usual.drive.ripple_order / 2.0
    return usual.replace(
        bodies=_bodies(usual, world, rng),
        friction=plain_friction(coulomb, viscous, rotor),
        drive=change_law(usual.drive, rotor_inertia=rotor, ripple_order=2.0 * ratio),
        heat=heat_law(coulomb * 0.6 + viscous * 0.6**2),
        sensing=_sensing(usual.sensing.rated, ratio, sliding, world),
        bandwidth=2.0 * np.pi * world.bandwidth_hz,
        friction_spread=0.0,
        feed_forward=world.feed_forward,
        loop_noise=LOOP_NOISE,
    )


def _bodies(usual: Hardware, world: World, rng: np.random.Generator) -> Bodies:
    n, bodies = usual.n, usual.bodies
    mass = np.array(bodies.mass_scale)
    if world.copied_link and n > 1:
        masses = np.array([body.mass for body in usual.arm.model.inertias])[1:]
        link = int(rng.integers(1, n))
        mass[link] *= masses[link - 1] / max(masses[link], 1e-3)
    shift = world.com_error_m / np.sqrt(3.0) * rng.standard_normal((n, 3))
    return bodies.replace(
        mass_scale=np.clip(mass, LEAST_MASS, GREATEST_MASS),
        inertia_scale=np.clip(bodies.inertia_scale, LEAST_MASS, GREATEST_MASS),
        com_shift=shift,
    )


def _sensing(rated: Float[Array, " n"], ratio: Float[Array, " n"], sliding: Array, world: World) -> Sensing:
    lever = np.where(sliding, SLIDE_LEVER_M, 1.0)
    turns = ratio if world.encoder_at == "motor" else np.ones_like(ratio)
    count = 2.0 * np.pi * lever / (2.0**world.encoder_bits * turns)
    noise = world.torque_noise * rated
    return Sensing.typical(rated, ratio).replace(
        white=noise * np.sqrt(1.0 - world.coloured_share),
        coloured=noise * np.sqrt(world.coloured_share),
        corner_hz=world.corner_hz,
        load_growth=world.load_growth,
        count=count,
        count_noise=world.encoder_noise_rad * lever / count,
        link_side=world.encoder_at == "link",
    )


def channels_of(world: World, commands: bool = True, temperature: bool = False) -> Channels:
    """What a world's log holds."""
    velocity = world.velocity != "none"
    kind = world.velocity if world.velocity != "none" else "estimate"
    return Channels(
        world.rate_hz, velocity, commands, temperature, kind, world.velocity_delay_s, world.jitter, world.lost
    )


def friction_path(
    world: World, n: int, motions: Sequence[ReferenceMotion], pauses: Sequence[float], rng: np.random.Generator
) -> Float[Array, "R 2 n"]:
    """Factors on dry and viscous friction of each run: its own change, and a drift that gathers as a random walk."""
    spans = np.array([pause + motion.duration for pause, motion in zip(pauses, motions, strict=True)])
    gathered = spans / spans.sum()
    walk = np.cumsum(rng.standard_normal((len(spans), 1, n)) * np.sqrt(gathered)[:, None, None], axis=0)
    own = rng.standard_normal((len(spans), 2, n))
    return np.exp(world.friction_spread * own + world.friction_drift * walk)


def noise_floor(hardware: Hardware, world: World, motions: Sequence[ReferenceMotion]) -> Float[Array, " n"]:
    """What the best model leaves at each joint in this world [N m].

    Three parts: the noise of the torque reading; encoder noise, differentiated twice and multiplied by the joint's
    inertia, in the band in which it is smaller than the torque's noise; and friction that changes from run to run.
    """
    disturbance, band = _disturbance(hardware), usable_band(hardware, world)
    accelerating = 2.0 * disturbance**2 / world.rate_hz * (2.0 * np.pi) ** 4 * band**5 / 5.0
    speed = np.sqrt(np.mean([np.mean(motion.dq**2, axis=0) for motion in motions], axis=0))
    change = np.hypot(world.friction_spread, world.friction_drift / np.sqrt(2.0))
    rubbing = change * np.hypot(hardware.friction.coulomb, hardware.friction.viscous * speed)
    return np.sqrt(hardware.sensing.noise_floor**2 + accelerating + rubbing**2)


def encoder_noise(hardware: Hardware) -> Float[Array, " n"]:
    """Standard deviation of a position reading, its rounding with it [rad or m]."""
    count = hardware.sensing.count
    return np.hypot(hardware.sensing.count_noise * count, count / np.sqrt(12.0))


def _disturbance(hardware: Hardware) -> Float[Array, " n"]:
    """Inertia of each joint at a middling pose times its encoder's noise [N m s²]."""
    pose = np.clip(np.full(hardware.n, 0.6), hardware.arm.lower, hardware.arm.upper)
    inertia = np.diag(mass_matrix(hardware, pose)) + hardware.drive.rotor_inertia
    return np.asarray(inertia * encoder_noise(hardware))


def usable_band(hardware: Hardware, world: World) -> Float[Array, " n"]:
    """Frequency at each joint where encoder noise, as torque, becomes as strong as the torque's noise [Hz]."""
    highest = max(min(GREATEST_BAND_HZ, 0.4 * world.rate_hz), LEAST_BAND_HZ)
    f = np.geomspace(LEAST_BAND_HZ, highest, 200)[:, None]
    torque, encoder = _torque_density(hardware, world, f), _encoder_density(hardware, world, f)
    below = (encoder < torque).sum(axis=0)
    return f[np.clip(below - 1, 0, len(f) - 1), 0]


def _torque_density(hardware: Hardware, world: World, f: Float[Array, "F 1"]) -> Float[Array, "F n"]:
    """Spectral density, one-sided, of an unloaded joint's torque noise [(N m)²/Hz]."""
    sensing, corner = hardware.sensing, hardware.sensing.corner_hz
    white = 2.0 * sensing.white**2 / world.rate_hz
    return np.asarray(white + sensing.coloured**2 * (2.0 / np.pi) * corner / (corner**2 + f**2))


def _encoder_density(hardware: Hardware, world: World, f: Float[Array, "F 1"]) -> Float[Array, "F n"]:
    """Spectral density, one-sided, of what encoder noise becomes as torque of inertia [(N m)²/Hz]."""
    return np.asarray(2.0 * _disturbance(hardware) ** 2 / world.rate_hz * (2.0 * np.pi * f) ** 4)


def noise_density(hardware: Hardware, world: World, frequencies: Float[Array, " F"]) -> Float[Array, "F n"]:
    """Spectral density, one-sided, of all noise in a torque residual [(N m)²/Hz].

    Above half of the log rate nothing is seen: the density there is without bound.
    """
    f = np.asarray(frequencies, dtype=float)[:, None]
    density = _torque_density(hardware, world, f) + _encoder_density(hardware, world, f)
    return np.where(f <= 0.5 * world.rate_hz, density, np.inf)
