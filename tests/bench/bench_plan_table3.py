"""Table 3's task: brute force, genetic algorithms, PPO and gradients on the named knots, side by side.

    python tests/bench/bench_plan_table3.py MODEL [MODEL …]

Each MODEL is a folder of `ident fit` (`none` for the rigid arm without losses). Times are of the search alone, medians
over the seeds; the first run of a method, which compiles and builds graphs, is told as "cold" too. Ratios are of
processor time, which a busy machine stretches less.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from plan.api.planning import open_task
from plan.dynamics.power import METRICS
from plan.options import SolveOptions, TaskOptions
from plan.paper.brute_force import BruteForce
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.planners.base import Planner
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult, certify
from plan.solving.solve import solve

TASK = Path(__file__).parents[1] / "plan/data/table3.toml"
PAPER = {"initial": 51.11, "brute": 45.46, "ga": 45.73, "ppo": 46.68}
# Every method with its number of seeds.
ROWS: dict[str, tuple[Planner, int]] = {
    "brute force, 11⁶": (BruteForce(), 1),
    "sqp, named": (Sequential(named=True), 5),
    "CMA-ES": (Evolution(), 5),
    "GA as the paper, 100 × 200, in batches": (Genetic(), 5),
    "GA as the paper, one child at a time": (Genetic(serial=True), 1),
    "PPO, 500 epochs as the paper": (Ppo(epochs=500), 5),
    "PPO, 250 epochs": (Ppo(epochs=250), 5),
}


def problem_of(model: str, metric: str = "absolute") -> PlanningProblem:
    folder = None if model == "none" else Path(model)
    return open_task(TASK, folder, TaskOptions(metric=metric)).problem


def run(problem: PlanningProblem, planner: Planner, seed: int) -> PlanResult:
    return solve(problem, SolveOptions(seed=seed, evaluations=20_000_000, seconds=3600.0, gap=False), planner)


def methods(model: str) -> PlanResult:
    """Prints every method's row; returns brute force's result."""
    problem = problem_of(model)
    print(f"\n## {model}: every method, absolute metric\n")
    print(
        "| method | energy [J] | worst seed | above the reference [%] | evaluations | time [s] | CPU [s] | cold [s] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    found, reference = {}, None
    for name, (planner, seeds) in ROWS.items():
        started = time.perf_counter()
        runs = [run(problem, planner, 0)]
        cold = time.perf_counter() - started
        runs += [run(problem, planner, seed) for seed in range(1, seeds)]
        print(f"done: {name}", file=sys.stderr)
        found[name] = (runs, cold)
        reference = float(np.median([r.cost for r in runs])) if name == "sqp, named" else reference
    assert reference is not None
    for name, (runs, cold) in found.items():
        costs = np.array([r.cost for r in runs])
        middle, worst = float(np.median(costs)), float(costs.max())
        spent, busy = (float(np.median([getattr(r, key) for r in runs])) for key in ("seconds", "cpu_seconds"))
        print(
            f"| {name} | {middle:.4f} | {worst:.4f} | {100 * (middle / reference - 1):.3f} | {runs[0].evaluations} "
            f"| {spent:.4f} | {busy:.4f} | {cold:.2f} |"
        )
    clock = {name: float(np.median([r.cpu_seconds for r in runs])) for name, (runs, _) in found.items()}
    for ga in ("GA as the paper, 100 × 200, in batches", "GA as the paper, one child at a time"):
        for ppo in ("PPO, 500 epochs as the paper", "PPO, 250 epochs"):
            print(f"\n{ppo}: 1/{clock[ga] / clock[ppo]:.0f} of the time of {ga}")
    return found["brute force, 11⁶"][0][0]


def metrics(model: str, absolute: PlanResult) -> None:
    print(f"\n## {model}: table 3 by every metric\n")
    print("| metric | initial | brute | reference | below the initial [%] | PPO 500 | brute's via points [deg] |")
    print("|---|---|---|---|---|---|---|")
    for metric in METRICS:
        problem = problem_of(model, metric)
        initial = certify(problem, problem.decode(problem.initial)).energy[metric]
        brute = absolute if metric == "absolute" else run(problem, BruteForce(), 0)
        reference, ppo = (run(problem, planner, 0) for planner in (Sequential(named=True), Ppo(epochs=500)))
        assert brute.splines is not None
        vias = np.degrees(brute.splines.points[0, 1:-1]).round(1).tolist()
        gain = 100 * (1 - reference.cost / initial)
        costs = f"{initial:.3f} | {brute.cost:.3f} | {reference.cost:.3f} | {gain:.2f} | {ppo.cost:.3f}"
        print(f"| {metric} | {costs} | {vias} |")
    paper_points(model)


def paper_points(model: str) -> None:
    """The paper's own four trajectories, by every metric of this model."""
    print("\n| the paper's via points | printed [J] | " + " | ".join(METRICS) + " |")
    print("|---|---|" + "---|" * len(METRICS))
    points = {
        "initial": [60, 10, -110, 70, 20, -100],
        "brute": [59.0, 10.5, -112.5, 72.5, 22.5, -99.0],
        "ga": [59.7, 10.7, -112.4, 72.4, 22.9, -98.6],
        "ppo": [59.2, 12.4, -115.2, 72.6, 24.1, -99.9],
    }
    problem = problem_of(model)
    for name, row in points.items():
        energy = certify(problem, problem.decode(np.radians(row))).energy
        print(f"| {name} | {PAPER[name]} | " + " | ".join(f"{energy[metric]:.3f}" for metric in METRICS) + " |")


if __name__ == "__main__":
    for folder in sys.argv[1:] or ["none"]:
        metrics(folder, methods(folder))
