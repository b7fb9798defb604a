"""A serial arm as plain arrays, which is what the compiled loops read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class Chain:
    """Placements, axes and inertias of n one-axis joints, base to tip.

    The rotation of joint i is A₀ + sin q A₁ + (1 − cos q) A₂ (Rodrigues' formula with the placement multiplied in),
    so that a compiled loop needs no case for the axis.

    Attributes:
        rotations: A₀, A₁, A₂ of every joint; A₁ = A₂ = 0 for a sliding one.
        offsets: Origin of each joint frame in its parent's [m].
        axes: Joint axes in the joint frames, unit length.
        sliding: 1 where the joint is prismatic, else 0.
        masses: Link masses [kg].
        centres: Centres of mass in the joint frames [m].
        inertias: Moments of inertia about the centres of mass, joint frame axes [kg m²].
        gravity: Gravity in the base frame [m/s²].
    """

    rotations: Float[Array, "n 3 3 3"]
    offsets: Float[Array, "n 3"]
    axes: Float[Array, "n 3"]
    sliding: Float[Array, " n"]
    masses: Float[Array, " n"]
    centres: Float[Array, "n 3"]
    inertias: Float[Array, "n 3 3"]
    gravity: Float[Array, " 3"]

    @classmethod
    def from_arm(cls, arm: ArmModel) -> Chain:
        """Reads the arrays from the arm's Pinocchio model."""
        model, joints = arm.model, range(1, arm.n + 1)
        axes, sliding = zip(*(_axis(model, i) for i in joints), strict=True)
        rotations = [_rodrigues(model.jointPlacements[i].rotation, axes[i - 1], sliding[i - 1]) for i in joints]
        return cls(
            rotations=freeze(np.array(rotations)),
            offsets=freeze(np.array([model.jointPlacements[i].translation for i in joints])),
            axes=freeze(np.array(axes)),
            sliding=freeze(np.array(sliding, dtype=float)),
            masses=freeze(np.array([model.inertias[i].mass for i in joints])),
            centres=freeze(np.array([model.inertias[i].lever for i in joints])),
            inertias=freeze(np.array([model.inertias[i].inertia for i in joints])),
            gravity=freeze(np.array(model.gravity.linear)),
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.masses)

    @property
    def kinematics(self) -> tuple[Array, Array, Array, Array]:
        """What a compiled loop needs to place the links."""
        return self.rotations, self.offsets, self.axes, self.sliding

    @property
    def dynamics(self) -> tuple[Array, ...]:
        """What a compiled loop needs for inverse dynamics."""
        return (*self.kinematics, self.masses, self.centres, self.inertias, self.gravity)


def _rodrigues(placement: Array, axis: Array, sliding: float) -> Array:
    cross = np.zeros((3, 3)) if sliding else pin.skew(axis)
    return np.array([placement, placement @ cross, placement @ cross @ cross])


def _axis(model: pin.Model, joint: int) -> tuple[Array, float]:
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, np.zeros(1))
    subspace = np.asarray(data.S.matrix if hasattr(data.S, "matrix") else data.S).reshape(6)
    slides = float(np.linalg.norm(subspace[:3]) > 0.5)
    return (subspace[:3] if slides else subspace[3:]), slides
