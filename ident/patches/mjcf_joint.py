"""What an MJCF says of one joint, its motor and its sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import factorial

import numpy as np
from scipy.optimize import lsq_linear

from ident.arrays import Array, Float
from ident.model.named_laws import bent
from ident.patches.change import Change
from ident.patches.standalone.motion import Losses
from ident.robot.arm import ArmModel

# Dry friction and stops are constraints that soften over this time; twice the step is the least that is stable [s].
CONSTRAINT_TIME = 0.002
SPRING_SUFFIX = "_spring"
# Joints without limits have these or wider ones [rad].
UNLIMITED = 1e8
# Speeds at which a curved friction law is fitted, and the largest of them where a joint has no limit [rad/s].
FIT_SPEEDS, FIT_TOP_SPEED = 200, 3.0
# Imaginary part below which a root is real [rad].
REAL = 1e-9


@dataclass(frozen=True, eq=False)
class JointFigures:
    """Attributes of a joint's elements.

    Attributes:
        name: The joint.
        joint: Attributes of its joint element.
        motor: Attributes of its motor.
        delay, cutoff: Of its sensor [s], [N m].
        spring: Attributes of a second joint behind the motor's, for a gear that gives way.
    """

    name: str
    joint: dict[str, str]
    motor: dict[str, str]
    delay: float = 0.0
    cutoff: float | None = None
    spring: dict[str, str] | None = None

    @property
    def spring_name(self) -> str:
        """Name of the second joint."""
        return f"{self.name}{SPRING_SUFFIX}"


@dataclass
class _Draft:
    """Figures while effects are added to them."""

    damping: Float[Array, " 3"]
    frictionloss: float
    joint: dict[str, str] = field(default_factory=dict)
    gain: float = 1.0
    bias: float = 0.0
    ref: float = 0.0
    cutoff: float | None = None
    spring: dict[str, str] | None = None


def joint_figures(arm: ArmModel, losses: Losses, changes: Sequence[Change]) -> tuple[JointFigures, ...]:
    """Figures of every joint.

    Args:
        arm: The arm.
        losses: Its losses.
        changes: Named effects.
    """
    delay = sum(change.values["delay_s"] for change in changes if change.effect == "torque_delay")
    found = []
    for j in range(arm.n):
        draft = _Draft(np.array([losses.viscous[j], 0.0, 0.0]), float(losses.coulomb[j]))
        for change in changes:
            if change.joint == j:
                _apply(draft, arm, j, change.effect, change.values)
        found.append(_finish(draft, arm, j, float(losses.motor_inertia[j]), max(delay, 0.0)))
    return tuple(found)


def _apply(draft: _Draft, arm: ArmModel, j: int, effect: str, figures: dict[str, float]) -> None:
    if effect == "torque_gain_error":
        draft.gain = 1.0 / (1.0 + figures["gain"])
    elif effect == "torque_offset":
        draft.bias -= figures["offset_Nm"]
    elif effect == "torque_saturation":
        draft.cutoff = figures["limit_Nm"]
    elif effect == "encoder_offset":
        draft.ref -= figures["offset_rad"]  # qpos is the logged angle, the true one is qpos − ref
    elif effect == "spring_torque":
        rest, stiffness = spring_at_rest(figures)
        draft.joint |= {"springref": repr(rest), "stiffness": " ".join(map(repr, stiffness))}
    elif effect == "nonlinear_viscous_friction":
        knee = figures.get("knee_rad_s", 0.0)
        dry, damping = fit_polynomial(figures["coefficient"], figures["exponent"], _top_speed(arm, j), knee)
        draft.frictionloss += dry
        draft.damping += damping
    elif effect == "joint_elasticity":
        spring = {"stiffness": figures["stiffness_Nm_rad"], "damping": figures["damping_Nms_rad"]}
        draft.spring = {key: repr(value) for key, value in spring.items()}


def _top_speed(arm: ArmModel, j: int) -> float:
    limit = float(arm.velocity_limit[j])
    return limit if 0.0 < limit < 100.0 else FIT_TOP_SPEED


def fit_polynomial(
    coefficient: float, exponent: float, top: float, knee: float = 0.0
) -> tuple[float, Float[Array, " 3"]]:
    """Dry friction and polynomial damping nearest to c |v|^α, straight below a knee, over speeds up to a top one.

    f + d₀ v + d₁ v² + d₂ v³ with f, d₀ ≥ 0; exact for α = 2.
    """
    v = np.linspace(0.0, top, FIT_SPEEDS)[1:]
    columns = np.stack([np.ones_like(v), v, v**2, v**3], axis=1)
    target = coefficient * bent(v, exponent, knee)
    fit = lsq_linear(columns, target, bounds=([0.0, 0.0, -np.inf, -np.inf], np.inf), tol=1e-14)
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


def _finish(draft: _Draft, arm: ArmModel, j: int, rotor: float, delay: float) -> JointFigures:
    joint = {
        "armature": repr(rotor),
        "damping": " ".join(repr(float(value)) for value in draft.damping),
        "frictionloss": repr(draft.frictionloss),
        "solreffriction": f"{CONSTRAINT_TIME!r} 1",
        **draft.joint,
    }
    if draft.ref:
        joint["ref"] = repr(draft.ref)
    lower, upper = float(arm.lower[j]) + draft.ref, float(arm.upper[j]) + draft.ref
    if max(abs(lower), abs(upper)) < UNLIMITED:
        joint["range"] = f"{lower!r} {upper!r}"
    effort = float(arm.effort_limit[j])
    if 0.0 < effort < UNLIMITED:
        joint["actuatorfrcrange"] = f"{-effort!r} {effort!r}"
    motor = {"gear": repr(draft.gain), "gaintype": "fixed", "gainprm": "1"}
    if draft.bias:
        motor |= {"biastype": "affine", "biasprm": f"{draft.bias!r} 0 0"}
    name = arm.joint_names[j]
    return JointFigures(name, joint, motor, delay, draft.cutoff, draft.spring)
