"""Whether a fit's 95 % intervals hold the true losses of arms that other code simulated, and how wide they are.

    python -m tests.bench.other_simulator OUT --sessions 40 --healthy 1 --outside 0 --seed 61
    python -m tests.bench.bench_intervals OUT/* [--every]

Each folder holds `robot.urdf`, `answers.json` and a folder of recordings a session, as the other
simulator writes them. Sessions without an effect count, or all with --every. Of each kind of
parameter: how many, the share that the intervals hold (with its own 95 % interval by Wilson), and
how wide they are over the ideal, which holds exactly 95 %.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from ident import open_sessions
from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.errors import InputError
from ident.fitting.fit import fit_hybrid
from ident.robot.arm import ArmModel

# As the answers name them, in the order of a fit's intervals.
KINDS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
LEVEL = 0.95
STANDARD_DEVIATIONS = 1.959964  # of 95 %, two-sided


def misses(folder: Path, session: str, truth: dict[str, list[float]]) -> Float[Array, "n 3"]:
    """Distance of each true loss from the middle of its interval, in half widths."""
    arm = ArmModel.load(folder / "robot.urdf")
    motions = open_sessions([folder / session], arm).motions
    limits = fit_hybrid(motions, arm, FitOptions(net="none")).loss.conf_int()[:, : len(KINDS)]
    middle = limits.mean(axis=-1)
    half = 0.5 * np.diff(limits, axis=-1)[..., 0]
    true = np.column_stack([truth[kind] for kind in KINDS])
    return np.abs(true - middle) / half


def wilson(share: float, count: int) -> tuple[float, float]:
    """Interval of a share. Source: Wilson 1927."""
    z = STANDARD_DEVIATIONS
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return float(middle - half), float(middle + half)


def describe(name: str, distances: Float[Array, " m"]) -> str:
    """A line of the table."""
    held = float(np.mean(distances <= 1.0))
    low, high = wilson(held, len(distances))
    wide = 1.0 / float(np.quantile(distances, LEVEL))
    return f"{name:<22}{len(distances):>6}{100 * held:>8.1f} % [{100 * low:.0f}, {100 * high:.0f}]{wide:>9.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--every", action="store_true", help="sessions with effects, too")
    given = parser.parse_args()
    distances = []
    for folder in given.folders:
        answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
        for session, answer in answers.items():
            if answer["effects"] and not given.every:
                continue
            try:
                distances.append(misses(folder, session, answer["true_loss"]))
            except InputError as error:
                print(f"{folder.name}/{session}: {error}", flush=True)
    print(f"{'parameter':<22}{'count':>6}{'held':>20}{'wide':>9}")
    stacked = np.concatenate(distances)
    for kind, column in zip(KINDS, stacked.T, strict=True):
        print(describe(kind, column))
    print(describe("all", stacked.ravel()))


if __name__ == "__main__":
    main()
