"""What the default net changes on runs that no fit has seen: torque and energy error with it over those without.

Run: IDENT_REAL_DATA=… python tests/bench/bench_net_splits.py [--seed 5]

Splits of real recordings (nine runs of a UR10e in random parts, halves of two Pandas and of a UR10) and of the shipped
ones. Energy error is the root mean square over the runs left out of all joints' work together, and of each joint's.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.model.evaluation import SessionScore, evaluate
from ident.model.hybrid import FitOptions, fit_hybrid
from ident.motion.motion import Motion, prepare
from ident.recordings.columns import match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from tests.ident.conftest import halves, load_sapienza, load_ur10e

Split = tuple[str, ArmModel, tuple[Motion, ...], tuple[Motion, ...]]
# Runs that the UR10e's fits take, and how many random draws of each.
DRAWS = ((3, 2), (4, 4), (6, 4))


def of_ur10e(folder: Path, rng: np.random.Generator) -> Iterator[Split]:
    """Random parts of the unloaded runs."""
    paths = sorted(p for p in folder.glob("ur10e/identification/*.csv") if "load" not in p.name or "unload" in p.name)
    motions = prepare(load_ur10e(folder, [path.name for path in paths]))
    arm = ArmModel.load(folder / "ur10e/ur10e.urdf")
    for size, draws in DRAWS:
        for _ in range(draws):
            order = rng.permutation(len(motions))
            train, test = ([motions[k] for k in part] for part in (order[:size], order[size:]))
            yield f"ur10e {size}/{len(test)}", arm, tuple(train), tuple(test)


def of_single_runs(folder: Path) -> Iterator[Split]:
    """Each half of a run from the other."""
    for name, path, robot in (
        ("panda", "panda/unisa_fer/panda_exciting_trajectory.db3", "panda"),
        ("ur10", "ur10_cb/ur10_exciting_trajectory.db3", "ur10"),
    ):
        arm = ArmModel.load(robot)
        run = match_joints(load_session(folder / path), arm.joint_names)[0].runs[0]
        yield from _halves(name, arm, run)
    yield from _halves("panda 1 kHz", ArmModel.load("panda"), load_sapienza(folder).runs[0])


def _halves(name: str, arm: ArmModel, run: Recording) -> Iterator[Split]:
    first, second = map(prepare, halves(run))
    yield f"{name} a > b", arm, first, second
    yield f"{name} b > a", arm, second, first


def of_shipped() -> Iterator[Split]:
    """The shipped recordings of the TM5-900, as the paper uses them and the other way round."""
    arm = ArmModel.load("tm5-900")
    runs = {name: prepare(load_session(data_path(f"logs/tm5_900/{name}"))) for name in ("T1", "T2", "E1", "E2")}
    train, test = runs["T1"] + runs["T2"], runs["E1"] + runs["E2"]
    yield "tm5 T > E", arm, train, test
    yield "tm5 E > T", arm, test, train


def _errors(score: SessionScore, rung: int) -> tuple[Array, Array]:
    """Torque RMSE and energy error of every joint and of all together."""
    work = np.concatenate([score.energy_error[rung], score.energy_error[rung].sum(axis=1, keepdims=True)], axis=1)
    return score.rmse_mean[rung], np.sqrt(np.mean(work**2, axis=0))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args()
    folder = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    torque, energy = [], []
    for splits in (of_ur10e(folder, np.random.default_rng(asked.seed)), of_single_runs(folder), of_shipped()):
        for name, arm, train, test in splits:
            score = evaluate(fit_hybrid(train, arm, FitOptions()).model, [(name, test)]).pooled
            without, with_net = (_errors(score, k) for k in (score.rungs.index("loss"), -1))
            torque.append(with_net[0] / without[0])
            energy.append(with_net[1] / without[1])
            seen = f"{without[0][-1]:8.3f} → {with_net[0][-1]:.3f} N m {without[1][-1]:8.2f} → {with_net[1][-1]:.2f} J"
            print(f"{name:<20}{seen}", flush=True)
    for name, ratios in (("torque", torque), ("energy", energy)):
        total = np.array([one[-1] for one in ratios])
        joints = np.concatenate([one[:-1] for one in ratios])
        means = [np.exp(np.nanmean(np.log(part))) for part in (total, joints)]
        worse = [int(np.sum(part > 1.005)) for part in (total, joints)]
        print(
            f"{name}: all joints {means[0]:.3f}, worse {worse[0]} of {len(total)}, worst {total.max():.2f}; "
            f"each joint {means[1]:.3f}, worse {worse[1]} of {len(joints)}"
        )


if __name__ == "__main__":
    main()
