"""Laws that have more figures than are reported: what a diagnosis says of them beside, as the module takes it.

Reported are the figures that people ask for; the coefficients and the shape of the law stand beside the tuned baseline,
and go with its losses. Where they are missing (a diagnosis written by hand), the simplest law with the reported figures
is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ident.effects.memory import DISPLACEMENTS
from ident.effects.transmission import PERIODIC

Figures = dict[str, float]
Coefficients = tuple[float, ...]
PADDING = (0.0,) * 6


def shape_figures(effect: str, reported: Figures, law: Mapping[str, Any] | None) -> Figures:
    """Further figures of an effect's law.

    Args:
        effect: Its id.
        reported: The reported figures.
        law: `coefficients` and `shape` of the tuned baseline's record, or None.
    """
    if effect not in _SHAPES:
        return {}
    if law is None:
        return _SHAPES[effect](reported, (), {})
    return _SHAPES[effect](reported, tuple(map(float, law["coefficients"])), law["shape"])


def _hysteresis(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
    """Every range and its torque; without them, the two ranges next to the displacement."""
    parts, ranges = coefficients, list(shape.values())
    if not parts:
        where, amplitude = reported["displacement_rad"], reported["amplitude_Nm"]
        within = [size for size in DISPLACEMENTS[:-1] if size <= where]
        at = max(len(within) - 1, 0)
        ranges = [DISPLACEMENTS[at], DISPLACEMENTS[at + 1]]
        share = min(1.0, max(0.0, (where - ranges[0]) / (ranges[1] - ranges[0])))
        parts = amplitude * (1.0 - share), amplitude * share
    found = {f"range_{i}_rad": size for i, size in enumerate(ranges)}
    return found | {f"part_{i}_Nm": part for i, part in enumerate(parts)}


def _load(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
    """Level, excess of driving over backdriving, curvature over the load, growth with speed."""
    if not coefficients:
        return {"level": reported["mu"], "driving": 0.0, "curvature_1_Nm": 0.0, "viscous_s_rad": 0.0}
    one, other, square, speed = (*coefficients, 0.0, 0.0)[:4]
    return {
        "level": 0.75 * (one + other),
        "driving": 0.25 * (one - other),
        "curvature_1_Nm": square / shape["load_Nm"],
        "viscous_s_rad": speed,
    }


def _ripple(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
    """Whether the teeth's torque is a share of the load."""
    return {"loaded": shape.get("loaded", 0.0), "load_Nm": shape.get("load_Nm", 1.0)}


def _saturation(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
    """Where the reading begins to flatten, and the share of what lies above that it loses."""
    if not coefficients:
        return {"knee_Nm": reported["limit_Nm"], "lost": 1.0}
    return {"knee_Nm": shape["knee_Nm"], "lost": coefficients[0]}


def _spring(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
    """A cubic about an angle, and a wave with two rests a turn; one of the two is zero."""
    names = ("linear_Nm_rad", "constant_Nm", "square_Nm_rad2", "cube_Nm_rad3", "cosine_Nm", "sine_Nm")
    centre = shape.get("centre_rad", reported["rest_rad"])
    if not coefficients:
        values: Coefficients = (reported["stiffness_Nm_rad"],)
    elif shape["law"] == PERIODIC:
        values = (0.0, 0.0, 0.0, 0.0, 0.5 * coefficients[0], 0.5 * coefficients[1])
    else:
        values = coefficients
    return {"centre_rad": centre, **dict(zip(names, (*values, *PADDING), strict=False))}


def _curve(name: str) -> Callable[[Figures, Coefficients, Mapping[str, float]], Figures]:
    """A curve over speed at the point of the grid that its coefficient was found at."""

    def figures(reported: Figures, coefficients: Coefficients, shape: Mapping[str, float]) -> Figures:
        return {name: coefficients[0], **shape} if coefficients else {}

    return figures


_SHAPES: dict[str, Callable[[Figures, Coefficients, Mapping[str, float]], Figures]] = {
    "load_dependent_friction": _load,
    "nonlinear_viscous_friction": _curve("coefficient"),
    "presliding_hysteresis": _hysteresis,
    "spring_torque": _spring,
    "stribeck_friction": _curve("amplitude_Nm"),
    "torque_ripple": _ripple,
    "torque_saturation": _saturation,
}
