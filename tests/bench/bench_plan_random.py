"""Two hundred random tasks, every returned plan checked again by other code at 10⁴ positions; and tasks without a plan.

    python tests/bench/bench_plan_random.py MODEL [TASKS [SECONDS]]

The methods take turns; each may make 2500 evaluations. SECONDS is the budget of time of a task, 20 if not given. The
reference screens briefly here, so that its own solver has a share of the work.

The check uses Pinocchio's inverse dynamics with the fitted model's own torque and Coal's parallel collision check;
nothing of the planner's compiled loops.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.model.hybrid import HybridModel
from plan.api.tasks import open_task
from plan.dynamics.torque_model import torque_of_model
from plan.geometry.boxes import Box
from plan.geometry.scene import Scene
from plan.initial.starts import straight
from plan.planners import Budget
from plan.planners.base import Planner
from plan.planners.evolution import Evolution
from plan.planners.genetic import PaperGenetic
from plan.planners.ppo import Ppo
from plan.planners.sequential import Sequential
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.solve import solve

BASE = Path(__file__).parents[1] / "plan/data/table3.toml"
CHECKED = 10_000
METHODS: tuple[Planner, ...] = (Evolution(), Ppo(), Sequential(named=True), PaperGenetic())
EVALUATIONS = 2500


def random_task(base: PlanningProblem, rng: np.random.Generator) -> PlanningProblem:
    """Start and goal free and not too near, up to three boxes, energy or time."""
    arm = base.scene.arm
    low, high = np.radians([-150.0, -100.0, -140.0]), np.radians([150.0, 100.0, 140.0])
    while True:
        boxes = [random_box(k, rng) for k in range(rng.integers(0, 4))]
        scene = Scene.build(arm, boxes)
        ends = rng.uniform(low, high, (2, 3))
        if scene.separation(ends).min() > 0.02 and np.abs(ends[1] - ends[0]).max() > 0.3:
            break
    need = float(np.max(np.abs(ends[1] - ends[0]) / arm.velocity_limit[:3]))
    duration = need * rng.uniform(2.0, 5.0)
    objective = "energy" if rng.random() < 0.6 else "time"
    return replace(
        base,
        scene=scene,
        start=ends[0],
        goal=ends[1],
        vias=straight(ends[0], ends[1], 2),
        durations=np.full(3, duration / 3),
        objective=objective,
        free="vias" if objective == "energy" else "both",
    )


def random_box(number: int, rng: np.random.Generator) -> Box:
    place = rng.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 0.9])
    return Box(f"box {number}", 0, random_rotation(rng), place, rng.uniform(0.03, 0.15, 3))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.linalg.det(q)


def faults(task: PlanningProblem, model: HybridModel, result: PlanResult) -> list[str]:
    """What an independent look at 10⁴ positions finds broken."""
    assert result.splines is not None
    times = np.linspace(0.0, float(result.splines.total[0]), CHECKED)
    q, dq, ddq = result.splines.at(times)
    rest = np.zeros((CHECKED, len(model.joint_names) - 3))
    tau = model.torque(*(np.hstack([part, rest]) for part in (q, dq, ddq)))[:, :3]
    limits, found = task.limits, []
    if task.scene.proximity.collides(q).any():
        found.append("collision")
    if (np.abs(tau) > limits.torque * (1 + 1e-6)).any():
        found.append(f"torque {np.max(np.abs(tau) / limits.torque):.4f}")
    if (np.abs(dq) > limits.speed * (1 + 1e-6)).any():
        found.append("speed")
    if (q < limits.lower - 1e-9).any() or (q > limits.upper + 1e-9).any():
        found.append("position")
    return found


def main(folder: str, count: int, seconds: float) -> None:
    model = HybridModel.load(folder)
    base = open_task(BASE, None, "energy", "absolute", None, None, 1).problem
    base = replace(base, model=torque_of_model(model, 3, [0.0, 0.0, 0.0]))
    rng = np.random.default_rng(2026)
    statuses, broken, spent, busy, unsolved = Counter[str](), [], [], [], []
    for i in range(count):
        task, planner = random_task(base, rng), METHODS[i % len(METHODS)]
        started, method = (time.perf_counter(), time.process_time()), planner.name
        result = solve(task, method, i, Budget(EVALUATIONS, seconds), gap=False, planner=planner)
        spent.append(time.perf_counter() - started[0])
        busy.append(time.process_time() - started[1])
        statuses[result.status] += 1
        if result.solved:
            bad = faults(task, model, result)
            if bad:
                broken.append((i, method, bad))
        else:
            unsolved.append((i, method, result.reason))
        if (i + 1) % 10 == 0:
            print(f"{i + 1} tasks, {dict(statuses)}, broken: {len(broken)}, CPU {sum(busy):.0f} s", file=sys.stderr)
    print(f"{count} random tasks: {dict(statuses)}; median {np.median(spent):.2f} s, longest {max(spent):.2f} s")
    print(f"processor time: median {np.median(busy):.2f} s, longest {max(busy):.2f} s")
    print(f"plans that break anything in the independent check: {len(broken)} {broken}")
    for line in unsolved:
        print("  no plan:", *line)
    impossible(base)


def impossible(base: PlanningProblem) -> None:
    """Tasks without a plan: each has a status and a reason, within the budget."""
    tip = base.scene.arm.forward_kinematics(base.goal)["link_6"][:3, 3]
    walls = [Box(f"wall {x}", 0, np.eye(3), [x, 0.0, 0.85], [0.48, 0.01, 0.85]) for x in (-0.72, 0.72)]
    arm = base.scene.arm
    tasks = {
        "goal inside an obstacle": replace(base, scene=Scene.build(arm, [Box("crate", 0, np.eye(3), tip, [0.1] * 3)])),
        "goal out of the limits": replace(base, goal=np.radians([80.0, 300.0, -90.0])),
        "walls between start and goal": replace(
            base,
            scene=Scene.build(arm, walls),
            start=np.radians([-90.0, 40.0, 60.0]),
            goal=np.radians([90.0, 40.0, 60.0]),
            vias=np.radians([[-30.0, 40.0, 60.0], [30.0, 40.0, 60.0]]),
            durations=np.full(3, 1.0),
        ),
        "zero duration": replace(base, durations=np.zeros(3)),
        "too short a duration": replace(base, durations=np.full(3, 0.02)),
    }
    for name, task in tasks.items():
        for method in ("cma", "reference", "ppo"):
            started = time.perf_counter()
            result = solve(task, method, 0, Budget(6000, 20.0), gap=False)
            clock = time.perf_counter() - started
            spent = f"after {clock:.2f} s, {result.evaluations} evaluations"
            print(f"{name}, {method}: {result.status} {spent}: {result.reason}")


if __name__ == "__main__":
    rest = sys.argv[2:]
    main(sys.argv[1], int(rest[0]) if rest else 200, float(rest[1]) if len(rest) > 1 else 20.0)
