"""The obstacle task in the manner of Fig. 10: every seed with its costs, every method at equal terms.

    python tests/bench/bench_plan_obstacle.py MODEL [OUT]

Medians over the seeds, of which there are one to five. The paper does not print where its obstacle stands; ours is in
tests/plan/data/obstacle.toml.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from plan.api.planning import open_task, save_comparison
from plan.options import SolveOptions
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.planners.base import Planner
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential
from plan.problem.result import PlanResult
from plan.solving.compare import Comparison, cost_at
from plan.solving.solve import find_starts, solve

TASK = Path(__file__).parents[1] / "plan/data/obstacle.toml"
SEEDS = range(5)
SPENT = ("seconds", "cpu_seconds", "evaluations")
ROWS: dict[str, tuple[Planner, int]] = {
    "sqp, named": (Sequential(named=True), 3),
    "CMA-ES": (Evolution(), 5),
    "PPO, 2100 epochs as the paper": (Ppo(), 5),
    "GA as the paper, 100 × 200": (Genetic(), 5),
    "GA as the paper, 100 × 2000": (Genetic(generations=2000), 1),
}
ASKED: dict[str, Any] = {"evaluations": 10**8, "seconds": 3600.0, "gap": False}


def main(model: str, out: Path | None) -> None:
    opened = open_task(TASK, None if model == "none" else Path(model))
    starts = {seed: find_starts(opened.problem, np.random.default_rng(seed)) for seed in SEEDS}
    results: dict[str, list[PlanResult]] = {}
    for name, (planner, seeds) in ROWS.items():
        solve(opened.problem, SolveOptions(**ASKED | {"evaluations": 500}), planner, starts=starts[0])
        results[name] = [
            solve(opened.problem, SolveOptions(seed=seed, **ASKED), planner, starts=starts[seed])
            for seed in range(seeds)
        ]
        print(f"done: {name}", file=sys.stderr)
    print_table(results)
    print_seeds(results)
    if out is not None:
        flat = tuple(run for name in ROWS for run in results[name] if "2000" not in name)
        save_comparison(opened, Comparison("obstacle task", "energy", 2100, 1.0, flat), None, out)


def print_table(results: dict[str, list[PlanResult]]) -> None:
    best = min(float(np.median([r.cost for r in runs])) for runs in results.values())
    heads = ["method", "solved", "energy [J]", "worst", "at 2100 evaluations", "evaluations", "time [s]", "CPU [s]"]
    heads += ["clearance [mm]", "above the best [%]"]
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for name, runs in results.items():
        costs = np.array([r.cost for r in runs])
        at = np.median([cost_at(r, 2100, 0) for r in runs])
        clear = min(1000 * r.certificate.clearance.proven for r in runs if r.certificate)
        spent, busy, count = (np.median([getattr(r, key) for r in runs]) for key in SPENT)
        solved = f"{sum(r.solved for r in runs)}/{len(runs)}"
        middle = float(np.median(costs))
        print(
            f"| {name} | {solved} | {middle:.3f} | {costs.max():.3f} | {at:.3f} | {count:.0f} "
            f"| {spent:.2f} | {busy:.2f} | {clear:.1f} | {100 * (middle / best - 1):.2f} |"
        )


def print_seeds(results: dict[str, list[PlanResult]]) -> None:
    """Every seed of the first run: cost reached by each method, or why there is none."""
    methods = ["sqp, named", "CMA-ES", "PPO, 2100 epochs as the paper"]
    print("\n| seed | " + " | ".join(methods) + " | why not |\n|---|" + "---|" * (len(methods) + 1))
    tables = [{record["label"]: record for record in results[name][0].starts} for name in methods]
    for label in tables[0]:
        cells = []
        for table in tables:
            cost = table[label].get("cost")
            cells.append("–" if cost is None else f"{cost:.2f}")
        print(f"| {label} | " + " | ".join(cells) + f" | {tables[0][label]['reason']} |")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "none", Path(sys.argv[2]) if len(sys.argv) > 2 else None)
