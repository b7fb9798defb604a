"""Link inertias and which of their combinations act on the joint torques.

Only some combinations of the 10 n inertial numbers act on the joint torques: the base parameters. `nominal` keeps the
URDF's inertias; `base` fits the base parameters and changes the URDF's numbers as little as that needs; `consistent`
searches all numbers near the URDF's under the condition that every link could be a real body.

Source: Gautier 1991 (base parameters by QR).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import qr

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel

Mode = Literal["nominal", "base", "consistent"]
PER_LINK = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# Columns whose pivot is smaller than this share of the largest act on no joint torque.
RANK_TOLERANCE = 1e-9
# How far a URDF's inertia may be off before we look for another cause, as a share of the link's own scale.
PRIOR_SHARE = {"base": 2.0, "consistent": 0.3}
# Links lighter and shorter than these shares of the arm's moving mass and reach have no scale of their own.
LEAST_MASS_SHARE, LEAST_LENGTH_SHARE = 0.01, 0.054
STATES_FOR_RANK = 200


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which combinations of inertial numbers act on the joint torques: β = B π.

    Attributes:
        columns: Indices of the r independent regressor columns.
        mapping: B, shape (r, 10n).
        names: Names of the independent columns, such as `link_2.mx`.
    """

    columns: tuple[int, ...]
    mapping: Float[Array, "r 10n"]
    names: tuple[str, ...]

    @property
    def rank(self) -> int:
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class InertiaResults:
    """An arm's inertias as they were identified.

    Attributes:
        arm: The arm with its identified inertias.
        base: The base parameters.
        change: Change of the base parameters against the URDF, shape (r,).
        std: Their standard deviations; the prior's where the data are silent.
        informed: Share of each base parameter's prior variance that the data take away, 0 (silent) to 1.
        condition_number: Of the column-scaled, whitened base regressor: over 100 is poor excitation.
    """

    arm: ArmModel
    base: BaseParameters
    change: Float[Array, " r"]
    std: Float[Array, " r"]
    informed: Float[Array, " r"]
    condition_number: float


def base_parameters(arm: ArmModel) -> BaseParameters:
    """Base parameters of an arm's structure, from random states (fixed seed: the result is a property of the arm)."""
    rng = np.random.default_rng(0)
    q, dq, ddq = (rng.uniform(-np.pi, np.pi, (STATES_FOR_RANK, arm.n)) for _ in range(3))
    rows = arm.regressor(q, dq, ddq).reshape(-1, 10 * arm.n)
    factor, order = qr(rows, mode="r", pivoting=True)
    pivots = np.abs(np.diag(factor))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0]))
    columns, others = order[:rank], order[rank:]
    mapping = np.zeros((rank, 10 * arm.n))
    mapping[:, columns] = np.eye(rank)
    mapping[:, others] = np.linalg.solve(factor[:rank, :rank], factor[:rank, rank : 10 * arm.n])
    names = tuple(f"{arm.links[i // 10]}.{PER_LINK[i % 10]}" for i in columns)
    return BaseParameters(tuple(int(i) for i in columns), freeze(mapping), names)


def parameter_scale(arm: ArmModel) -> Float[Array, " 10n"]:
    """Natural size of each inertial number: mass, mass × length and mass × length² of its link."""
    links = arm.inertial_parameters.reshape(arm.n, 10)
    mass = np.maximum(links[:, 0], max(LEAST_MASS_SHARE * float(links[:, 0].sum()), 1e-9))
    lever = np.linalg.norm(links[:, 1:4], axis=1) / mass
    radius = np.sqrt(np.maximum(links[:, 4] + links[:, 6] + links[:, 9], 0.0) / (2 * mass))
    steps = [float(np.linalg.norm(place.translation)) for place in list(arm.model.jointPlacements)[2:]]
    length = np.maximum(np.maximum(lever, radius), LEAST_LENGTH_SHARE * max(sum(steps) + float(lever.max()), 1e-6))
    scale = np.concatenate(
        [mass[:, None], np.repeat((mass * length)[:, None], 3, 1), np.repeat((mass * length**2)[:, None], 6, 1)], 1
    )
    return freeze(scale.ravel())


def lift_base(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "10n r"]:
    """Smallest change of the inertial numbers, in units of their scale, that changes the base parameters by one."""
    weighted = base.mapping * scale**2
    return weighted.T @ np.linalg.inv(weighted @ base.mapping.T)


def free_of(information: Float[Array, "m m"], rank: int) -> Float[Array, "r r"]:
    """Information on the base parameters once the loss figures are free."""
    cross, own = information[:rank, rank:], information[rank:, rank:]
    return information[:rank, :rank] - cross @ np.linalg.pinv(own, hermitian=True) @ cross.T


def base_prior(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "r r"]:
    """Information on the base parameters that lies in trusting each inertial number to its scale."""
    return np.linalg.inv((base.mapping * scale**2) @ base.mapping.T)


def compute_condition(information: Array) -> float:
    """Condition number of the column-scaled regressor behind an information matrix."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    if values[-1] <= 0.0:
        return float("inf")
    return float(np.sqrt(values[-1] / max(values[0], 1e-16 * values[-1])))
