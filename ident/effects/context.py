"""What effects see of a session: its runs, and a point of an inner grid; never the measured torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ident.arrays import Array, Float
from ident.motion.motion import Motion
from ident.motion.out_of_core import choose_runs
from ident.robot.arm import ArmModel

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class RunContext:
    """One run as the effects see it; T samples of n joints, before the common filter.

    The regressor and the derivatives are computed once, when first asked for, and live as long as the run does: a long
    session is gone through with fresh copies of its runs (`dataclasses.replace`), a few at a time.
    """

    motion: Motion  # the run (q, dq, ddq smoothed, time on the session clock, filter)
    arm: ArmModel  # the rigid arm with its payload
    rigid: Float[Array, "T n"]  # rigid torque of the motion [N m]
    # Modelled torque that the joint transmits: rigid torque without rotor inertia and friction [N m].
    link: Float[Array, "T n"]
    friction: Float[Array, "T n"]  # modelled friction torque of the baseline (viscous + Coulomb) [N m]
    # Direction of sliding in [-1, 1]; each joint turns round over its own displacement or speed.
    direction: Float[Array, "T n"]
    temperature: Float[Array, "T n"] | None = None  # measured joint temperature [degC], or None
    position_command: Float[Array, "T n"] | None = None  # commanded position [rad], or None
    # Modelled torque of the rotors' inertia [N m], or None where it isn't modelled.
    rotor: Float[Array, "T n"] | None = None

    @property
    def n(self) -> int:
        return self.motion.n

    @property
    def total(self) -> Float[Array, "T n"]:
        """Whole modelled torque of the motor, seen at the joint [N m]."""
        torque: Array = self.rigid + self.friction
        return torque if self.rotor is None else torque + self.rotor

    @cached_property
    def regressor(self) -> Float[Array, "T n 10n"]:
        """Regressor of the rigid torque in the links' inertial parameters."""
        return self.arm.regressor(self.motion.q, self.motion.dq, self.motion.ddq)

    @cached_property
    def derivatives(self) -> tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]:
        """Derivatives of the rigid torque by position, velocity and acceleration; rows are torques.

        Each of their entries lies side by side for all samples: they are asked for one by one.
        """
        by_sample = self.arm.derivatives(self.motion.q, self.motion.dq, self.motion.ddq)
        q, dq, ddq = (np.moveaxis(np.ascontiguousarray(np.moveaxis(one, 0, -1)), -1, 0) for one in by_sample)
        return q, dq, ddq

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What else was made of the run and will be asked for again, by whatever names it."""
        return {}

    def copied(self) -> RunContext:
        """A copy that knows the derivatives if this one does, and takes what more it computes along when it goes."""
        copy = replace(self)
        if "derivatives" in vars(self):
            vars(copy)["derivatives"] = self.derivatives
        return copy

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return self.motion.interval


@dataclass(frozen=True, eq=False)
class SessionContext:
    """All runs, in order, and what holds for all of them."""

    runs: Sequence[RunContext]  # the runs
    common_clock: bool  # whether time goes on from run to run
    joint_names: tuple[str, ...]  # the joints
    gear_ratios: Float[Array, " n"] | None  # reduction of each joint, or None where it is not known
    rated_torque: Float[Array, " n"]  # effort limits [N m]
    # Change of the links' inertial numbers by tuning, shape (10 n,), or None where nobody tuned them.
    tuned: Float[Array, " 10n"] | None = None
    every: int = 1  # one of how many runs is asked for typical sizes: 1, or more where the runs of hours wait on disk

    @property
    def n(self) -> int:
        return len(self.joint_names)

    @cached_property
    def survey(self) -> SessionContext:
        """The session itself, or an even choice of its runs, held in memory, where there are very many."""
        return self if self.every == 1 else replace(self, runs=tuple(self.surveyed(self.runs)), every=1)

    def surveyed(self, of_runs: Sequence[T]) -> Sequence[T]:
        """Of what there is one of for each run, those of the survey's runs."""
        return [of_runs[k] for k in choose_runs(len(of_runs), self.every)]


@dataclass(frozen=True)
class Variant:
    """One point of an effect's inner grid: the parameters in which its torque is not linear."""

    # Names (with units) and values, such as {"stribeck_velocity_rad_s": 0.05, "exponent": 2}; the same names in all
    # variants of an effect. They are reported, with intervals from their likelihood over the grid.
    inner: Mapping[str, float] = field(default_factory=dict)
    other: int | None = None  # another joint that takes part (coupling), or None
    # Further parameters that the columns need and nobody asks for: centres and scales of the whole session, points
    # about which a law is linearised. Columns of a part of a session then match those of the whole.
    shape: Mapping[str, float] = field(default_factory=dict)
