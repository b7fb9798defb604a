"""Plans as moved beside plans as planned: the column "Act." of the paper's Table 4, on simulated arms.

    python tests/bench/bench_plan_act.py [PLANS] [--arms A] [--first SEED] [--each K] [--rows FILE] [--narrow]

An arm is drawn, a session of it simulated and a model of all its joints fitted; PLANS random tasks (energy and time by
turns, up to two boxes) are planned on that model and run on the same arm, as `ident simulate --plan` does. Then K plans
on each of A other drawn arms, each with a model of its own. A model tells an interval of a plan's energy only where it
was fitted: so the session holds, beside the usual motions, some through the positions that tasks are drawn from and as
fast as the limits allow, and plans stay inside what it saw (`--stay-inside`). `--narrow`: neither.

"Act." is the integral of |effort · velocity| of the log, "Mo." what the model says of the executed motion; torque is
the largest effort as a share of the limit that the plan had to keep, as the log reads it (through a median of five
samples) and as it is without the sensors' noise; the drives of the simulated arm end at it. FILE gets a line a plan.
"""

import argparse
import json
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w
from scipy.ndimage import median_filter

from ident.api.fitting import fit_hybrid
from ident.command_options import FitOptions
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate
from ident.trajectories.kinds import REST_S
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.plan_record import PLAN_REST_S, read_plan
from ident.trajectories.reference import ReferenceMotion, via_spline
from plan.api.planning import solve
from plan.geometry.scene import Scene
from plan.problem.result import PlanResult
from tests.bench.bench_plan_checked import draw

EVALUATIONS = 100
# Wide and fast motions of a session (and as many back), points of each, how far from zero they lie [rad], and the share
# of the limits that the fastest state uses by the arm as its maker knows it: friction takes some of the rest.
WIDE, POINTS, FAR, FULL = 6, 6, 2.4, 0.85


