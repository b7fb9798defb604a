"""Laws that have more figures than are reported: what a diagnosis says of them beside, as the module takes it.

Reported are the figures that people ask for; the coefficients and the shape of the law stand beside the tuned baseline.
Where they are missing (a diagnosis written by hand), the simplest law with the reported figures is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ident.effects.memory import DISPLACEMENTS

Figures = dict[str, float]


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


def _hysteresis(reported: Figures, coefficients: tuple[float, ...], shape: Mapping[str, float]) -> Figures:
    """Every range's share of the amplitude; without them, of the two next to the displacement."""
    total, amplitude = sum(coefficients), reported["amplitude_Nm"]
    if total > 0.0:
        ranges, shares = list(shape.values()), [part / total for part in coefficients]
    else:
        where = reported["displacement_rad"]
        within = [size for size in DISPLACEMENTS[:-1] if size <= where]
        at = max(len(within) - 1, 0)
        ranges = [DISPLACEMENTS[at], DISPLACEMENTS[at + 1]]
        share = min(1.0, max(0.0, (where - ranges[0]) / (ranges[1] - ranges[0])))
        shares = [1.0 - share, share]
    found = {f"range_{i}_rad": size for i, size in enumerate(ranges)}
    return found | {f"part_{i}": amplitude * share for i, share in enumerate(shares)}


def _load(reported: Figures, coefficients: tuple[float, ...], shape: Mapping[str, float]) -> Figures:
    """Level, excess of driving over backdriving, curvature over the load, growth with speed."""
    if not coefficients:
        return {"level": reported["mu"], "driving": 0.0, "curvature_1_Nm": 0.0, "viscous_s_rad": 0.0}
    one, other, square, speed = (*coefficients, 0.0, 0.0)[:4]
    level = 0.75 * (one + other)
    told = level + square + shape["speed_rad_s"] * speed
    scale = reported["mu"] / told if told > 0.0 else 1.0
    return {
        "level": scale * level,
        "driving": scale * 0.25 * (one - other),
        "curvature_1_Nm": scale * square / shape["load_Nm"],
        "viscous_s_rad": scale * speed,
    }


def _ripple(reported: Figures, coefficients: tuple[float, ...], shape: Mapping[str, float]) -> Figures:
    return {"loaded": shape.get("loaded", 0.0), "load_Nm": shape.get("load_Nm", 1.0)}


def _spring(reported: Figures, coefficients: tuple[float, ...], shape: Mapping[str, float]) -> Figures:
    return {"harmonic": shape.get("harmonic", 0.0)}


_SHAPES: dict[str, Callable[[Figures, tuple[float, ...], Mapping[str, float]], Figures]] = {
    "load_dependent_friction": _load,
    "presliding_hysteresis": _hysteresis,
    "spring_torque": _spring,
    "torque_ripple": _ripple,
}
