"""The links of a patched arm: the URDF's, tuned, and changed by the identified effects; each a body
that can exist.

A simulator integrates what identification only solves for: a link whose inertia no body has makes
motion unstable or is refused. Tuning says only which combinations of inertial numbers act on the
torques, so that among all links of the same torques those nearest to the URDF's that are bodies can
be taken. The same holds for an identified error of a link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.bodies import is_consistent, solve_bounded
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale

# How much more the torques count than the numbers behind them, when bodies are sought.
TORQUE_WEIGHT = 1e4
STATES = 200
# A joint's usual torque counts as no less than this share of the largest.
LEAST_USUAL = 1e-3
# Random states move faster than dry friction's transition [rad/s].
LEAST_SPEED = 0.3
MOST_SPEED = 1.5
MOST_ACCELERATION = 3.0


@dataclass(frozen=True, eq=False)
class Links:
    """Change of each link against the URDF."""

    tuned: Float[Array, "n 10"]  # by tuning
    named: Float[Array, "n 10"]  # by named link errors
    # Share of the changes' torque that no bodies give, 0 where they could be written whole
    missed: float
    # Links that as they were fitted could be no body, and became the nearest ones.
    mended: tuple[str, ...] = ()

    @property
    def total(self) -> Float[Array, "n 10"]:
        """Both changes."""
        return self.tuned + self.named


def random_states(arm: ArmModel, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Angles within limits, speeds clear of rest, moderate accelerations, each of shape (STATES,
    n).
    """
    limits = arm.known_limits
    low = np.maximum(limits.lower, -np.pi)
    high = np.minimum(limits.upper, np.pi)
    q = rng.uniform(low, high, (STATES, arm.n))
    size = rng.uniform(LEAST_SPEED, MOST_SPEED, q.shape)
    speed = size * rng.choice([-1.0, 1.0], q.shape)
    return q, speed, rng.uniform(-MOST_ACCELERATION, MOST_ACCELERATION, q.shape)


def nearest_bodies(
    arm: ArmModel, tuning: Float[Array, "n 10"]
) -> tuple[Float[Array, "n 10"], float]:
    """The change nearest to a tuned one that leaves bodies, torques first.

        min Σ ‖Y (Δ − Δ₀)‖² / r · TORQUE_WEIGHT + ‖(Δ − Δ₀) / scale‖²,  every link a body

    Y are regressors of random states: what an arm feels most, its weight, is kept best. r is what a
    joint's torque usually is: in plain N m wrists would not count, in shares of it they would count
    as much as shoulders.

    Args:
        arm: The arm as its URDF describes it; links that are no bodies there are left free.
        tuning: Δ₀.

    Returns:
        The change, and the torque that it misses, as a share of that of Δ₀.
    """
    nominal = arm.inertial_parameters.reshape(arm.n, 10)
    # A link that the URDF itself leaves without extent need have none.
    free = [j for j in range(arm.n) if not is_consistent(nominal[j])]
    bound = np.delete(nominal + tuning, free, axis=0)
    if all(is_consistent(link) for link in bound):
        return np.array(tuning), 0.0
    scale = parameter_scale(arm)
    regressor = arm.regressor(*random_states(arm, np.random.default_rng(0)))
    usual = np.sqrt(np.mean((regressor @ arm.inertial_parameters) ** 2, axis=0))
    weight = np.sqrt(np.maximum(usual, LEAST_USUAL * usual.max()))
    rows = regressor / weight[:, None]
    torque = rows.reshape(-1, len(scale)) * scale
    torque /= np.sqrt(np.mean(np.sum(torque**2, axis=0)))
    wanted = (nominal + tuning).ravel()
    information = TORQUE_WEIGHT * torque.T @ torque + np.eye(len(scale))
    try:
        moved = solve_bounded(information, np.zeros(len(scale)), (), wanted, scale, free)
    except ArithmeticError:
        return np.zeros_like(tuning), 1.0
    asked = torque @ (tuning.ravel() / scale)
    missed = np.linalg.norm(torque @ moved) / np.linalg.norm(asked)
    return tuning + (scale * moved).reshape(tuning.shape), float(missed)
