"""Plans as moved beside plans as planned: the column "Act." of the paper's Table 4, on simulated arms.

    python tests/bench/bench_plan_act.py [PLANS] [--arms A] [--first SEED] [--each K]

An arm is drawn, a session of it simulated and a model of all its joints fitted; PLANS random tasks (energy and time by
turns, up to two boxes) are planned on that model and run on the same arm, as `ident simulate --plan` does. Then K plans
on each of A other drawn arms. "Act." is the integral of |effort · velocity| of the log, "Mo." what the model says of
the executed motion; torque is the largest effort of the log, through a median of five samples, as a share of the limit
that the plan had to keep. A log whose torque sensor reads all but right is another matter: sensors have their own gain.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w
from scipy.ndimage import median_filter

from ident.api.fitting import fit_hybrid
from ident.model.hybrid import FitOptions, HybridModel
from ident.plant.simulate import SimulationOptions, simulate
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.trajectories.plan_files import read_plan
from plan.api.planning import solve
from plan.geometry.scene import Scene
from plan.problem.result import PlanResult
from tests.bench.bench_plan_checked import draw

EVALUATIONS = 300


def plans_of(model: HybridModel, count: int, seed: int, folder: Path) -> list[PlanResult]:
    """Solved plans of random tasks, saved as plan_K.json."""
    arm, rng, found = model.robot, np.random.default_rng([2031, seed]), []
    free = Scene.build(arm)
    while len(found) < count:
        scene = {"robot": "tm5-900", **draw(arm, free, rng)}
        scene["obstacle"] = scene["obstacle"][:2]
        (folder / "scene.toml").write_text(tomli_w.dumps(scene))
        objective = ("energy", "time")[len(found) % 2]
        try:
            result = solve(folder / "scene.toml", model, objective=objective, evaluations=EVALUATIONS, gap=False)
        except Exception as error:  # an end inside a box
            print(f"refused: {error}", flush=True)
            continue
        if result.solved:
            result.save(folder / f"plan_{len(found)}.json")
            found.append(result)
    return found


def moved(run: Recording) -> tuple[float, np.ndarray]:
    """Absolute energy [J] and the largest torque of each joint [N m] of a log."""
    assert run.velocity is not None
    energy = float(np.trapezoid(np.abs(run.effort * run.velocity).sum(axis=1), run.time))
    return energy, np.abs(median_filter(run.effort, (5, 1))).max(axis=0)


def one_arm(seed: int, count: int) -> list[tuple[float, float, float | None, float]]:
    """Energy as moved and as planned [J], the told half width [J], and the largest share of torque, plan by plan."""
    arm = ArmModel.load("tm5-900")
    model = fit_hybrid(simulate(SimulationOptions(seed=seed)).session, arm, FitOptions()).model
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results = plans_of(model, count, seed, folder)
        motions = [read_plan(folder / f"plan_{k}.json", arm) for k in range(count)]
    options = SimulationOptions(seed=seed + 10_000, arm_seed=seed, runs=count)
    rows = []
    for result, run in zip(results, simulate(options, motions=motions).session.runs, strict=True):
        assert result.certificate is not None
        energy, torque = moved(run)
        planned = dict(result.certificate.time_law.energy)["absolute"]
        rows.append((energy, planned, result.certificate.energy_half_width, float((torque / arm.effort_limit).max())))
    return rows


def tell(name: str, rows: list[tuple[float, float, float | None, float]]) -> None:
    act, planned = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    half, torque = np.array([row[2] for row in rows], dtype=float), np.array([row[3] for row in rows])
    off, inside = act / planned - 1.0, np.abs(act - planned) <= half
    print(
        f"{name}: {len(rows)} plans, energy off by {off.mean():+.2%} mean, {np.abs(off).max():.2%} worst, "
        f"{(np.abs(off) <= 0.02).sum()} within 2 %, {inside.sum()} within the told interval "
        f"(± {np.median(half / planned):.2%} of the energy); largest torque {torque.max():.1%} of its limit, "
        f"{(torque > 1.0).sum()} above",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plans", nargs="?", type=int, default=30)
    parser.add_argument("--arms", type=int, default=10)
    parser.add_argument("--each", type=int, default=3)
    parser.add_argument("--first", type=int, default=500)
    options = parser.parse_args()
    print("| plan | Act. [J] | Mo. [J] | off | told ± [J] | torque |\n|---|---|---|---|---|---|")
    rows = one_arm(options.first, options.plans)
    for k, (act, planned, half, torque) in enumerate(rows):
        print(f"| {k} | {act:.2f} | {planned:.2f} | {act / planned - 1:+.2%} | {half:.2f} | {torque:.1%} |", flush=True)
    tell("one arm", rows)
    others = []
    for seed in range(options.first + 1, options.first + 1 + options.arms):
        found = one_arm(seed, options.each)
        tell(f"arm {seed}", found)
        others += found
    if others:
        tell(f"{options.arms} other arms", others)
    print(f"{time.process_time():.0f} s of processor time")


if __name__ == "__main__":
    main()
