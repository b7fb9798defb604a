"""Whether a net helps on runs that it never saw, joint by joint, in torque and in energy; else it is silent.

Each member of the net is trained without some of the runs; on those its prediction is compared with none. A joint keeps
its net if that lowers the mean square error by more than two standard errors over the runs, and doesn't raise the
energy error by more than one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int

# Standard errors by which a net must help: chance alone does that once in forty times.
SURE = 2.0


@dataclass(frozen=True)
class JointGate:
    """What a joint's net did on runs that it never saw.

    Attributes:
        rmse_without, rmse_with: Torque error where the joint moves [N m].
        energy_without, energy_with: Root mean square over the runs of the energy error, where it moves [J].
        kept: Whether the joint keeps its net.
    """

    rmse_without: float
    rmse_with: float
    energy_without: float
    energy_with: float
    kept: bool

    def to_dict(self) -> dict[str, Any]:
        return dict(vars(self))


def judge_net(
    predicted: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    run: Int[Array, " T"],
) -> tuple[JointGate, ...]:
    """The verdict on each joint's net.

    Args:
        predicted: Torque by the members that did not see the run [N m].
        left: What the analytic model and the losses leave [N m].
        moving: Where each joint moves.
        travel: Displacement of each joint from sample to sample [rad].
        run: Number of the run that a sample lies in.
    """
    error = left - predicted
    counts = _by_run(moving.astype(float), run)
    squares = [_by_run(np.where(moving, part**2, 0.0), run) for part in (left, error)]
    energy = [_by_run(np.where(moving, part * travel, 0.0), run) for part in (left, error)]
    # Of all moving samples alike: a run in which a joint hardly moves says little of it.
    gain = squares[0] - squares[1]
    doubt = gain.std(axis=0, ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.full(gain.shape[1], np.inf)
    works = [np.sqrt(np.mean(part**2, axis=0)) for part in energy]
    kept = (gain.mean(axis=0) > SURE * doubt) & ~_is_worse(energy[0], energy[1])
    kept = _spare_the_total(kept, energy[0], energy[1])
    rmse = [np.sqrt(part.sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0)) for part in squares]
    rows = zip(rmse[0], rmse[1], works[0], works[1], kept, strict=True)
    return tuple(JointGate(float(a), float(b), float(c), float(d), bool(keep)) for a, b, c, d, keep in rows)


def _spare_the_total(
    kept: Bool[Array, " n"], without: Float[Array, "g n"], with_net: Float[Array, "g n"]
) -> Bool[Array, " n"]:
    """Lets joints go until the energy error of all joints together is no worse than without any net."""

    def mixed(choice: Array) -> Float[Array, "g 1"]:
        return np.where(choice, with_net, without).sum(axis=1, keepdims=True)

    def total(choice: Array) -> float:
        return float(np.sum(mixed(choice) ** 2))

    kept = kept.copy()
    while kept.any() and _is_worse(without.sum(axis=1, keepdims=True), mixed(kept))[0]:
        trials = [np.where(np.arange(len(kept)) == j, False, kept) for j in np.flatnonzero(kept)]
        kept = min(trials, key=total)
    return kept


def _is_worse(without: Float[Array, "g n"], with_net: Float[Array, "g n"]) -> Bool[Array, " n"]:
    """Whether squares over the runs grew by more than one standard error of their change."""
    growth = with_net**2 - without**2
    doubt = growth.std(axis=0, ddof=1) / np.sqrt(len(growth)) if len(growth) > 1 else np.zeros(growth.shape[1])
    return np.asarray(growth.mean(axis=0) > doubt)


def _by_run(values: Float[Array, "T n"], run: Int[Array, " T"]) -> Float[Array, "g n"]:
    labels, index = np.unique(run, return_inverse=True)
    sums = np.zeros((len(labels), values.shape[1]))
    np.add.at(sums, index, values)
    return sums


def describe_gate(gate: tuple[JointGate, ...], joints: tuple[str, ...]) -> str:
    """Which joints keep their net, and which would be worse off with it on runs that it never saw."""
    kept = [name for name, one in zip(joints, gate, strict=True) if one.kept]
    silent = [name for name in joints if name not in kept]
    parts = [f"kept for {', '.join(kept)}"] if kept else []
    if silent:
        parts.append(f"left out for {', '.join(silent)}: no better on runs held back, in torque or in energy")
    return f"residual net: {'; '.join(parts)}"
