"""What may be otherwise in some runs of a session.

A change undone gives the states as the other runs have them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ident.arrays import Array, Float
from ident.checks.foretold import RunStates
from ident.robot.arm import ArmModel

OTHER_ARM = "other_arm"  # nothing is as in the other runs
# Changes of torques alone, not of the motion.
OF_TORQUES = ("effort_sign", "effort_columns", "effort_scale")
ZEROS = 12  # places of a joint's zero that are tried at first, evenly over a turn
# Factors by which the clock of a run, or the unit of an angle, is another one's.
CLOCKS = (0.5, 2.0)


@dataclass(frozen=True)
class RunChange:
    """One convention that some runs have otherwise."""

    # `effort_sign`, `axis`, `columns`, `effort_columns`, `effort_scale`, `zero`, `clock` or
    # `other_arm`.
    kind: str
    joints: tuple[int, ...]  # columns of the joints concerned
    size: float = 0.0  # of a zero [rad], a scale or a clock [1]

    def log_units(self, count: int) -> Float[Array, " n"]:
        """Logarithm of the factor by which the change divides each joint's torque; 0 where it does
        not.

        An error of torques that were divided by a factor is one of so many times as much as
        recorded: a factor that only makes torque and noise small explains nothing.

        Args:
            count: Number of joints.
        """
        units = np.zeros(count)
        if self.kind == "effort_scale":
            units[list(self.joints)] = np.log(self.size)
        return units

    def undo(self, run: RunStates) -> RunStates:
        """The run's states as they are once the change is taken back."""
        count = run.q.shape[1]
        mask = np.zeros(count, dtype=bool)
        mask[list(self.joints)] = True
        sign = np.where(mask, -1.0, 1.0)
        order = np.arange(count)
        if len(self.joints) == 2:
            order[list(self.joints)] = self.joints[::-1]
        match self.kind:
            case "effort_sign":
                return replace(run, tau=sign * run.tau)
            case "axis":
                return replace(
                    run,
                    q=sign * run.q,
                    dq=sign * run.dq,
                    ddq=sign * run.ddq,
                    tau=sign * run.tau,
                )
            case "columns":
                return replace(
                    run,
                    q=run.q[:, order],
                    dq=run.dq[:, order],
                    ddq=run.ddq[:, order],
                    tau=run.tau[:, order],
                )
            case "effort_columns":
                return replace(run, tau=run.tau[:, order])
            case "effort_scale":
                return replace(run, tau=run.tau / np.where(mask, self.size, 1.0))
            case "zero":
                return replace(run, q=run.q - np.where(mask, self.size, 0.0))
            case "clock":
                return replace(run, dq=run.dq * self.size, ddq=run.ddq * self.size**2)
        return run


def discrete_changes(count: int, sliding: Float[Array, " n"]) -> Iterator[RunChange]:
    """Changes that are tried without a size to be fitted: signs, axes, columns and clocks.

    Args:
        count: Number of joints.
        sliding: Which joints slide; columns are exchanged among one kind alone.
    """
    every = tuple(range(count))
    yield RunChange("effort_sign", every)
    for joint in every if count > 1 else ():
        yield RunChange("effort_sign", (joint,))
    for joint in every:
        yield RunChange("axis", (joint,))
    for pair in combinations(every, 2):
        if sliding[pair[0]] == sliding[pair[1]]:
            yield RunChange("columns", pair)
            yield RunChange("effort_columns", pair)
    for factor in CLOCKS:
        yield RunChange("clock", every, factor)


def scale_changes(runs: Sequence[RunStates], foretold: Float[Array, "T n"]) -> Iterator[RunChange]:
    """Torques of one joint, or of all, at the factor at which they are foretold best.

    Args:
        runs: The runs concerned.
        foretold: Their torques as the other runs foretell them [N m].
    """
    tau = np.concatenate([run.tau for run in runs])
    along = (tau * foretold).sum(axis=0)
    power = (foretold**2).sum(axis=0)
    told = (along > 0.0) & (power > 0.0)  # the joints where a torque of the same sign is foretold
    factors = along[told] / power[told]
    for joint, factor in zip(np.flatnonzero(told).tolist(), factors.tolist(), strict=True):
        yield RunChange("effort_scale", (joint,), factor)
    if told.all():
        everywhere = float(np.exp(np.median(np.log(factors))))
        yield RunChange("effort_scale", tuple(range(len(factors))), everywhere)


def zero_changes(arm: ArmModel, joint: int) -> Iterator[RunChange]:
    """Changes of one joint's zero, evenly over a turn [rad]; none for a joint that slides."""
    if not bool(arm.sliding_joints[joint]):
        for step in range(1, ZEROS):
            angle = 2.0 * np.pi * step / ZEROS
            yield RunChange(
                "zero", (joint,), float(angle if angle <= np.pi else angle - 2.0 * np.pi)
            )
