"""How much of a net helps on runs that it never saw, joint by joint: all of it, a share, or nothing.

On what was held back, the prediction of a net that did not see it is compared with none. A joint's net counts with the
weight that leaves least torque error there, if that is surely less than without (by Student's test over stretches or
runs) and the energy error is not more by a standard error; else it is silent. Then joints let go until the energy error
of all of them together is no more either.

On 33 splits of real recordings and the shipped ones, torque error on unseen runs
falls to 0.73 of what it is without and the energy error of all joints to 0.66, geometric means. Energy grows in 8,
by 9 J at most: all of a UR10e whose first joint's friction differs by 3 % between runs and errs by 20 J in each,
whatever its model. Four other rules were measured on the same splits. Energy of whole runs instead of stretches: torque
0.80, energy 0.69, grows in 5. Half the net where that energy grows: 0.77, 0.68, in 7. The net with a viscous term that
takes its mean work off: 0.74, 0.76, in 11; or that makes the work on runs held back come out right: 0.73, 0.64, in 10.

Which samples a fit leaves out in turn, and over which of them its doubt is counted.

Whole runs are left out where there are two or more: stretches of a run whose other stretches were seen are foretold
too well, as they share its speeds and its friction. Of a single run, stretches of a few seconds are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int

# How sure it must be that a share of a net helps; chance alone passes one of the four shares once in 25 times at most.
SURE = 0.99
# Shares of a net that are tried.
WEIGHTS = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class JointGate:
    """What a joint's net did on runs that it never saw, and what was decided."""

    # Torque error where the joint moves, without the net and with the share that was decided on; with all of it where
    # that is nothing [N m].
    rmse_without: float
    rmse_with: float
    # Root mean square over the runs of the energy error, where it moves, likewise [J].
    energy_without: float
    energy_with: float
    weight: float  # share of the net that the joint keeps

    @property
    def kept(self) -> bool:
        """Whether the joint keeps any of its net."""
        return self.weight > 0.0

    def to_dict(self) -> dict[str, Any]:
        return {**vars(self), "kept": self.kept}


def shrink_net(
    predicted: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    witness: Int[Array, " T"],
    run: Int[Array, " T"] | None = None,
) -> tuple[JointGate, ...]:
    """The verdict on each joint's net.

    Args:
        predicted: Torque by a net that did not see the sample's part [N m].
        left: What the analytic model and the losses leave [N m].
        moving: Where each joint moves.
        travel: Displacement of each joint from sample to sample [rad].
        witness: Number of the run, or stretch of one, that a sample lies in: what doubt is counted over.
        run: Number of the run, over which energies are reported; the same if None.
    """
    groups = (witness, witness if run is None else run)
    return _shrink(predicted, left, moving, travel, groups, (_surely(witness), 1.0))


def shrink_bounded(
    predicted: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    witness: Int[Array, " T"],
    run: Int[Array, " T"],
) -> tuple[JointGate, ...]:
    """The verdict on what never leaves the torques that it saw: arguments as of `shrink_net`.

    The two tests change places: squares fall by one standard error, energies may not surely grow.
    """
    return _shrink(predicted, left, moving, travel, (witness, run), (1.0, _surely(witness)))


def shrink_between(
    by_block: Float[Array, "T n"],
    by_run: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    witness: Int[Array, " T"],
    run: Int[Array, " T"],
) -> tuple[JointGate, ...]:
    """The verdict half by blocks and half by whole runs left out: other arguments as of `shrink_net`.

    Blocks speak for more of the same motion, runs for another one. A joint that `shrink_bounded` gives
    a share by blocks keeps the mean of that and of the share that leaves least torque error of runs.
    Of a single run blocks alone speak.

    Args:
        by_block: Torque by what did not see the sample's block [N m].
        by_run: Torque by what did not see the sample's run [N m].
    """
    gate = shrink_bounded(by_block, left, moving, travel, witness, run)
    if len(np.unique(run)) < FEWEST_RUNS:
        return gate
    by_blocks = np.array([verdict.weight for verdict in gate])
    mean = 0.5 * (by_blocks + _best_share(by_run, left, moving))
    weight = np.where(by_blocks > 0.0, mean, 0.0)
    return _verdicts(by_block, left, moving, travel, run, weight)


def _best_share(
    predicted: Float[Array, "T n"], left: Float[Array, "T n"], moving: Bool[Array, "T n"]
) -> Float[Array, " n"]:
    """The share of each joint that leaves least torque error, none among them."""
    best = np.zeros(left.shape[1])
    least = np.where(moving, left**2, 0.0).sum(axis=0)
    for share in WEIGHTS:
        squares = np.where(moving, (left - share * predicted) ** 2, 0.0).sum(axis=0)
        best = np.where(squares < least, share, best)
        least = np.minimum(squares, least)
    return best


def _surely(witness: Int[Array, " T"]) -> float:
    """Standard errors that are sure over so many witnesses, by Student's test."""
    return float(stdtrit(max(1, len(np.unique(witness)) - 1), SURE))


