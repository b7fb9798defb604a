"""An estimate within its bounds: no negative losses, and links that some body can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.command_options import Inertia
from ident.fitting.joint_estimate import JointEstimate
from ident.laws.carried import NamedLaw
from ident.model.bodies import solve_bounded
from ident.model.inertia import BaseParameters
from ident.regression.design import LOSS_PARAMETERS
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale


@dataclass(frozen=True, eq=False)
class BoundedEstimate:
    """An estimate within its bounds."""

    estimate: JointEstimate
    change: Float[Array, " 10n"]  # of the links' inertial numbers
    losses: Float[Array, "n p"]
    coefficients: Float[Array, " k"]  # of laws
    zero: Int[Array, " z"]  # positions of parameters that are held at zero

    def values(self, base: BaseParameters) -> Float[Array, " m"]:
        """All parameters in the estimate's order."""
        values = np.array(self.estimate.values)
        values[: base.rank] = base.mapping @ self.change
        for joint, losses in enumerate(self.losses):
            values[self.estimate.index(joint)] = losses
        values[self.estimate.first_law :] = self.coefficients
        return values


def nonnegative(
    unbounded: JointEstimate, joints: int, laws: Sequence[NamedLaw]
) -> Int[Array, " b"]:
    """Positions of all losses but offsets, and of laws' coefficients as their kind says."""
    positions = [unbounded.index(joint)[:LOSS_PARAMETERS] for joint in range(joints)]
    first = unbounded.first_law
    for law in laws:
        positions.append(first + np.array(law.kind.nonnegative, dtype=int))
        first += law.size
    return np.concatenate(positions)


def within_bounds(
    unbounded: JointEstimate,
    arm: ArmModel,
    base: BaseParameters,
    mode: Inertia,
    bounds: tuple[Int[Array, " b"], Int[Array, " z"]],
    share: float,
) -> BoundedEstimate:
    """Change of the inertial numbers, and losses with all that stands behind them.

    Args:
        unbounded: The estimate without bounds.
        arm: The arm as its URDF describes it.
        base: Its base parameters.
        mode: How the links' inertias may change.
        bounds: Positions among the estimate's parameters: of those that can't be negative, and of
            those that are zero.
        share: How far the URDF's numbers may be off, as a share of each link's scale.
    """
    nonnegative, zero = bounds
    rank = base.rank
    losses = len(unbounded.values) - rank
    numbers = 0 if mode == "nominal" else 10 * arm.n
    # Unknowns: changes of all inertial numbers in units of how far a URDF may be off, then the
    # losses as they are.
    unit = share * parameter_scale(arm)[:numbers]
    lift = np.zeros((rank + losses, numbers + losses))
    lift[:rank, :numbers] = base.mapping[:, :numbers] * unit
    lift[rank:, numbers:] = np.eye(losses)
    information = lift.T @ unbounded.information @ lift
    information[:numbers, :numbers] += np.eye(numbers)
    score = lift.T @ unbounded.score
    free = np.setdiff1d(np.arange(len(information)), zero - rank + numbers)
    bounded = np.flatnonzero(np.isin(free, nonnegative - rank + numbers))
    links = arm.inertial_parameters if mode == "consistent" else None
    solved = np.zeros(len(information))
    of_free = information[np.ix_(free, free)]
    solved[free] = solve_bounded(of_free, score[free], bounded, links, unit)
    change = np.zeros(10 * arm.n)
    change[:numbers] = unit * solved[:numbers]
    solved = solved[numbers:]
    joints = [unbounded.index(joint) - rank for joint in range(arm.n)]
    first_law = unbounded.first_law - rank
    return BoundedEstimate(unbounded, change, solved[np.array(joints)], solved[first_law:], zero)
