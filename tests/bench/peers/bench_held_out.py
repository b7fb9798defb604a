"""Held-out torque on twelve real arms: `ident fit` without and with its net, plain least squares, boosted trees.

    python -m tests.bench.peers.bench_held_out [--only UR10e,xMate] [--programs fit,trees] [--splits 1] [--out FILE]

Every program gets the same neutral motions (see `held_out_sets`) and foretells the torque of the held-out ones. Torque
passes through one zero-phase filter and is scored where the joint moves: the root of the mean over joints of the mean
square error [N m], and the root mean square over the runs of the error of work, all joints together [J]. Three splits.

Plain least squares: base parameters, Coulomb, viscous friction and an offset a joint, no weights, no bounds. Trees:
histogram boosting of a joint on what that leaves, from all states, the load and the last 0.8 s. A GRU: what it leaves
as a sequence (see `recurrent_net`). `worst joint` is the largest error of a joint over that of `fit` without net.
Recordings: IDENT_REAL_DATA.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.inertia import BaseParameters, base_parameters
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.bench.peers.held_out_sets import SPLITS, HeldOutSet, read_sets

# What counts as motion [rad/s].
MOVING_RAD_S = 0.02
# Boosted trees: spacing and length of the history [s], rounds, rate, leaves and samples of a leaf.
LAG_S, HISTORY_S = 0.1, 0.8
ROUNDS, RATE, LEAVES, LEAST_LEAF = 200, 0.06, 15, 40
MOST_ROWS = 40_000
# Length of a GRU's windows [s].
WINDOW_S = 2.0

# Torque of held-out runs, on the filtered grid.
Forecast = list[Float[Array, "t n"]]
Program = Callable[[ArmModel, Sequence[Motion], Sequence[Motion]], Forecast]


def moves(motion: Motion) -> Array:
    """Where each joint moves, on the filtered grid."""
    return np.abs(motion.dq[motion.coarse]) > MOVING_RAD_S


def plain_columns(arm: ArmModel, base: BaseParameters, motion: Motion) -> Float[Array, "t n p"]:
    """Columns of plain least squares, of all joints side by side."""
    rows = arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns))
    losses = np.stack([motion.dq, np.sign(motion.dq), np.ones_like(motion.dq)], axis=-1)
    wide = np.zeros((*motion.q.shape, 3 * arm.n))
    for joint in range(arm.n):
        wide[:, joint, 3 * joint : 3 * joint + 3] = losses[:, joint]
    return motion.filtered(np.concatenate([rows, wide], axis=2))


def plain_least_squares(arm: ArmModel, train: Sequence[Motion], test: Sequence[Motion]) -> Forecast:
    base = base_parameters(arm)
    weights = _solve_plain(arm, base, train)
    return [plain_columns(arm, base, motion) @ weights for motion in test]


def _solve_plain(arm: ArmModel, base: BaseParameters, train: Sequence[Motion]) -> Array:
    sums = 0.0
    moment = 0.0
    for motion in train:
        columns = plain_columns(arm, base, motion)[moves(motion)]
        sums = sums + columns.T @ columns
        moment = moment + columns.T @ motion.tau_filtered[moves(motion)]
    scale = np.sqrt(np.maximum(np.diag(sums), 1e-12))
    return np.linalg.lstsq(sums / np.outer(scale, scale), moment / scale, rcond=1e-9)[0] / scale


def tree_inputs(motion: Motion, load: Float[Array, "t n"], joint: int) -> Float[Array, "t f"]:
    """All states and loads now, the joint's own over the last 0.8 s."""
    now = [channel[motion.coarse] for channel in (motion.q, motion.dq, motion.ddq)]
    own = np.column_stack([channel[:, joint] for channel in (*now, load)])
    interval = motion.interval * motion.lowpass.factor
    parts = [*now, load]
    for lag in np.arange(LAG_S, HISTORY_S + 1e-9, LAG_S):
        shift = round(lag / interval)
        before = np.concatenate([np.repeat(own[:1], min(shift, len(own)), axis=0), own])[: len(own)]
        parts.append(before)
    return np.concatenate(parts, axis=1)