def wide_motions(arm: ArmModel, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Splines through random places of the tasks' range, as fast as speed and torque allow; each and its way back."""
    limits, found = MotionLimits(arm), list[ReferenceMotion]()
    low, high = np.maximum(limits.lower, -FAR), np.minimum(limits.upper, FAR)
    while len(found) < 2 * WIDE:
        points = rng.uniform(low, high, (POINTS, arm.n))
        path = via_spline("wide", points, 1.0)
        if (path.q < limits.lower).any() or (path.q > limits.upper).any() or limits.touches(path.q):
            continue
        fast, slow = 0.3, 30.0
        while slow - fast > 0.01:
            middle = 0.5 * (slow + fast)
            fast, slow = (fast, middle) if used(arm, via_spline("wide", points, middle)) < FULL else (middle, slow)
        motion = via_spline("wide", points, slow)
        found += [motion.held(REST_S, REST_S), motion.reversed("wide").held(REST_S, REST_S)]
    return found


def used(arm: ArmModel, motion: ReferenceMotion) -> float:
    """Largest use of the limits of speed and torque, by the arm's nominal masses and a guess of its rotors."""
    q, dq, ddq = (part[::10] for part in (motion.q, motion.dq, motion.ddq))
    rotor = (arm.effort_limit / 157.0) ** 1.55
    torque = np.abs(arm.inverse_dynamics(q, dq, ddq)) + rotor * np.abs(ddq)
    return float(max((torque / arm.effort_limit).max(), (np.abs(dq) / arm.velocity_limit).max()))


def plans_of(model: HybridModel, count: int, seed: int, folder: Path, inside: bool) -> list[PlanResult]:
    """Solved plans of random tasks, saved as plan_K.json; a task beyond the model's training is drawn again."""
    arm, rng, found = model.robot, np.random.default_rng([2031, seed]), []
    free = Scene.build(arm)
    while len(found) < count:
        scene = {"robot": "tm5-900", **draw(arm, free, rng, boxes=int(rng.integers(3)))}
        scene.pop("payload", None)
        (folder / "scene.toml").write_text(tomli_w.dumps(scene))
        objective = ("energy", "time")[len(found) % 2]
        try:
            path, spend = folder / "scene.toml", EVALUATIONS
            result = solve(
                path, model, objective=objective, evaluations=spend, gap=False, inside=inside, beyond=not inside
            )
        except InputError:  # an end inside a box, or beyond the training
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


@dataclass(frozen=True)
class Row:
    """One plan: energies of the log, of the same motion without noise, and of the model, with the told half width [J];
    largest torque as read and as is, as shares of the limit; executed duration beyond the planned one, as a share."""

    arm: int
    act: float
    still: float
    planned: float
    half: float
    read: float
    real: float
    longer: float


def one_arm(seed: int, count: int, narrow: bool) -> list[Row]:
    """Fits a model of an arm, plans on it, moves the arm by the plans."""
    arm, usual = ArmModel.load("tm5-900"), SimulationOptions(seed=seed)
    training = list(simulate(usual).session.runs)
    if not narrow:
        wide = wide_motions(arm, np.random.default_rng([2032, seed]))
        seen = simulate(replace(usual, seed=seed + 5_000, arm_seed=seed), motions=wide).session.runs
        training += [replace(run, time=run.time + training[-1].time[-1] + 60.0) for run in seen]
    model = fit_hybrid(Session("training", tuple(training), robot="tm5-900"), arm, FitOptions()).model
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results = plans_of(model, count, seed, folder, not narrow)
        motions = [read_plan(folder / f"plan_{k}.json", arm) for k in range(count)]
    options = SimulationOptions(seed=seed + 10_000, arm_seed=seed, runs=count)
    logs, quiet = (simulate(replace(options, noise=noise), motions=motions).session.runs for noise in (1.0, 0.0))
    rows = []
    for result, log, still in zip(results, logs, quiet, strict=True):
        certificate = result.certificate
        assert certificate is not None
        half = certificate.energy_half_width  # none is reported of a motion beyond the model's training
        energy, torque = moved(log)
        read, real = torque / arm.effort_limit, np.abs(still.effort).max(axis=0) / arm.effort_limit
        planned = dict(certificate.time_law.energy)["absolute"]
        shown = np.nan if half is None else half
        assert result.splines is not None
        longer = float(still.time[-1] - still.time[0] - 2.0 * PLAN_REST_S) / float(result.splines.total[0]) - 1.0
        rows.append(Row(seed, energy, moved(still)[0], planned, shown, float(read.max()), float(real.max()), longer))
    return rows


def tell(name: str, rows: list[Row]) -> None:
    act, still, planned, half, read, real, longer = np.array([list(asdict(row).values())[1:] for row in rows]).T
    off, shown = act / planned - 1.0, np.isfinite(half)
    inside, really = np.abs(act - planned) <= half, np.abs(still - planned) <= half
    print(
        f"{name}: {len(rows)} plans, energy off by {off.mean():+.2%} mean, {np.abs(off).max():.2%} worst, "
        f"{(np.abs(off) <= 0.02).sum()} within 2 %, intervals for {shown.sum()}, which hold for {inside.sum()} "
        f"as read and {really.sum()} as is; largest torque {real.max():.1%} of its limit, the drive's end "
        f"{(real > 0.9999).sum()} times; as read {read.max():.1%}, {(read > 1.0).sum()} above; "
        f"executed duration {np.abs(longer).max():.2%} off at most",
        flush=True,
    )
    if shown.any():
        print(f"{name}: half widths of {np.median((half / planned)[shown]):.2%} of the energy (median)", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plans", nargs="?", type=int, default=30)
    parser.add_argument("--arms", type=int, default=10)
    parser.add_argument("--each", type=int, default=3)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--rows", type=Path, default=None)
    parser.add_argument("--narrow", action="store_true")
    options = parser.parse_args()
    others: list[Row] = []
    for k in range(options.arms + 1):
        count = options.each if k else options.plans
        if count == 0:
            continue
        rows = one_arm(options.first + k, count, options.narrow)
        tell(f"arm {options.first + k}", rows)
        others += rows if k else []
        if options.rows is not None:
            with options.rows.open("a") as stream:
                stream.writelines(json.dumps(asdict(row)) + "\n" for row in rows)
    if others:
        tell(f"{options.arms} other arms", others)
    print(f"{time.process_time():.0f} s of processor time")


if __name__ == "__main__":
    main()
