"""How narrow the intervals are that identification gets from a proposed motion, beside the textbook's motions.

    python tests/bench/bench_plan_excite.py [ARMS] [--robot tm5-900] [--minutes 1] [--evaluations 120] [--first SEED]

Each simulated arm has inertias, friction and noise of its own. The same regression identifies its
base parameters, viscous and Coulomb friction from as many seconds of each motion:

* excite: what `plan excite` proposes for the nominal arm;
* Fourier: one series of 8 s over and over in a single run, phases by chance, as large as it fits;
* condition: of as many such series as the proposal looked at, the one whose regressor has the least condition number.

All keep the same limits of position, speed and torque and touch nothing. Told is the half width of
the 95 % intervals, the median over all base parameters, each in units of the Fourier motion's; the
median error likewise; and how many intervals hold the truth.
"""

import argparse
import time

import numpy as np

from ident.arrays import Array
from ident.model.inertia import BaseParameters
from ident.robot.arm import ArmModel
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled
from plan.command_options import ExciteOptions
from plan.experiment.design import Designer
from plan.experiment.feasible import Feasibility
from plan.experiment.hypotheses import ask
from plan.experiment.run_set import SIZES, SPREAD, TEXTBOOK, duration_of
from plan.experiment.stage import Stage

# Ticks of which each is looked at once, and what noise is as a share of the rated torque.
THINNING, NOISE = 8, 0.005
# Standard deviation of a link's inertial numbers, as a share; speed at which dry friction is there
# [rad/s].
DIFFERENT, WIDTH = 0.2, 0.01
# Half width of a 95 % interval in standard deviations.
WIDE = 1.96


def series(feasible: Feasibility, seconds: float, draw: int) -> ReferenceMotion | None:
    """The textbook's Fourier series in a single run, the largest that fits; None if none does."""
    limits = feasible.limits
    figures = {name: value for name, value in TEXTBOOK.items() if name != SPREAD}
    for size in SIZES:
        stage = Stage(limits, 0, np.array(limits.centre), size, seconds, np.random.default_rng(draw))
        motion = sampled("fourier", stage.fourier(**{**figures, "draw": draw}))
        if feasible.allows(motion):
            return motion
    return None


def rows_of(arm: ArmModel, base: BaseParameters, runs: list[ReferenceMotion]) -> tuple[Array, Array]:
    """Regressor of base parameters and friction, and of all inertial numbers, in all samples of some runs."""
    tables, whole = [], []
    for run in runs:
        q, dq, ddq = (part[::THINNING] for part in (run.q, run.dq, run.ddq))
        regressor = np.asarray(arm.regressor(q, dq, ddq))
        friction = np.zeros((len(q), arm.n, 2 * arm.n))
        each = np.arange(arm.n)
        friction[:, each, each] = dq
        friction[:, each, arm.n + each] = np.tanh(dq / WIDTH)
        tables.append(np.concatenate([regressor[:, :, list(base.columns)], friction], axis=2))
        whole.append(np.concatenate([regressor, friction], axis=2))
    return np.concatenate(tables), np.concatenate(whole)


def identify(
    arm: ArmModel,
    base: BaseParameters,
    runs: list[ReferenceMotion],
    truth: Array,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Half widths of the base parameters' intervals, and their errors."""
    table, whole = rows_of(arm, base, runs)
    noise = NOISE * MotionLimits(arm).torque
    tau = whole @ truth + noise * rng.standard_normal(table.shape[:2])
    weighed = (table / noise[None, :, None]).reshape(-1, table.shape[2])
    wanted = (tau / noise).reshape(-1)
    estimate = np.linalg.lstsq(weighed, wanted, rcond=None)[0]
    widths = WIDE * np.sqrt(np.diag(np.linalg.inv(weighed.T @ weighed)))
    exact = base.mapping @ truth[: -2 * arm.n]
    return widths[: base.rank], np.abs(estimate[: base.rank] - exact)


def least_condition(
    arm: ArmModel,
    base: BaseParameters,
    feasible: Feasibility,
    seconds: float,
    tries: int,
    first: int,
) -> ReferenceMotion | None:
    """Of so many series the one whose regressor, its columns scaled to one length, has the least condition number."""
    best, least = None, np.inf
    for draw in range(first, first + tries):
        motion = series(feasible, seconds, draw)
        if motion is None:
            continue
        table = rows_of(arm, base, [motion])[0].reshape(-1, base.rank + 2 * arm.n)
        condition = np.linalg.cond(table / np.linalg.norm(table, axis=0))
        if condition < least:
            best, least = motion, condition
    return best


def measure(arm: ArmModel, number: int, options: argparse.Namespace) -> dict[str, tuple[Array, Array, float]]:
    """Widths, errors and length of each motion for one simulated arm."""
    rng = np.random.default_rng([number, 5])
    chosen = ExciteOptions(minutes=options.minutes, evaluations=options.evaluations, seed=number, floor="none")
    designer = Designer(arm, ask(arm, None, None, None), chosen)
    base = designer.predictor.baseline.base
    proposed = list(designer.best().runs)
    seconds = duration_of(proposed)
    fourier = series(designer.feasible, seconds, 1000 * number)
    condition = least_condition(arm, base, designer.feasible, seconds, options.evaluations, 1000 * number + 1)
    rated = MotionLimits(arm).torque
    friction = np.concatenate([0.05 * rated, 0.06 * rated]) * rng.uniform(0.5, 1.5, 2 * arm.n)
    inertia = arm.inertial_parameters * (1.0 + DIFFERENT * rng.standard_normal(arm.inertial_parameters.shape))
    truth = np.concatenate([inertia.reshape(-1), friction])
    motions = {"excite": proposed, "Fourier": [fourier], "condition": [condition]}
    found = {}
    for name, runs in motions.items():
        runs = [run for run in runs if run is not None]
        if runs:
            found[name] = (*identify(arm, base, runs, truth, rng), duration_of(runs))
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("arms", nargs="?", type=int, default=3)
    parser.add_argument("--robot", default="tm5-900")
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--evaluations", type=int, default=120)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    print(f"samples every {1000 * THINNING * TICK_S:g} ms; widths and errors in units of the Fourier motion's, medians")
    print("| arm | motion | seconds | interval | error | intervals that hold |")
    print("|---|---|---|---|---|---|")
    ratios: dict[str, list[float]] = {}
    arm = ArmModel.load(options.robot)
    for number in range(options.first, options.first + options.arms):
        began = time.process_time()
        found = measure(arm, number, options)
        if "Fourier" not in found:
            print(f"| {number} | no series fits | | | | |")
            continue
        widths, errors, _ = found["Fourier"]
        for name, (width, error, seconds) in found.items():
            ratio = float(np.median(width / widths))
            ratios.setdefault(name, []).append(ratio)
            held = float((error <= width).mean())
            wrong = float(np.median(error) / np.median(errors))
            print(
                f"| {number} | {name} | {seconds:.1f} | {ratio:.3f} | {wrong:.2f} | {held:.0%} |",
                flush=True,
            )
        print(f"  {time.process_time() - began:.0f} processor seconds", flush=True)
    for name, values in ratios.items():
        print(f"{name}: {np.median(values):.3f} median, {max(values):.3f} worst of {len(values)} arms")


if __name__ == "__main__":
    main()
