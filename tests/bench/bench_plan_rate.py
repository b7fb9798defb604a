"""Hybrid evaluations a second against the machine's own matrix products.

    python tests/bench/bench_plan_rate.py [MODEL …]

One thread throughout. A trajectory of table 3's task has 30 nodes; a net's work is two operations a weight and node.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

from plan.api.planning import open_task
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets
from plan.dynamics.power import METRICS, ChainTorque, energy

TASK = Path(__file__).parents[1] / "plan/data/table3.toml"
BATCH = 500
NODES = 30


def rate(work: Callable[[], object], amount: float) -> float:
    """Amount a second of processor time, the median of nine runs."""
    work()
    times = []
    for _ in range(9):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return amount / float(np.median(times))


def paper_net() -> CompiledDenseNet:
    """256-512-1024-512-256, as in the paper."""
    widths, rng = [9, 256, 512, 1024, 512, 256, 3], np.random.default_rng(0)
    return CompiledDenseNet([(rng.normal(size=(a, b)) / np.sqrt(a), np.zeros(b)) for a, b in pairwise(widths)])


def main(models: list[str]) -> None:
    torch.set_num_threads(1)
    a, b = torch.randn(1024, 1024), torch.randn(1024, 1024)
    peak = rate(lambda: a @ b, 2 * 1024**3) / 1e9
    print(f"matrix products, float32, one thread: {peak:.1f} GFLOP/s\n")
    print("| model | products a node | trajectories / s | node torques / s | net GFLOP/s | of matrix products [%] |")
    print("|---|---|---|---|---|---|")
    problems = {model: open_task(TASK, None if model == "none" else Path(model)).problem for model in models}
    last = problems[models[-1]]
    assert isinstance(last.model, ChainTorque)
    problems["the paper's net, random weights"] = replace(last, model=replace(last.model, net=paper_net()))
    for model, problem in problems.items():
        x = problem.initial + np.random.default_rng(0).normal(size=(BATCH, 6)) * 0.1
        splines = problem.decode(x)
        hybrid = problem.model
        assert isinstance(hybrid, ChainTorque)
        whole = rate(partial(energy, hybrid, splines, METRICS[2]), BATCH)
        net = hybrid.net
        nets = () if net is None else net.joints if isinstance(net, CompiledJointNets) else (net.layers,)
        weights = sum(w.size for layers in nets for w, _ in layers)
        flops = 2.0 * weights * NODES * whole / 1e9
        search = rate(partial(problem.evaluate, x), BATCH)
        print(f"| {model} | {weights} | {whole:,.0f} | {whole * NODES:,.0f} | {flops:.1f} | {100 * flops / peak:.0f} |")
        print(f"| … with limits and self-collision | | {search:,.0f} | | | |")


if __name__ == "__main__":
    main(sys.argv[1:] or ["none"])
