"""Plans as moved beside plans as planned: the column "Act." of the paper's Table 4, on simulated arms.

    python tests/bench/bench_plan_act.py [PLANS] [--arms A] [--first SEED] [--each K]

An arm is drawn, a session of it simulated and a model of all its joints fitted; PLANS random tasks (energy and time by
turns, up to two boxes) are planned on that model and run on the same arm, as `ident simulate --plan` does. Then K plans
on each of A other drawn arms. "Act." is the integral of |effort · velocity| of the log, "Mo." what the model says of
the executed motion; torque is the largest effort as a share of the limit that the plan had to keep, as the log reads it
(through a median of five samples) and as it is without the sensors' noise; the drives of the simulated arm end at it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
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

EVALUATIONS = 100


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


def one_arm(seed: int, count: int) -> list[tuple[float, ...]]:
    """Energy as moved and as planned, the told half width [J], and the largest share of torque as read and as is."""
    arm = ArmModel.load("tm5-900")
    model = fit_hybrid(simulate(SimulationOptions(seed=seed)).session, arm, FitOptions()).model
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results = plans_of(model, count, seed, folder)
        motions = [read_plan(folder / f"plan_{k}.json", arm) for k in range(count)]
    options = SimulationOptions(seed=seed + 10_000, arm_seed=seed, runs=count)
    logs, quiet = (simulate(replace(options, noise=noise), motions=motions).session.runs for noise in (1.0, 0.0))
    rows = []
    for result, log, still in zip(results, logs, quiet, strict=True):
        certificate = result.certificate
        assert certificate is not None
        half = certificate.energy_half_width  # none is told of a motion beyond the model's training
        energy, torque = moved(log)
        read, real = torque / arm.effort_limit, np.abs(still.effort).max(axis=0) / arm.effort_limit
        planned = dict(certificate.time_law.energy)["absolute"]
        rows.append((energy, planned, np.nan if half is None else half, float(read.max()), float(real.max())))
    return rows


def tell(name: str, rows: list[tuple[float, ...]]) -> None:
    act, planned, half, read, real = np.array(rows).T
    off, inside = act / planned - 1.0, np.abs(act - planned) <= half
    print(
        f"{name}: {len(rows)} plans, energy off by {off.mean():+.2%} mean, {np.abs(off).max():.2%} worst, "
        f"{(np.abs(off) <= 0.02).sum()} within 2 %, an interval told for {np.isfinite(half).sum()}, which holds for "
        f"{inside.sum()}; largest torque {real.max():.1%} of its limit, the drive's end {(real > 0.9999).sum()} "
        f"times; as read {read.max():.1%}, {(read > 1.0).sum()} above",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plans", nargs="?", type=int, default=30)
    parser.add_argument("--arms", type=int, default=10)
    parser.add_argument("--each", type=int, default=3)
    parser.add_argument("--first", type=int, default=500)
    options = parser.parse_args()
    if options.plans:
        print(
            "| plan | Act. [J] | Mo. [J] | off | told ± [J] | torque as read | as is |\n|---|---|---|---|---|---|---|"
        )
        rows = one_arm(options.first, options.plans)
        for k, (act, planned, half, read, real) in enumerate(rows):
            figures = f"{act:.2f} | {planned:.2f} | {act / planned - 1:+.2%} | {half:.2f} | {read:.1%} | {real:.1%}"
            print(f"| {k} | {figures} |", flush=True)
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
