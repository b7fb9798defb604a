"""What is drawn: a world, an arm's losses, a hidden effect."""

from dataclasses import dataclass, field

import numpy as np

from ident.effects.catalogue import CATALOGUE

SIZES = (0.3, 1.0, 3.0)
DRAWN = tuple(effect.id for effect in CATALOGUE)
OUTSIDE = ("cable_at_the_end", "seal_after_rest", "floor_vibration", "squared_of_neighbour")
WHOLE_ARM = ("payload", "gravity_misalignment", "torque_delay")


@dataclass(frozen=True)
class World:
    """What a diagnosis has no right to know."""

    rate: float
    encoder_noise: float
    bits: int
    torque_noise: np.ndarray
    coloured: float
    between_runs: float
    bandwidth: float
    links_off: float
    velocity: str
    runs: int
    seconds: float


@dataclass(frozen=True)
class Arm:
    """The true arm's losses, by joint."""

    coulomb: np.ndarray
    viscous: np.ndarray
    rotor: np.ndarray
    rated: np.ndarray
    bristle: np.ndarray


@dataclass(frozen=True)
class Effect:
    """One hidden effect: `size` is its free amount, `figures` fix its shape."""

    name: str
    joint: int
    size: float
    figures: dict[str, float] = field(default_factory=dict)


def draw_world(rated: np.ndarray, rng: np.random.Generator) -> World:
    return World(
        rate=float(rng.choice([100, 125, 250, 500])),
        encoder_noise=float(10 ** rng.uniform(-5.3, -4.0)),
        bits=int(rng.integers(17, 22)),
        torque_noise=rated * 10 ** rng.uniform(-2.7, -2.1) * rng.uniform(0.7, 1.4, len(rated)),
        coloured=float(rng.uniform(2, 20)),
        between_runs=float(rng.choice([0.0, 0.01, 0.02])),
        bandwidth=float(rng.uniform(4, 10)),
        links_off=float(rng.choice([0.0, 0.0, 0.02, 0.04])),
        velocity=str(rng.choice(["none", "differenced", "true"])),
        runs=int(rng.integers(6, 12)),
        seconds=float(rng.uniform(8, 14)),
    )


def draw_arm(text: str, rated: np.ndarray, rng: np.random.Generator) -> Arm:
    n = len(rated)
    share = 10 ** rng.uniform(-1.7, -1.2)
    return Arm(
        coulomb=rated * share * rng.uniform(0.7, 1.3, n),
        viscous=rated * share * rng.uniform(0.6, 1.4, n),
        rotor=rated * 0.006 * rng.uniform(0.7, 1.3, n),
        rated=rated,
        bristle=10 ** rng.uniform(-4.0, -3.3, n),
    )


def draw_effect(name: str, arm: Arm, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> Effect:
    """An effect of ordinary size; whole-arm ones have joint -1."""
    n = len(low)
    j = int(rng.integers(n))
    fc = float(arm.coulomb[j])
    ways = rng.standard_normal(3)
    x, y, z = (float(one) for one in ways / np.linalg.norm(ways))
    spot = {"x": x, "y": y, "z": z}
    if name in WHOLE_ARM:
        j = -1
    if name == "link_inertial_error":
        j = int(rng.integers(1, n))
    if name == "external_contact":
        j = int(rng.integers(2, n))
    others = [i for i in (j - 1, j + 1) if 0 <= i < n]
    drawn: dict[str, tuple[float, dict[str, float]]] = {
        "stribeck_friction": (0.4 * fc, {"vs": float(rng.uniform(0.02, 0.15)), "delta": float(rng.integers(1, 3))}),
        "nonlinear_viscous_friction": (0.5 * fc, {"power": float(rng.choice([0.3, 0.5, 0.7, 2.0]))}),
        "load_dependent_friction": (0.06, {}),
        "thermal_friction": (0.4, {"tau": float(rng.uniform(60, 400))}),
        "presliding_hysteresis": (0.6 * fc, {"reach": float(10 ** rng.uniform(-2.7, -1.5))}),
        "position_dependent_friction": (0.2, {"k": float(rng.integers(1, 3)), "phi": float(rng.uniform(0, 6.28))}),
        "asymmetric_friction": (0.1, {}),
        "joint_coupling": (0.4 * fc, {"other": float(rng.choice(others)), "sum": float(rng.integers(2))}),
        "joint_elasticity": (1.0 / (60.0 * float(arm.rated[j])), {}),
        "backlash": (2e-3, {"K": 200.0 * float(arm.rated[j])}),
        "torque_ripple": (0.01 * float(arm.rated[j]), {"order": float(rng.choice([12, 24, 50, 100])), "phi": 1.0}),
        "spring_torque": (
            0.01 * float(arm.rated[j]),
            {"rest": 0.5 * float(low[j] + high[j]) + float(rng.uniform(-0.5, 0.5))},
        ),
        "payload": (0.01 * float(arm.rated[1]), {"x": 0.05 * x, "y": 0.05 * y, "z": 0.05 + 0.05 * abs(z)}),
        "link_inertial_error": (0.15 * float(rng.choice([-1, 1])), spot),
        "gravity_misalignment": (0.015, {"way": float(rng.uniform(0, 6.28))}),
        "torque_gain_error": (0.06 * float(rng.choice([-1, 1])), {}),
        "torque_offset": (0.005 * float(arm.rated[j]), {}),
        "torque_delay": (6e-3, {}),
        "torque_saturation": (2.0 / float(arm.rated[j]), {"knee": 0.0}),
        "encoder_offset": (0.015, {}),
        "external_contact": (
            20.0,
            {
                **spot,
                "from": float(rng.uniform(1, 5)),
                "long": float(rng.uniform(0.4, 2)),
                "which": float(rng.integers(3)),
            },
        ),
        "cable_at_the_end": (0.03 * float(arm.rated[j]), {"from": 0.5 * float(low[j] + high[j])}),
        "seal_after_rest": (0.7 * fc, {}),
        "floor_vibration": (0.01 * float(arm.rated[j]), {"hertz": float(rng.uniform(1.0, 4.0))}),
        "squared_of_neighbour": (0.02 * float(arm.rated[j]), {"other": float(rng.choice(others))}),
    }
    size, figures = drawn[name]
    return Effect(name, j, size, figures)
