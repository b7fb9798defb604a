"""Held-out torque on twelve real arms: `ident fit` without and with its net, plain least squares, boosted trees.

    python -m tests.bench.peers.bench_held_out [--only UR10e,xMate] [--without trees] [--out TABLE.json]

Every program gets the same neutral motions (see `held_out_sets`) and foretells the torque of the held-out ones. Torque
passes through one zero-phase filter and is scored where the joint moves: the root of the mean over joints of the mean
square error [N m], and the root mean square over the runs of the error of work, all joints together [J]. Three splits.

Plain least squares: base parameters, Coulomb, viscous friction and an offset a joint, no weights, no bounds. Trees:
histogram boosting of a joint on what that leaves, from all states, the load and the last 0.8 s. A GRU: what it leaves
as a sequence. Recordings: IDENT_REAL_DATA.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.inertia import BaseParameters, base_parameters
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.bench.peers.held_out_sets import HeldOutSet, read_sets

# What counts as motion [rad/s].
MOVING_RAD_S = 0.02
# Boosted trees: spacing and length of the history [s], rounds, rate, leaves and samples of a leaf.
LAG_S, HISTORY_S = 0.1, 0.8
ROUNDS, RATE, LEAVES, LEAST_LEAF = 200, 0.06, 15, 40
MOST_ROWS = 40_000
# GRU: width, epochs, length of a window [s].
WIDTH, EPOCHS, WINDOW_S = 32, 30, 2.0

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


def gated_recurrent(arm: ArmModel, train: Sequence[Motion], test: Sequence[Motion]) -> Forecast:
    """A GRU over all joints' states, trained on windows of what plain least squares leaves."""
    import torch

    torch.manual_seed(0)
    base = base_parameters(arm)
    weights = _solve_plain(arm, base, train)
    known = [[plain_columns(arm, base, motion) @ weights for motion in runs] for runs in (train, test)]

    def inputs(motion: Motion, torque: Array) -> Array:
        return np.concatenate([*(part[motion.coarse] for part in (motion.q, motion.dq, motion.ddq)), torque], axis=1)

    seen = [inputs(run, torque) for run, torque in zip(train, known[0], strict=True)]
    left = [run.tau_filtered - torque for run, torque in zip(train, known[0], strict=True)]
    mean, std = np.concatenate(seen).mean(axis=0), np.concatenate(seen).std(axis=0) + 1e-9
    scale = np.concatenate(left).std(axis=0) + 1e-9
    window = max(8, round(WINDOW_S / (train[0].interval * train[0].lowpass.factor)))
    cut = []
    for x, y, run in zip(seen, left, train, strict=True):
        for start in range(0, max(1, len(x) - window), max(1, window // 2)):
            part = slice(start, start + window)
            if len(x[part]) == window:
                cut.append(((x[part] - mean) / std, y[part] / scale, moves(run)[part]))
    stacked = [torch.tensor(np.stack(part), dtype=torch.float32) for part in zip(*cut, strict=True)]
    net = torch.nn.GRU(len(mean), WIDTH, batch_first=True)
    head = torch.nn.Linear(WIDTH, arm.n)
    optimiser = torch.optim.Adam([*net.parameters(), *head.parameters()], lr=5e-3, weight_decay=1e-4)
    for _ in range(EPOCHS):
        order = torch.randperm(len(stacked[0]))
        for first in range(0, len(order), 32):
            x, y, mask = (part[order[first : first + 32]] for part in stacked)
            optimiser.zero_grad()
            ((mask * (head(net(x)[0]) - y) ** 2).sum() / mask.sum().clamp(min=1.0)).backward()
            optimiser.step()
    found = []
    with torch.inference_mode():
        for run, torque in zip(test, known[1], strict=True):
            x = torch.tensor((inputs(run, torque) - mean) / std, dtype=torch.float32)[None]
            found.append(torque + scale * head(net(x)[0])[0].numpy())
    return found


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
}


def score(runs: Sequence[Motion], found: Forecast) -> tuple[float, float]:
    """Torque RMSE over the joints [N m], and RMS over the runs of the error of their work [J]."""
    squares, counts, works = 0.0, 0.0, []
    for run, torque in zip(runs, found, strict=True):
        left = np.where(moves(run), torque - run.tau_filtered, 0.0)
        squares = squares + (left**2).sum(axis=0)
        counts = counts + moves(run).sum(axis=0)
        step = run.interval * run.lowpass.factor
        works.append(float((left * run.dq[run.coarse]).sum() * step))
    return float(np.sqrt(np.mean(squares / np.maximum(counts, 1.0)))), float(np.sqrt(np.mean(np.square(works))))


def measure(recorded: HeldOutSet, names: Sequence[str]) -> dict[str, list[tuple[float, float, float]]]:
    """Torque error, work error and processor time of each program on each split."""
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in names}
    for train, test in recorded.splits():
        for name in names:
            start = time.process_time()
            found = PROGRAMS[name](recorded.arm, train, test)
            rows[name].append((*score(test, found), time.process_time() - start))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="names of sets, with commas")
    parser.add_argument("--programs", default=",".join(PROGRAMS), help="programs, with commas")
    parser.add_argument("--out", type=Path, help="JSON of all figures")
    asked = parser.parse_args()
    names = [name for name in asked.programs.split(",") if name]
    folder = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    table = {}
    print(f"{'set':<13}{'program':<11}{'N m, three splits':>26}{'mean':>9}{'J':>9}{'s':>7}")
    for recorded in read_sets(folder, [name for name in asked.only.split(",") if name]):
        table[recorded.name] = measure(recorded, names)
        for name, rows in table[recorded.name].items():
            torque, work, seconds = np.array(rows).T
            splits = " ".join(f"{value:8.4f}" for value in torque)
            print(
                f"{recorded.name:<13}{name:<11}{splits}{torque.mean():9.4f}{work.mean():9.3f}{seconds.mean():7.1f}",
                flush=True,
            )
    if asked.out is not None:
        asked.out.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