def boosted_trees(arm: ArmModel, train: Sequence[Motion], test: Sequence[Motion]) -> Forecast:
    from sklearn.ensemble import HistGradientBoostingRegressor

    base = base_parameters(arm)
    weights = _solve_plain(arm, base, train)
    known = [[plain_columns(arm, base, motion) @ weights for motion in runs] for runs in (train, test)]
    found = [part.copy() for part in known[1]]
    every = 1 + sum(motion.filtered_length for motion in train) // MOST_ROWS
    for joint in range(arm.n):
        inputs = [tree_inputs(run, torque, joint) for run, torque in zip(train, known[0], strict=True)]
        left = [run.tau_filtered - torque for run, torque in zip(train, known[0], strict=True)]
        there = [moves(run)[:, joint] for run in train]
        x = np.concatenate([part[own] for part, own in zip(inputs, there, strict=True)])[::every]
        y = np.concatenate([part[own, joint] for part, own in zip(left, there, strict=True)])[::every]
        trees = HistGradientBoostingRegressor(
            max_iter=ROUNDS,
            learning_rate=RATE,
            max_leaf_nodes=LEAVES,
            min_samples_leaf=min(LEAST_LEAF, max(5, len(y) // 20)),
            l2_regularization=1.0,
            random_state=0,
        )
        trees.fit(x, y)
        for run, torque, out in zip(test, known[1], found, strict=True):
            out[:, joint] += trees.predict(tree_inputs(run, torque, joint))
    return found


def gated_recurrent(arm: ArmModel, train: Sequence[Motion], test: Sequence[Motion], stopped: bool = False) -> Forecast:
    """A GRU over all joints' states, trained on windows of what plain least squares leaves."""
    from tests.bench.peers.recurrent_net import Sequences, foretell_left

    base = base_parameters(arm)
    weights = _solve_plain(arm, base, train)
    runs = []
    for run in train:
        torque = plain_columns(arm, base, run) @ weights
        runs.append(Sequences(_sequence(run, torque), run.tau_filtered - torque, moves(run)))
    plain = [plain_columns(arm, base, run) @ weights for run in test]
    asked = [_sequence(run, torque) for run, torque in zip(test, plain, strict=True)]
    window = max(8, round(WINDOW_S / (train[0].interval * train[0].lowpass.factor)))
    left = foretell_left(runs, asked, window, stopped)
    return [torque + further for torque, further in zip(plain, left, strict=True)]


def _sequence(motion: Motion, torque: Float[Array, "t n"]) -> Float[Array, "t f"]:
    """What the GRU sees at each instant: all states and loads."""
    states = [channel[motion.coarse] for channel in (motion.q, motion.dq, motion.ddq)]
    return np.concatenate([*states, torque], axis=1)


def fitted(**options: Any) -> Program:
    """`ident fit` with some options."""

    def program(arm: ArmModel, train: Sequence[Motion], test: Sequence[Motion]) -> Forecast:
        model = fit_hybrid(train, arm, FitOptions(**options)).model
        return [run.filtered(model.torque(run.q, run.dq, run.ddq)) for run in test]

    return program


PROGRAMS: dict[str, Program] = {
    "fit": fitted(net="none"),
    "fit + net": fitted(),
    "plain": plain_least_squares,
    "trees": boosted_trees,
    "GRU": gated_recurrent,
    "GRU stopped": partial(gated_recurrent, stopped=True),
}


def score(runs: Sequence[Motion], foretold: Forecast) -> tuple[Float[Array, " n"], float]:
    """Torque RMSE of each joint [N m], and RMS over the runs of the error of their work [J]."""
    squares = np.zeros(runs[0].q.shape[1])
    counts = np.zeros(runs[0].q.shape[1])
    works = []
    for run, torque in zip(runs, foretold, strict=True):
        left = np.where(moves(run), torque - run.tau_filtered, 0.0)
        squares += (left**2).sum(axis=0)
        counts += moves(run).sum(axis=0)
        step = run.interval * run.lowpass.factor
        works.append(float((left * run.dq[run.coarse]).sum() * step))
    return np.sqrt(squares / np.maximum(counts, 1.0)), float(np.sqrt(np.mean(np.square(works))))


@dataclass(frozen=True)
class Row:
    """A program on one split."""

    torque: float  # RMSE over the joints [N m]
    work: float  # RMS error over the runs [J]
    worst_joint: float  # largest error of a joint over that of `fit` without a net; NaN where that was not asked for
    seconds: float  # processor time


def measure(recorded: HeldOutSet, names: Sequence[str], splits: int) -> dict[str, list[Row]]:
    """Every program on the first splits."""
    rows: dict[str, list[Row]] = {name: [] for name in names}
    for train, test in islice(recorded.splits(), splits):
        without_net = np.full(recorded.arm.n, np.nan)
        for name in names:
            start = time.process_time()
            foretold = PROGRAMS[name](recorded.arm, train, test)
            seconds = time.process_time() - start
            torque, work = score(test, foretold)
            if name == "fit":
                without_net = torque
            worst = float(np.max(torque / without_net))
            rows[name].append(Row(float(np.sqrt(np.mean(torque**2))), work, worst, seconds))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="names of sets, with commas")
    parser.add_argument("--programs", default=",".join(PROGRAMS), help="programs, with commas")
    parser.add_argument("--splits", type=int, default=SPLITS, help="how many of the splits")
    parser.add_argument("--out", type=Path, help="JSON of all figures")
    asked = parser.parse_args()
    names = [name for name in asked.programs.split(",") if name]
    folder = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    table = {}
    print(f"{'set':<13}{'program':<13}{'N m, by split':>26}{'mean':>9}{'J':>9}{'worst joint':>13}{'s':>7}")
    for recorded in read_sets(folder, [name for name in asked.only.split(",") if name]):
        table[recorded.name] = measure(recorded, names, asked.splits)
        for name, rows in table[recorded.name].items():
            print(f"{recorded.name:<13}{name:<13}{describe(rows)}", flush=True)
    if asked.out is not None:
        asked.out.write_text(json.dumps(table, indent=1, default=vars), encoding="utf-8")


def describe(rows: Sequence[Row]) -> str:
    """A line's figures: torque of each split, then means over them, of joints' errors the worst."""
    splits = " ".join(f"{row.torque:8.4f}" for row in rows)
    torque = np.mean([row.torque for row in rows])
    work = np.mean([row.work for row in rows])
    worst = max(row.worst_joint for row in rows)
    seconds = np.mean([row.seconds for row in rows])
    return f"{splits}{torque:9.4f}{work:9.3f}{worst:13.3f}{seconds:7.1f}"


if __name__ == "__main__":
    main()
