"""How often the 95 % intervals of `ident fit` hold the truth, over simulated arms of several worlds.

Run: python tests/bench/bench_fit_coverage.py [--arms 40] [--seed 1] [--worlds quoted] [--modes consistent,base,nominal]
     [--longest 36] [--keep DIR]

Truth is the hidden arm's own figure, which is friction's at the session's start; beside it stands how often the mean
over the session's runs is inside. Worlds whose friction drifts more than it changes from run to run are told apart.
Half widths of losses are shares of the truth; those of base inertial parameters, of what is thought possible before
any data. `bias / doubt` is the mean error in standard errors of the figures.

Every arm's rows are kept in a file of their own as soon as they are there; arms whose file is there are not made anew.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.identification import HowToIdentify, Identified, identify
from ident.model.inertia import PRIOR_SHARE, base_prior, parameter_scale
from ident.model.loss import NAMES
from ident.robot.arm import ArmModel
from ident.sessions import open_sessions
from ident.simulation.hardware import Hardware
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.simulation.world import World, find_worlds

KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# A shorter run than this holds no whole motion [s].
LEAST_RUN_S = 8.0
# Name of the figures of inertias that the recordings know more of than was known before, and of the rest.
BASE, RESTING = "base parameter", "base, by URDF"
# An informed figure is one of whose prior variance the data take away this share.
INFORMED = 0.5

# One figure: error, error against the session's mean, half width, standard error.
Row = tuple[str, str, float, float, float, float]


def draw(seed: int, worlds: str, longest: float) -> World:
    """A world of the list, its session cut to a length and to as many runs as find room."""
    ranges = find_worlds(worlds)
    world = ranges[seed % len(ranges)].draw(np.random.default_rng([seed, 6]))
    duration = min(world.duration_s, longest)
    return replace(world, duration_s=duration, runs=min(world.runs, max(1, int(duration / LEAST_RUN_S))))


def measure(seed: int, world: World, modes: list[str]) -> list[Row]:
    """(mode, name, error, error against the session's mean, half width, standard error) of every figure."""
    done = simulate(SimulationOptions(robot=world.robot, seed=seed).in_world(world))
    opened = open_sessions([done.session], ArmModel.load(world.robot))
    rows: list[Row] = []
    for mode in modes:
        found = identify(opened.motions, opened.arm, HowToIdentify(mode))  # type: ignore[arg-type]
        rows += [(mode, *row) for row in _of_losses(found, done)]  # type: ignore[misc]
        rows += [(mode, *row) for row in _of_inertias(found, done.hardware)]  # type: ignore[misc]
    return rows


def _of_losses(found: Identified, done: Simulation) -> Iterator[tuple[str, float, float, float, float]]:
    loss, path = found.loss, done.hardware.friction_path
    mean = np.ones((2, len(loss.joints))) if path is None else path.mean(axis=0)  # of dry and viscous friction
    means = np.stack([np.ones(len(loss.joints)), mean[1], mean[0]], axis=1)
    limits: Float[Array, "n 4 2"] = loss.conf_int()
    std = np.sqrt(np.diagonal(loss.covariance, axis1=1, axis2=2))
    for j, joint in enumerate(loss.joints):
        for k, key in enumerate(KEYS):
            truth = done.answer.losses[joint][key]
            low, high = limits[j, k] / truth
            middle = 0.5 * (low + high)
            yield NAMES[k], middle - 1.0, middle - means[j, k], 0.5 * (high - low), std[j, k] / truth


def _of_inertias(found: Identified, hardware: Hardware) -> Iterator[tuple[str, float, float, float, float]]:
    if not found.inertias:
        return
    base, arm = found.inertia.base, hardware.arm
    truth = base.mapping @ true_inertias(hardware)
    prior = np.linalg.inv(base_prior(base, PRIOR_SHARE["consistent"] * parameter_scale(arm)))
    for k, figure in enumerate(found.inertias):
        scale = np.sqrt(prior[k, k])
        error = (0.5 * (figure.low + figure.high) - truth[k]) / scale
        name = BASE if figure.informed >= INFORMED else RESTING
        yield name, error, error, 0.5 * (figure.high - figure.low) / scale, found.inertia.std[k] / scale


def true_inertias(hardware: Hardware) -> Float[Array, " 10n"]:
    """The ten numbers of each link of an arm without added bodies."""
    bodies, numbers = hardware.bodies, []
    for j, own in enumerate(list(hardware.arm.model.inertias)[1:]):
        mass = bodies.mass_scale[j]
        moments = mass * bodies.inertia_scale[j] * own.inertia
        numbers.append(pin.Inertia(mass * own.mass, own.lever + bodies.com_shift[j], moments).toDynamicParameters())
    return np.concatenate(numbers)


def rows_of(seed: int, asked: argparse.Namespace) -> tuple[str, list[Row]]:
    """One arm's kind of friction and rows, from its file where there is one."""
    file = None if asked.keep is None else asked.keep / f"{seed}.json"
    if file is not None and file.is_file():
        record = json.loads(file.read_text(encoding="utf-8"))
        return record["friction"], [tuple(row) for row in record["rows"]]
    world = draw(seed, asked.worlds, asked.longest)
    friction = "drifting" if world.friction_drift > 2.0 * world.friction_spread else "steady"
    rows = measure(seed, world, asked.modes.split(","))
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        record = {"friction": friction, "world": world.to_dict(), "rows": rows}
        file.write_text(json.dumps(record, default=float), encoding="utf-8")
    return friction, rows


def print_table(total: dict[tuple[str, str, str], list[Array]]) -> None:
    """Coverage, bias and width of each kind of figure."""
    head = ("mode", "figure", "friction", "figures", "inside", "mean", "bias / doubt", "half width %")
    print("{:<12}{:<16}{:<10}{:>8}{:>8}{:>8}{:>16}{:>14}".format(*head))
    for (mode, name, friction), rows in sorted(total.items()):
        error, from_mean, half, std = np.array(rows, dtype=float).T
        share = error / std
        bias = f"{share.mean():.2f} ± {share.std() / np.sqrt(len(error)):.2f}"
        inside, mean = np.mean(np.abs(error) <= half), np.mean(np.abs(from_mean) <= half)
        told = f"{len(error):>8}{inside:>8.3f}{mean:>8.3f}{bias:>16}{100 * np.median(half):>14.2f}"
        print(f"{mode:<12}{name:<16}{friction:<10}{told}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worlds", default="quoted")
    parser.add_argument("--modes", default="consistent,base,nominal")
    parser.add_argument("--longest", type=float, default=36.0, help="longest session [s]")
    parser.add_argument("--keep", type=Path, default=None, help="folder of the arms' rows")
    asked = parser.parse_args()
    total: dict[tuple[str, str, str], list[Array]] = defaultdict(list)
    for seed in range(1000 * asked.seed, 1000 * asked.seed + asked.arms):
        try:
            friction, rows = rows_of(seed, asked)
        except InputError as error:
            print(f"{seed}: refused: {error}", flush=True)
            continue
        for mode, name, *figures in rows:
            total[mode, name, friction].append(np.array(figures, dtype=float))
            total[mode, name, "all"].append(np.array(figures, dtype=float))
    print_table(total)


if __name__ == "__main__":
    main()