def _shrink(
    predicted: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    groups: tuple[Int[Array, " T"], Int[Array, " T"]],
    doubts: tuple[float, float],
) -> tuple[JointGate, ...]:
    """The verdict; `doubts`: standard errors by which squares must fall, and energies may grow."""
    witness, run = groups
    needed, allowed = doubts

    def squares(weight: Array | float) -> Float[Array, "g n"]:
        return _by_group(np.where(moving, (left - weight * predicted) ** 2, 0.0), witness)

    without, own = (_by_group(np.where(moving, part * travel, 0.0), witness) for part in (left, predicted))
    best, weight = np.zeros(left.shape[1]), np.zeros(left.shape[1])
    alone = squares(0.0)
    for share in WEIGHTS:
        # Of all moving samples alike: a run in which a joint hardly moves says little of it.
        gain = alone - squares(share)
        doubt = gain.std(axis=0, ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.full(gain.shape[1], np.inf)
        helps = (gain.mean(axis=0) > needed * doubt) & ~_is_worse(without, without - share * own, allowed)
        weight = np.where(helps & (gain.mean(axis=0) > best), share, weight)
        best = np.where(weight == share, gain.mean(axis=0), best)
    # Joints go until the energy error of all joints together is no worse than without any net.
    together = without.sum(axis=1, keepdims=True)

    def mixed(choice: Array) -> Float[Array, "g 1"]:
        return (without - choice * own).sum(axis=1, keepdims=True)

    while weight.any() and _is_worse(together, mixed(weight), allowed)[0]:
        trials = [np.where(np.arange(len(weight)) == j, 0.0, weight) for j in np.flatnonzero(weight)]
        weight = min(trials, key=lambda choice: float(np.sum(mixed(choice) ** 2)))
    return _verdicts(predicted, left, moving, travel, run, weight)


def _verdicts(
    predicted: Float[Array, "T n"],
    left: Float[Array, "T n"],
    moving: Bool[Array, "T n"],
    travel: Float[Array, "T n"],
    run: Int[Array, " T"],
    weight: Float[Array, " n"],
) -> tuple[JointGate, ...]:
    """What each joint's share leaves of torque and work."""
    after = left - np.where(weight > 0.0, weight, 1.0) * predicted
    count = np.maximum(moving.sum(axis=0), 1.0)
    rmse = []
    energy = []
    for torque in (left, after):
        rmse.append(np.sqrt(np.where(moving, torque**2, 0.0).sum(axis=0) / count))
        work = _by_group(np.where(moving, torque * travel, 0.0), run)
        energy.append(np.sqrt(np.mean(work**2, axis=0)))
    return tuple(JointGate(*map(float, row)) for row in zip(*rmse, *energy, weight, strict=True))


def _is_worse(without: Float[Array, "g n"], with_net: Float[Array, "g n"], errors: float) -> Bool[Array, " n"]:
    """Whether squares over the groups grew by more than some standard errors of their change."""
    growth = with_net**2 - without**2
    doubt = growth.std(axis=0, ddof=1) / np.sqrt(len(growth)) if len(growth) > 1 else np.zeros(growth.shape[1])
    return np.asarray(growth.mean(axis=0) > errors * doubt)


def _by_group(values: Float[Array, "T n"], group: Int[Array, " T"]) -> Float[Array, "g n"]:
    labels, index = np.unique(group, return_inverse=True)
    sums = np.zeros((len(labels), values.shape[1]))
    np.add.at(sums, index, values)
    return sums


def describe_gate(gate: tuple[JointGate, ...], joints: tuple[str, ...], what: str = "residual net") -> str:
    """What each joint keeps of its net, or another learner, by what that never saw."""
    pairs = list(zip(joints, gate, strict=True))
    share = {one: "" if one.weight == 1.0 else f"by {100 * one.weight:.0f} %: " for one in gate}
    kept = [f"{name} ({share[one]}{_figures(one)})" for name, one in pairs if one.kept]
    silent = [f"{name} ({_figures(one)})" for name, one in pairs if not one.kept]
    parts = [f"kept for {', '.join(kept)}"] if kept else []
    if silent:
        parts.append(f"left out for {', '.join(silent)}: no surely better torque there, or worse energy")
    return f"{what}, on runs held back: {'; '.join(parts)}"


def _figures(one: JointGate) -> str:
    torque = f"{one.rmse_without:.3g} → {one.rmse_with:.3g} N m"
    return f"{torque}, {one.energy_without:.2g} → {one.energy_with:.2g} J a run"


# Parts that are held back in turn, and the length of the stretches that make them where runs are few [samples].
FOLDS, STRETCH = 4, 200
# Fewer runs than this can't be left out whole. Of two, half of all data is missing, and yet: stretches of one motion
# foretell one another whatever a net made up, and on a dual arm with two such runs a net doubled the error on a third.
FEWEST_RUNS = 2


def make_folds(
    lengths: Sequence[int], every: int, rng: np.random.Generator
) -> tuple[Int[Array, " T"], Int[Array, " T"]]:
    """Parts to be left out, and groups to be counted as one witness each; a number a sample.

    Args:
        lengths: Samples of each run, after thinning.
        every: One of how many samples was kept.
        rng: Spreads the groups over the parts.
    """
    runs = np.repeat(np.arange(len(lengths)), lengths)
    groups = runs
    if len(lengths) < 2 * FOLDS:  # stretches of runs; none goes on into the next run
        size = min(max(1, STRETCH // every), max(1, sum(lengths) // (2 * FOLDS)))
        counts = [max(1, round(length / size)) for length in lengths]
        firsts = np.cumsum([0, *counts])
        parts = zip(firsts, counts, lengths, strict=False)
        groups = np.concatenate([first + np.arange(n) * count // max(n, 1) for first, count, n in parts])
    shared = runs if len(lengths) >= FEWEST_RUNS else groups
    sizes = np.bincount(shared)
    order = rng.permutation(len(sizes))
    filled, part = np.zeros(FOLDS), np.zeros(len(sizes), dtype=int)
    for group in order[np.argsort(-sizes[order], kind="stable")]:  # the largest first: parts of about the same size
        part[group] = int(np.argmin(filled))
        filled[part[group]] += sizes[group]
    return part[shared], groups
