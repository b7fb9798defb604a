"""Friction laws that a diagnosis named, as planners need them: their torque's slopes and extremes.

The laws themselves are `ident.model.friction_laws`; here each is differentiated by the joint's position, speed and
load. Moduli have corners: derivatives are those of either side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.friction_laws import JointStates, NamedLaw, Shape

# Least speed that a power is taken of where it is differentiated: a bend below one is endless at rest [rad/s].
LEAST_SPEED = 1e-9


@dataclass(frozen=True, eq=False)
class LawSlopes:
    """A law's columns' derivatives by position, speed (direction held), direction and load, each of shape (T, k)."""

    by_position: Float[Array, "T k"]
    by_speed: Float[Array, "T k"]
    by_slip: Float[Array, "T k"]
    by_load: Float[Array, "T k"]


def _stribeck(at: JointStates, shape: Shape) -> LawSlopes:
    bend, exponent = shape["stribeck_velocity_rad_s"], shape["exponent"]
    speed = np.maximum(np.abs(at.dq), LEAST_SPEED) / bend
    left = np.exp(-(speed**exponent))
    fall = -at.slip * left * exponent * speed ** (exponent - 1.0) * np.sign(at.dq) / bend
    return _slopes(at, by_speed=[fall], by_slip=[left])


def _curved(at: JointStates, shape: Shape) -> LawSlopes:
    speed, exponent, knee = np.maximum(np.abs(at.dq), LEAST_SPEED), shape["exponent"], shape.get("knee_rad_s", 0.0)
    size = np.hypot(speed, knee)
    rise = at.slip * size ** (exponent - 3.0) * (exponent * speed**2 + knee**2) * np.sign(at.dq)
    return _slopes(at, by_speed=[rise], by_slip=[np.abs(at.dq) * size ** (exponent - 1.0)])


def _load(at: JointStates, shape: Shape) -> LawSlopes:
    size, side, zero = np.abs(at.load), np.sign(at.load), np.zeros_like(at.dq)
    by_slip = [0.75 * size + 0.5 * at.slip * at.load, 0.75 * size - 0.5 * at.slip * at.load]
    by_load = [0.75 * at.slip * side + 0.25 * at.slip**2, 0.75 * at.slip * side - 0.25 * at.slip**2]
    by_speed = [zero, zero]
    if shape["terms"] == 4:
        typical = shape["load_Nm"]
        by_slip += [at.load**2 / typical, zero]
        by_load += [2.0 * at.slip * at.load / typical, at.dq * side]
        by_speed += [zero, size]
    return _slopes(at, by_speed=by_speed, by_slip=by_slip, by_load=by_load)


def _position(at: JointStates, shape: Shape) -> LawSlopes:
    order = shape["order"]
    cosine, sine = np.cos(order * at.q), np.sin(order * at.q)
    turned = [-order * at.slip * sine, order * at.slip * cosine]
    return _slopes(at, by_position=turned, by_slip=[cosine, sine])


def _asymmetric(at: JointStates, shape: Shape) -> LawSlopes:
    zero = np.zeros_like(at.dq)
    return _slopes(at, by_speed=[zero, 0.5 * np.sign(at.dq)], by_slip=[at.slip, zero])


def _slopes(at: JointStates, **parts: Sequence[Array]) -> LawSlopes:
    columns = len(parts["by_slip"])
    none = np.zeros((len(at.dq), columns))
    made = {name: np.stack(list(values), axis=1) for name, values in parts.items()}
    return LawSlopes(*(made.get(name, none) for name in ("by_position", "by_speed", "by_slip", "by_load")))


SLOPES: dict[str, Callable[[JointStates, Shape], LawSlopes]] = {
    "stribeck_friction": _stribeck,
    "nonlinear_viscous_friction": _curved,
    "load_dependent_friction": _load,
    "position_dependent_friction": _position,
    "asymmetric_friction": _asymmetric,
}


def law_slopes(
    law: NamedLaw, at: JointStates, turning: Float[Array, " T"]
) -> tuple[Float[Array, " T"], Float[Array, " T"], Float[Array, " T"]]:
    """Derivatives of a law's torque by its joint's position, speed and load.

    Args:
        law: Fitted.
        at: States of its joint.
        turning: Derivative of the direction by the speed [s/rad].
    """
    found, figures = SLOPES[law.effect](at, law.shape), _figures(law)
    by_speed = found.by_speed @ figures + turning * (found.by_slip @ figures)
    return found.by_position @ figures, by_speed, found.by_load @ figures


def law_range(
    law: NamedLaw, speeds: Float[Array, " v"], loads: Float[Array, " l"], width: float
) -> tuple[float, Float[Array, " v"]]:
    """Largest torque of a law, and the least power that it takes at each speed, over angles and loads.

    Args:
        law: Fitted.
        speeds: Speeds that are looked at [rad/s].
        loads: Loads that are looked at [N m].
        width: Of the turn of the joint's dry friction [rad/s].
    """
    angles = np.linspace(0.0, 2.0 * np.pi / law.shape["order"], 25)[:-1] if "order" in law.shape else np.zeros(1)
    v, angle, load = (part.reshape(-1) for part in np.meshgrid(speeds, angles, loads, indexing="ij"))
    slip = np.tanh(v / width) if width > 0.0 else np.sign(v)
    torque = law.torque(JointStates(angle, v, load, slip))
    return float(np.abs(torque).max()), (torque * v).reshape(len(speeds), -1).min(axis=1)


def _figures(law: NamedLaw) -> Float[Array, " k"]:
    return np.array([value for value, _, _ in law.figures])
