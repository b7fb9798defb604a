"""Heat balance of each joint: the lubricant warms by what friction loses, the housing takes it up and cools to the air.

    C_1 dθ_1/dt = P_loss - G_1 (θ_1 - θ_2),    C_2 dθ_2/dt = G_1 (θ_1 - θ_2) - G_2 θ_2

with temperatures above the ambient.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import expm

from ident.arrays import Array, Float
from ident.simulation.laws import Law, make_law

AMBIENT_DEGC = 24.0


# Thermal network of each joint.
HEAT = {
    "lubricant": 0.0,  # heat capacities C_1, C_2 [J/K]
    "housing": 0.0,
    "inner": 0.0,  # conductances G_1, G_2 [W/K]
    "outer": 0.0,
    "copper": 0.0,  # motor's copper loss per torque squared that reaches the gear [W/(N m)²]
}


def heat_law(rated_loss: Float[Array, " n"], rise: float = 25.0, time_constant: float = 90.0) -> Law:
    """A network whose lubricant settles at a rise above ambient under a rated loss.

    Args:
        rated_loss: Friction power of steady work [W].
        rise: Lubricant's final temperature above ambient [K].
        time_constant: Of the lubricant against the housing [s]; the housing's own is ten times as long.
    """
    inner = rated_loss / (0.75 * rise)
    outer = rated_loss / (0.25 * rise)
    capacities = {"lubricant": time_constant * inner, "housing": 10.0 * time_constant * outer}
    return make_law(HEAT, len(rated_loss), **capacities, inner=inner, outer=outer)


@njit(cache=True)
def warm_up(joint: Any, state: Any, loss: float, dt: float) -> None:
    """Advances a joint's two temperatures above ambient [K] by dt [s] under a loss [W], in place."""
    flow = joint.inner * (state.lubricant_rise - state.housing_rise)
    state.lubricant_rise += dt * (loss - flow) / joint.lubricant
    state.housing_rise += dt * (flow - joint.outer * state.housing_rise) / joint.housing


def cool_down(law: Law, rise: Float[Array, "n 2"], pause: float) -> Float[Array, "n 2"]:
    """Temperatures above ambient [K] after a pause [s] at rest: the exact solution of the linear network."""
    cooled = np.empty_like(rise)
    for j in range(len(rise)):
        inner, outer = law.inner[j], law.outer[j]
        from_lubricant, from_housing = inner / law.lubricant[j], inner / law.housing[j]
        lost = outer / law.housing[j]
        rate = np.array([[-from_lubricant, from_lubricant], [from_housing, -from_housing - lost]])
        cooled[j] = expm(rate * pause) @ rise[j]
    return cooled
