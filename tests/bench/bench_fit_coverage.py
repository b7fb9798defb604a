"""How often the 95 % intervals of `ident fit` hold the truth, over simulated arms of several worlds.

Run: python tests/bench/bench_fit_coverage.py [--arms 40] [--seed 1] [--worlds quoted] [--modes consistent,base,nominal]

Truth is the hidden arm's own figure, which is friction's at the session's start; beside it stands how often the mean
over the session's runs is inside. Worlds whose friction drifts more than it changes from run to run are told apart.
Half widths and errors are shares of the truth; `bias / doubt` is the mean error in standard errors of the figures.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.identification import identify
from ident.model.loss import NAMES
from ident.opening import open_sessions
from ident.plant.simulate import SimulationOptions, simulate
from ident.plant.world_presets import find_worlds
from ident.robot.arm import ArmModel

KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Sessions stay short: tens of arms are to take minutes [s].
LONGEST_S = 60.0


Row = tuple[float, float, float, float]


def measure(seed: int, worlds: str, modes: list[str]) -> dict[tuple[str, str], list[Row]]:
    """(error, error against the session's mean, half width, standard error) of every figure, as shares of the truth."""
    ranges = find_worlds(worlds)
    world = ranges[seed % len(ranges)].draw(np.random.default_rng([seed, 6]))
    world = replace(world, duration_s=min(world.duration_s, LONGEST_S))
    done = simulate(SimulationOptions(robot=world.robot, seed=seed).in_world(world))
    opened = open_sessions([done.session], ArmModel.load(world.robot))
    drifts = "drifting" if world.friction_drift > 2.0 * world.friction_spread else "steady"
    path = done.hardware.friction_path
    mean = np.ones((2, opened.arm.n)) if path is None else path.mean(axis=0)  # of dry and viscous friction
    means = np.stack([np.ones(opened.arm.n), mean[1], mean[0]], axis=1)
    found = defaultdict(list)
    for mode in modes:
        loss = identify(opened.motions, opened.arm, mode).loss  # type: ignore[arg-type]
        limits: Float[Array, "n 4 2"] = loss.conf_int()
        std = np.sqrt(np.diagonal(loss.covariance, axis1=1, axis2=2))
        for j, joint in enumerate(loss.joints):
            for k, key in enumerate(KEYS):
                truth = done.answer.losses[joint][key]
                low, high = limits[j, k] / truth
                middle = 0.5 * (low + high)
                row = (middle - 1.0, middle - means[j, k], 0.5 * (high - low), std[j, k] / truth)
                found[f"{mode}, {drifts}", NAMES[k]].append(row)
    return dict(found)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worlds", default="quoted")
    parser.add_argument("--modes", default="consistent,base,nominal")
    asked = parser.parse_args()
    total = defaultdict(list)
    for seed in range(1000 * asked.seed, 1000 * asked.seed + asked.arms):
        try:
            for key, rows in measure(seed, asked.worlds, asked.modes.split(",")).items():
                total[key] += rows
        except InputError as error:
            print(f"{seed}: refused: {error}")
    head = ("mode, friction", "figure", "figures", "inside", "mean", "bias / doubt", "half width %")
    print("{:<24}{:<16}{:>8}{:>8}{:>8}{:>16}{:>14}".format(*head))
    for (mode, name), rows in sorted(total.items()):
        error, from_mean, half, std = np.array(rows).T
        share = error / std
        bias = f"{share.mean():.2f} ± {share.std() / np.sqrt(len(error)):.2f}"
        inside, mean = np.mean(np.abs(error) <= half), np.mean(np.abs(from_mean) <= half)
        middle = 100 * np.median(half)
        print(f"{mode:<24}{name:<16}{len(rows):>8}{inside:>8.3f}{mean:>8.3f}{bias:>16}{middle:>14.2f}")


if __name__ == "__main__":
    main()
