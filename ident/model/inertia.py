"""Link inertias and which of their combinations act on the joint torques.

Only some combinations of the 10 n inertial numbers act on the joint torques: the base parameters.
`nominal` keeps the URDF's inertias; `base` fits the base parameters and changes the URDF's numbers
as little as that needs; `consistent` searches all numbers near the URDF's under the condition that
every link could be a real body (see `bodies`).

Source: Gautier 1991 (base parameters by QR).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from ident.arrays import Array, Float, freeze
from ident.model.loss import InertiaFigure
from ident.robot.arm import ArmModel

PER_LINK = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# Columns whose pivot is smaller than this share of the largest act on no joint torque.
RANK_TOLERANCE = 1e-9
STATES_FOR_RANK = 200


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which combinations of inertial numbers act on the joint torques: β = B π."""

    columns: tuple[int, ...]  # indices of the r independent regressor columns
    mapping: Float[Array, "r 10n"]  # B, shape (r, 10n)
    names: tuple[str, ...]  # names of the independent columns, such as `link_2.mx`

    @property
    def rank(self) -> int:
        """Number r of base parameters."""
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class InertiaResults:
    """An arm's inertias as they were identified."""

    arm: ArmModel  # the arm with its identified inertias
    base: BaseParameters  # the base parameters
    change: Float[Array, " r"]  # change of the base parameters against the URDF, shape (r,)
    std: Float[Array, " r"]  # their standard deviations; the prior's where the data are silent
    # Share of each base parameter's prior variance that the data take away, 0 (silent) to 1.
    informed: Float[Array, " r"]
    # Of the column-scaled, whitened base regressor: over 100 is poor excitation.
    condition_number: float

    def figures(self, limits: Float[Array, "r 2"]) -> tuple[InertiaFigure, ...]:
        """The base parameters one by one.

        Args:
            limits: Ends of the interval of each one's change.
        """
        values = self.base.mapping @ self.arm.inertial_parameters
        ends = (values - self.change)[:, None] + limits
        columns = zip(
            self.base.names,
            values.tolist(),
            ends[:, 0].tolist(),
            ends[:, 1].tolist(),
            self.informed.tolist(),
            strict=True,
        )
        return tuple(InertiaFigure(*row) for row in columns)


def base_parameters(arm: ArmModel) -> BaseParameters:
    """Base parameters of an arm's structure, from random states.

    The seed is fixed: the result is a property of the arm.
    """
    rng = np.random.default_rng(0)
    shape = (STATES_FOR_RANK, arm.n)
    q, dq, ddq = (rng.uniform(-np.pi, np.pi, shape) for _ in range(3))
    rows = arm.regressor(q, dq, ddq).reshape(-1, 10 * arm.n)
    factor, order = qr(rows, mode="r", pivoting=True)
    pivots = np.abs(np.diag(factor))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0]))
    columns = order[:rank]
    others = order[rank:]
    mapping = np.zeros((rank, 10 * arm.n))
    mapping[:, columns] = np.eye(rank)
    of_rank = factor[:rank, :rank]
    of_others = factor[:rank, rank : 10 * arm.n]
    mapping[:, others] = np.linalg.solve(of_rank, of_others)
    names = tuple(f"{arm.links[k // 10]}.{PER_LINK[k % 10]}" for k in columns)
    return BaseParameters(tuple(columns.tolist()), freeze(mapping), names)


def lift_base(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "10n r"]:
    """Smallest change of the inertial numbers that changes each base parameter by one.

    Smallest in units of the numbers' scale.
    """
    weighted = base.mapping * scale**2
    return weighted.T @ np.linalg.inv(weighted @ base.mapping.T)


def base_prior(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "r r"]:
    """Information on the base parameters in trusting each inertial number to its scale."""
    return np.linalg.inv((base.mapping * scale**2) @ base.mapping.T)


def compute_condition(information: Array) -> float:
    """Condition number of the column-scaled regressor behind an information matrix."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    if values[-1] <= 0.0:
        return float("inf")
    least = max(values[0], 1e-16 * values[-1])
    return float(np.sqrt(values[-1] / least))
