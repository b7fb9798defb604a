"""Tables 4 to 7: taught via points against optimised ones, and time compression against learning.

    python tests/bench/bench_plan_taught.py MODEL [OUT]

The testers' via points are not published. Ours are drawn: a way round the box by random trees, its nodes moved by up
to 12°, kept if the motion of four seconds is free: five trials each of three "testers" (seeds). So the tables'
shape can be compared, not their joules. OUT gets the torques before and after (Fig. 13).
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plan.api.planning import open_task
from plan.initial.rrt_starts import find_seeds
from plan.initial.starts import from_vias
from plan.options import SolveOptions
from plan.paper.compression import Compression
from plan.paper.ppo import Ppo
from plan.paper.toppra import Toppra
from plan.planners import Budget, Ledger
from plan.planners.base import Planner
from plan.planners.compressed import start_compressed
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential
from plan.problem.problem import Free, PlanningProblem
from plan.problem.result import PlanResult, certify
from plan.show.pictures import draw_motion, save_figure
from plan.solving.solve import Starts, find_starts, solve

TASK = Path(__file__).parents[1] / "plan/data/obstacle.toml"
TRIALS = range(5)
SECONDS = 4.0
SPREAD = np.radians(12.0)
SPENT: dict[str, Any] = {"evaluations": 10**8, "seconds": 3600.0, "gap": False}


def base_problem(model: str) -> PlanningProblem:
    opened = open_task(TASK, None if model == "none" else Path(model))
    return replace(opened.problem, durations=np.full(3, SECONDS / 3))


def taught(problem: PlanningProblem, tester: int, trial: int) -> PlanningProblem:
    """Two via points as a person might teach them: clear of the box, and not the shortest way."""
    rng = np.random.default_rng([tester, trial])
    while True:
        seeds = [s for s in find_seeds(problem, rng) if not s.reason and 1 <= len(s.vias) <= 2]
        vias = seeds[rng.integers(len(seeds))].vias
        start = from_vias(problem, vias + rng.uniform(-SPREAD, SPREAD, vias.shape), f"tester {tester}", 2)
        if start.initial_evaluation.feasible[0] and not certify(start, start.decode(start.initial)).broken:
            return start


def optimise(start: PlanningProblem, planner: Planner, seed: int) -> PlanResult:
    return solve(start, SolveOptions(seed=seed, **SPENT), planner, starts=Starts((start,)))


def row(name: str, values: list[float]) -> None:
    print(f"done: {name}", file=sys.stderr)
    cells = " | ".join(f"{value:.3f}" for value in values)
    print(f"| {name} | {cells} | {np.mean(values):.3f} | {np.std(values, ddof=1):.3f} |")


def head(title: str) -> None:
    print(f"\n## {title}\n\n| | trial 1 | 2 | 3 | 4 | 5 | mean | STD |\n|---|---|---|---|---|---|---|---|")


def energy_tables(problem: PlanningProblem) -> tuple[list[PlanResult], list[PlanResult]]:
    head("Table 4: energy [J], absolute metric, four seconds")
    for tester in (1, 2, 3):
        starts = [taught(problem, tester, trial) for trial in TRIALS]
        row(f"tester {tester}", [certify(s, s.decode(s.initial)).energy["absolute"] for s in starts])
    seeds = {t: find_starts(problem, np.random.default_rng(t)) for t in TRIALS}
    found = {}
    planners: dict[str, Planner] = {"PPO": Ppo(), "CMA-ES": Evolution()}
    for name, planner in planners.items():
        found[name] = [solve(problem, SolveOptions(seed=t, **SPENT), planner, starts=seeds[t]) for t in TRIALS]
        row(name, [r.cost for r in found[name]])
    head("Table 5: energy [J] from tester 1's via points")
    starts = [taught(problem, 1, trial) for trial in TRIALS]
    row("tester 1", [certify(s, s.decode(s.initial)).energy["absolute"] for s in starts])
    improved = [optimise(s, Ppo(), t) for t, s in enumerate(starts)]
    row("PPO", [r.cost for r in improved])
    row("CMA-ES", [optimise(s, Evolution(), t).cost for t, s in enumerate(starts)])
    return found["PPO"], improved


def time_problem(problem: PlanningProblem, plan: PlanResult, free: Free) -> PlanningProblem:
    """Speed optimisation from an energy-optimised motion, as in section 3.3."""
    assert plan.splines is not None
    found = problem.with_initial(plan.splines, objective="time", free=free, label="energy optimum")
    return start_compressed(found)


def speed_table(title: str, problem: PlanningProblem, plans: list[PlanResult], out: Path | None) -> None:
    head(title)
    starts = [time_problem(problem, plan, "times") for plan in plans]
    both = [time_problem(problem, plan, "both") for plan in plans]
    factor = [optimise(s, Compression("factor"), 0) for s in starts]
    slow = [problem.with_initial(p.splines, objective="time", free="times") for p in plans if p.splines]
    once = [optimise(s, Compression("pass"), 0) for s in slow]
    sections = [optimise(s, Compression("sections"), 0) for s in slow]
    ppo = [optimise(s, Ppo(), t) for t, s in enumerate(starts)]
    rows = {
        "time compression, one factor": factor,
        "time compression, per section, one pass": once,
        "time compression, per section, in balance": sections,
        "PPO, time stamps": ppo,
        "sqp, named, time stamps": [optimise(s, Sequential(named=True), t) for t, s in enumerate(starts)],
        "PPO, time stamps and via points": [optimise(s, Ppo(), t) for t, s in enumerate(both)],
        "sqp, named, time stamps and via points": [optimise(s, Sequential(named=True), t) for t, s in enumerate(both)],
    }
    for name, runs in rows.items():
        row(f"{name} [s]", [r.cost for r in runs])
    bounds = []
    for start in starts:
        book = Toppra().run([start], Ledger(Budget(10**8, 3600.0)), np.random.default_rng(0))
        said = book.notes[-1].split(": ")[1].split(" s")[0]
        bounds.append(float(said) if said[0].isdigit() else float("nan"))
    row("toppra's bound on the energy optimum's path [s]", bounds)
    both_ppo, both_best = rows["PPO, time stamps and via points"], rows["sqp, named, time stamps and via points"]
    gains = {}
    for theirs, words in ((once, "one pass"), (factor, "one factor"), (sections, "sections in balance")):
        gains[f"PPO (time stamps) under {words} [%]"] = (ppo, theirs, -1)
        gains[f"PPO (both) under {words} [%]"] = (both_ppo, theirs, -1)
        gains[f"sqp (named, both) under {words} [%]"] = (both_best, theirs, -1)
    gains["PPO (time stamps) above sqp (named, time stamps) [%]"] = (ppo, rows["sqp, named, time stamps"], 1)
    gains["PPO (both) above the reference (both) [%]"] = (both_ppo, both_best, 1)
    for name, (ours, theirs, sign) in gains.items():
        row(name, [100 * sign * (a.cost / b.cost - 1) for a, b in zip(ours, theirs, strict=True)])
    everything = [run for runs in rows.values() for run in runs]
    broken = [run.reason for run in everything if not run.solved]
    peak = max(float(run.certificate.torque_share.max()) for run in everything if run.certificate)
    fast = max(float(run.certificate.speed_share.max()) for run in everything if run.certificate)
    print(f"\nplans: {len(everything)}, with a limit broken: {len(broken)}; peaks: torque {peak:.4f}, speed {fast:.4f}")
    if out is not None:
        save_figure(draw_motion(starts[0], ppo[0]), out / f"{title.split(':')[0].replace(' ', '_')}.png")


def main(model: str, out: Path | None) -> None:
    problem = base_problem(model)
    learned, improved = energy_tables(problem)
    speed_table("Table 6: time from the learned energy optimum", problem, learned, out)
    speed_table("Table 7: time from tester 1's via points, energy-optimised", problem, improved, out)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "none", Path(sys.argv[2]) if len(sys.argv) > 2 else None)
