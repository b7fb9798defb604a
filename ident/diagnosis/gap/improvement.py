"""Gain of the accepted effects on held-out runs: Shapley shares, energy errors, replay.
Effects overlap: what the second one closes depends on whether the first was there. Shapley's value
is the mean over all orders of acceptance,

    share_i = Σ_{S without i} |S|! (k − |S| − 1)! / k! · (closed(S + i) − closed(S)),

so that shares add up to what all effects close together, and equal effects have equal shares. Of
more than four effects some orders are drawn, each with its reverse; shares still add up.

Source: Shapley 1953; Lindeman, Merenda and Gold 1980 (shares of explained variance); Mitchell and
others 2022 (orders with their reverse).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.gap.replay import Replay
from ident.diagnosis.gap.residuals import RunResidual
from ident.inference.conclusion import Conclusion
from ident.records import JsonRecord
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.results import ONE_RUN

# Largest number of effects for which all orders are taken (chosen: work).
ALL_ORDERS = 4
# Number of orders drawn for more (chosen: work).
DRAWN_ORDERS = 24


@dataclass(frozen=True, eq=False)
class Improvement:
    """Gain of the accepted effects on held-out runs."""

    # Shapley share of the reducible gap of each effect, in the order of acceptance.
    shares: Float[Array, " k"]
    forward: Replay  # the replayed motion, without and with the effects
    # Energy error of each run, joint by joint [J], without the effects and with them.
    runs_before: Float[Array, "R n"]
    runs_after: Float[Array, "R n"]

    @property
    def energy_before(self) -> Float[Array, " n"]:
        """Mean energy error of a run without the effects, joint by joint [J]."""
        return np.asarray(self.runs_before.mean(axis=0))

    @property
    def energy_after(self) -> Float[Array, " n"]:
        """Mean energy error of a run with the effects, joint by joint [J]."""
        return np.asarray(self.runs_after.mean(axis=0))

    def to_dict(self, joints: Sequence[str]) -> JsonRecord:
        """Its entries of the record's `heldout`, figures by joint name.

        Args:
            joints: Names of the arm's joints.

        Returns:
            `energy_error_before_J`, `energy_error_after_J`, their standard deviations over the runs
            (`spreads`), and `forward` (the replay).
        """

        def by_joint(values: Array) -> dict[str, float]:
            return dict(zip(joints, map(float, values), strict=True))

        def spread(energies: Float[Array, "R n"]) -> dict[str, float] | None:
            std = spread_of_runs(energies)
            return None if std is None else by_joint(std)

        return {
            "energy_error_before_J": by_joint(self.energy_before),
            "energy_error_after_J": by_joint(self.energy_after),
            **spreads(spread(self.runs_before), spread(self.runs_after)),
            "forward": self.forward.to_dict(joints),
        }


def spread_of_runs(energies: Float[Array, "R ..."]) -> Float[Array, "..."] | None:
    """Standard deviation over the runs (first axis); None for a single run."""
    return None if len(energies) < 2 else np.asarray(np.std(energies, axis=0))


def energy_spread(energies: Float[Array, "R k"]) -> float | None:
    """Standard deviation over runs of joints' energy error together [J]; None for a single run."""
    spread = spread_of_runs(energies.sum(axis=1))
    return None if spread is None else float(spread)


def spreads(before: Any, after: Any) -> JsonRecord:
    """The record's standard deviations of energy errors over runs.

    Args:
        before, after: Without and with the effects; None for a single run.

    Returns:
        `energy_error_before_std_J`, `energy_error_after_std_J`, and where they are None
        `energy_error_std_missing`, which says why.
    """
    record = {"energy_error_before_std_J": before, "energy_error_after_std_J": after}
    if before is None:
        record["energy_error_std_missing"] = ONE_RUN
    return record


def measure_improvement(
    conclusion: Conclusion,
    given: HeldOut,
    series: Sequence[RunResidual],
    forward: Replay,
    floors: Float[Array, " n"],
    seed: int,
) -> Improvement:
    """Measures the gain of the accepted effects.

    Args:
        conclusion, given: The names, and held-out scores with the untuned URDF.
        series, forward: Residuals of all runs, and the replayed motion.
        floors, seed: Floor of each joint's error [N m]; seed of drawn orders.
    """
    # An absorbed effect closes nothing beside tuned inertias: its share is computed with the
    # URDF's.
    absorbed = any(name.absorbed for name in conclusion.names)
    scorer = given if absorbed else conclusion.held_out
    return Improvement(
        shares=shapley_shares(scorer, conclusion.groups, floors, seed),
        forward=forward,
        runs_before=np.array([run_energy(item, item.unseen_before) for item in series]),
        runs_after=np.array([run_energy(item, item.unseen_after) for item in series]),
    )


def run_energy(item: RunResidual, left: Float[Array, "t n"]) -> Float[Array, " n"]:
    """Energy error of a run, joint by joint [J]: minus the work of the residual.

    Args:
        item: The run.
        left: Its residual torque [N m]; only where it is valid it counts.
    """
    return -np.trapezoid(left * item.valid * item.speed, dx=item.step, axis=0)


def shapley_shares(
    held_out: HeldOut, groups: Sequence[Group], floors: Float[Array, " n"], seed: int
) -> Float[Array, " k"]:
    """Share of the reducible held-out mean square that each effect closes, averaged over orders.

    Args:
        held_out: Held-out scores of models.
        groups: The accepted effects, k of them.
        floors, seed: Floor of each joint's error [N m], and seed of the drawn orders.
    """
    left: dict[frozenset[int], Float[Array, " n"]] = {}

    def square_left(names: frozenset[int]) -> Float[Array, " n"]:
        """Held-out mean square beside some of the effects, each set scored once."""
        if names not in left:
            left[names] = held_out.score([groups[name] for name in sorted(names)]).rms ** 2
        return left[names]

    shares = np.zeros(len(groups))
    orders = _orders(len(groups), seed)
    nothing: frozenset[int] = frozenset()
    for order in orders:
        accepted = nothing
        for name in order:
            before = square_left(accepted)
            accepted = accepted | {name}
            closed = float(np.sum(before - square_left(accepted)))
            shares[name] += closed / len(orders)
    reducible = float(np.sum(np.maximum(square_left(nothing) - floors**2, 0.0)))
    return shares / max(reducible, 1e-12)


def _orders(count: int, seed: int) -> list[tuple[int, ...]]:
    """Orders of so many effects: all of few, and of many some, each with its reverse."""
    if count <= ALL_ORDERS:
        return list(permutations(range(count)))
    rng = np.random.default_rng(seed)
    drawn = [rng.permutation(count).tolist() for _ in range(DRAWN_ORDERS // 2)]
    orders = [tuple(order) for order in drawn]
    return [*orders, *(order[::-1] for order in orders)]
