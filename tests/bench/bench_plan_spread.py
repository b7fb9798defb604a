"""How far the default plans of cluttered tasks depend on chance.

    python tests/bench/bench_plan_spread.py [TASKS] [--joints 3,6] [--boxes 12] [--objectives energy,time]
                                            [--seeds 10] [--first SEED] [--seconds SECONDS] [--rows FILE]

Each drawn task is solved from every seed. A task's spread is the dearest plan's cost above the
cheapest's; beside it stands how many seeds lie within half a per cent of the cheapest, and the
processor seconds of a plan. FILE gets a line for each plan, and the summary speaks of all its
lines: so a long run can be made in pieces, and two versions compared.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from plan.command_options import SolveOptions
from plan.solving.solve import solve
from tests.bench.bench_plan_optimum import arm_of, draw, torque_of

# Costs this near the cheapest count as the same, as a share of it.
SAME = 0.005


@dataclass(frozen=True)
class Plan:
    """One plan's figures; the cost is infinite where there is none."""

    task: str
    seed: int
    cost: float
    seconds: float
    evaluations: int
    label: str


def measure(options: argparse.Namespace, joints: int, objective: str, number: int) -> list[Plan]:
    """A task's plans from all seeds."""
    arm = arm_of(joints)
    rng = np.random.default_rng([joints, options.boxes, number])
    task = draw(arm, torque_of(arm, None), objective, options.boxes, rng)
    name = f"{joints} joints, {objective}, {options.boxes} boxes, {number}"
    plans = []
    for seed in range(options.seeds):
        result = solve(task, SolveOptions(seed=seed, seconds=options.seconds, gap=False))
        cost = result.cost if result.solved else np.inf
        reached = {row["label"]: row.get("cost") for row in result.starts}
        costs = {label: value for label, value in reached.items() if value is not None}
        label = min(costs, key=lambda key: costs[key]) if costs else ""
        plans.append(Plan(name, seed, cost, result.cpu_seconds, result.evaluations, label))
    return plans


def describe(plans: list[Plan]) -> str:
    """A task's row of the table."""
    costs = np.array([plan.cost for plan in plans])
    spread = costs.max() / costs.min() - 1.0
    same = int((costs <= costs.min() * (1.0 + SAME)).sum())
    seconds = np.mean([plan.seconds for plan in plans])
    return f"| {plans[0].task} | {costs.min():.4f} | {spread:.2%} | {same} of {len(plans)} | {seconds:.2f} |"


def show(plans: list[Plan]) -> None:
    """The table of all tasks, and its summary."""
    print("| task | cheapest | spread | within 0.5 % | CPU [s] |")
    print("|---|---|---|---|---|")
    names = list(dict.fromkeys(plan.task for plan in plans))
    spreads = []
    above = []
    for name in names:
        same = [plan for plan in plans if plan.task == name]
        print(describe(same))
        costs = np.array([plan.cost for plan in same])
        spreads.append(costs.max() / costs.min() - 1.0)
        above.extend(costs / costs.min() - 1.0)
    print(
        f"spread {np.median(spreads):.2%} median, {np.max(spreads):.2%} worst; tasks within 0.5 %: ",
        end="",
    )
    print(f"{int((np.array(spreads) <= SAME).sum())} of {len(spreads)}")
    print(f"a plan above its task's cheapest: {np.mean(above):.2%} mean, {np.quantile(above, 0.9):.2%} nine in ten")
    print(f"processor seconds of a plan: {np.mean([plan.seconds for plan in plans]):.2f} mean")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=3)
    parser.add_argument("--joints", default="3,6")
    parser.add_argument("--boxes", type=int, default=12)
    parser.add_argument("--objectives", default="energy,time")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=None)
    parser.add_argument("--rows", type=Path, default=None)
    options = parser.parse_args()
    warm = draw(arm_of(3), torque_of(arm_of(3), None), "time", 1, np.random.default_rng(0))
    solve(warm, SolveOptions(evaluations=300, seconds=60.0, gap=False))  # compiled loops are compiled first
    plans: list[Plan] = []
    for joints in map(int, options.joints.split(",")):
        for objective in options.objectives.split(","):
            for number in range(options.first, options.first + options.tasks):
                found = measure(options, joints, objective, number)
                print(describe(found), flush=True)
                plans.extend(found)
                if options.rows is not None:
                    with options.rows.open("a") as stream:
                        for plan in found:
                            stream.write(json.dumps(asdict(plan)) + "\n")
    if options.rows is not None:
        plans = [Plan(**json.loads(text)) for text in options.rows.read_text().splitlines()]
    show(plans)


if __name__ == "__main__":
    main()
