"""What an MJCF says of one joint, its motor and its sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import factorial

import numpy as np
from scipy.optimize import lsq_linear

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.laws.carried import COLUMNS
from ident.laws.friction import JointStates
from ident.robot.arm import ArmModel

# Dry friction and stops are constraints that soften over this time; twice the step is the least that is stable [s].
CONSTRAINT_TIME = 0.002
# How hard dry friction is: by MuJoCo's own 0.9 a light joint rubs in full only beyond a tenth of a radian a second.
HARDNESS = 0.999
SPRING_SUFFIX = "_spring"
TIMESTEP = 0.001  # [s]
# Spare samples of a delayed sensor's memory.
SPARE_SAMPLES = 4
# Joints without limits have these or wider ones [rad].
UNLIMITED = 1e8
# Speeds at which a curved friction law is fitted, and the largest of them where a joint has no limit [rad/s].
FIT_SPEEDS, FIT_TOP_SPEED = 200, 3.0
# Imaginary part below which a root is real [rad].
REAL = 1e-9


@dataclass(frozen=True, eq=False)
class JointElements:
    """Attributes of a joint's elements.

    Attributes:
        name: The joint.
        joint, motor, sensor: Of its joint, its motor and its sensor of force.
        spring: Of a second joint behind the motor's, for a gear that gives way; empty where it does not.
    """

    name: str
    joint: dict[str, str]
    motor: dict[str, str]
    sensor: dict[str, str]
    spring: dict[str, str]

    @property
    def spring_name(self) -> str:
        """Name of the second joint."""
        return f"{self.name}{SPRING_SUFFIX}"


def joint_elements(identified: IdentifiedArm) -> tuple[JointElements, ...]:
    """Elements of every joint: its losses, its limits, and its effects on top."""
    arm, losses = identified.nominal, identified.losses
    delay = sum(change.values["delay_s"] for change in identified.changes if change.part("mjcf") == "delay")
    samples = str(int(np.ceil(delay / TIMESTEP)) + SPARE_SAMPLES)
    late = {"delay": repr(delay), "nsample": samples, "interp": "linear"} if delay > 0.0 else {}
    found, limit = [], arm.velocity_limit
    top = np.where((limit > 0.0) & (limit < 100.0), limit, FIT_TOP_SPEED)
    for j, name in enumerate(arm.joint_names):
        own = JointElements(name, {}, {"gear": repr(1.0), "gaintype": "fixed", "gainprm": "1"}, dict(late), {})
        dry, damping = float(losses.coulomb[j]), np.array([losses.viscous[j], 0.0, 0.0])
        zero = 0.0
        for change in identified.changes:
            part, p = change.part("mjcf"), change.values
            if change.joint == j and part == "curve":
                more, curve = fit_polynomial(partial(friction_over_speed, change.effect, p), top[j])
                dry, damping = dry + more, damping + curve
            elif change.joint == j:
                zero -= (
                    p["offset_rad"] if part == "zero" else 0.0
                )  # qpos is the logged angle, the true one is qpos − ref
                _add_part(own, part, p)
        constraint = {"solreffriction": f"{CONSTRAINT_TIME!r} 1", "solimpfriction": f"{HARDNESS} {HARDNESS}"}
        friction = {"damping": numbers(damping), "frictionloss": repr(dry), **constraint}
        plain = {"armature": repr(float(losses.motor_inertia[j])), **friction}
        own.joint.update({**plain, **own.joint, **_limits(arm, j, zero)})
        found.append(own)
    return tuple(found)


def _add_part(own: JointElements, part: str, p: Mapping[str, float]) -> None:
    """Writes one effect's part of a joint's elements."""
    if part == "gain":
        own.motor["gear"] = repr(1.0 / (1.0 + p["gain"]))
    elif part == "bias":
        own.motor.update({"biastype": "affine", "biasprm": f"{-p['offset_Nm']!r} 0 0"})
    elif part == "cutoff":
        own.sensor["cutoff"] = repr(p["limit_Nm"])
    elif part == "spring":
        rest, stiffness = spring_at_rest(p)
        own.joint.update({"springref": repr(rest), "stiffness": numbers(stiffness)})
    elif part == "second joint":
        own.spring.update({"stiffness": repr(p["stiffness_Nm_rad"]), "damping": repr(p["damping_Nms_rad"])})


def _limits(arm: ArmModel, j: int, zero: float) -> dict[str, str]:
    """Zero, range and torque limit of a joint, as far as it has them."""
    found = {"ref": repr(zero)} if zero else {}
    lower, upper, effort = float(arm.lower[j]) + zero, float(arm.upper[j]) + zero, float(arm.effort_limit[j])
    if max(abs(lower), abs(upper)) < UNLIMITED:
        found["range"] = f"{lower!r} {upper!r}"
    if 0.0 < effort < UNLIMITED:
        found["actuatorfrcrange"] = f"{-effort!r} {effort!r}"
    return found


def numbers(values: Sequence[float] | Array) -> str:
    """Numbers of an attribute, to the last digit."""
    return " ".join(repr(float(value)) for value in values)


def friction_over_speed(effect: str, figures: dict[str, float], v: Float[Array, " v"]) -> Float[Array, " v"]:
    """A law of friction evaluated at speeds forwards, without load, at angle zero [N m]."""
    columns = COLUMNS[effect](JointStates(0.0 * v, v, 0.0 * v, np.ones_like(v)), figures)
    return np.asarray(sum(figures[f"coefficient_{k}"] * column for k, column in enumerate(columns)))


def fit_polynomial(law: Callable[[Array], Array], top: float) -> tuple[float, Float[Array, " 3"]]:
    """Dry friction and polynomial damping nearest to a law of speed, over speeds up to a top one.

    f + d₀ v + d₁ v² + d₂ v³ with f, d₀ ≥ 0; exact for such laws.
    """
    v = np.linspace(0.0, top, FIT_SPEEDS)[1:]
    columns = np.stack([np.ones_like(v), v, v**2, v**3], axis=1)
    fit = lsq_linear(columns, law(v), bounds=([0.0, 0.0, -np.inf, -np.inf], np.inf), tol=1e-14)
    return float(fit.x[0]), fit.x[1:]


def spring_at_rest(figures: Mapping[str, float]) -> tuple[float, tuple[float, ...]]:
    """Rest angle of a cubic spring and its coefficients there, as MuJoCo reads them: k₀ x + k₁ x² + k₂ x³.

    A spring without a rest, which no cubic with a cube is, counts as none.
    """
    names = ("constant_Nm", "linear_Nm_rad", "square_Nm_rad2", "cube_Nm_rad3")
    law = np.polynomial.Polynomial([figures[name] for name in names]).trim()
    roots = [float(root.real) for root in np.atleast_1d(law.roots()) if abs(root.imag) < REAL]
    if not roots:
        return figures["centre_rad"], (0.0,)
    rest = min(roots, key=abs)
    terms = [float(law.deriv(k)(rest)) / factorial(k) for k in range(1, law.degree() + 1)]
    return figures["centre_rad"] + rest, tuple(terms)
