"""Whether a fit's 95 % intervals hold the truth of simulated arms, and how wide they are: two simulators.

    python -m tests.bench.other_simulator OTHER --sessions 42 --healthy 1 --outside 0 --seed 61
    python -m tests.bench.own_arms OWN --sessions 42 --seed 61
    python -m tests.bench.bench_intervals OTHER/* --rows other.jsonl
    python -m tests.bench.bench_intervals OWN/* --rows own.jsonl

Each folder holds `robot.urdf`, `answers.json` and a folder of recordings a session. Sessions without an effect count,
or all with --every. A session that stands in the file of rows is not fitted again. Of each kind of parameter: how
many, the share that the intervals hold (with its own 95 % interval by Wilson, and one by drawing arms again, since
parameters of one arm err together), and how wide they are over the ideal, which holds exactly 95 %.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident import open_sessions
from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.errors import InputError
from ident.fitting.fit import FitResults, fit_hybrid
from ident.robot.arm import ArmModel

# As the answers name them, in the order of a fit's intervals.
LOSSES = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
LINKS = "base parameter of links"
LEVEL = 0.95
STANDARD_DEVIATIONS = 1.959964  # of 95 %, two-sided
# Times that arms are drawn again.
DRAWS = 2000
# Of an interval, of a parameter's size: a narrower one is none.
LEAST_WIDTH = 1e-9

# Kind of parameter -> distances of truths from the middles of their intervals, in half widths.
Misses = dict[str, list[float]]


def misses(folder: Path, session: str, answer: dict[str, Any]) -> Misses:
    """How far each true parameter lies from the middle of its interval, in half widths."""
    arm = ArmModel.load(folder / "robot.urdf")
    motions = open_sessions([folder / session], arm).motions
    fitted = fit_hybrid(motions, arm, FitOptions(net="none"))
    intervals = fitted.loss.conf_int()
    found: Misses = {}
    for place, kind in enumerate(LOSSES):
        found[kind] = distances(intervals[:, place], answer["true_loss"][kind])
    if "true_links" in answer:
        found[LINKS] = misses_of_links(fitted, answer["true_links"])
    return found


def misses_of_links(fitted: FitResults, links: list[list[float]]) -> list[float]:
    """The same of the base parameters that were fitted."""
    figures = fitted.identified.inertias
    if not figures:
        return []
    true = fitted.inertia.base.mapping @ np.ravel(links)
    return distances(np.array([[figure.low, figure.high] for figure in figures]), true)


def distances(limits: Float[Array, "n 2"], true: Sequence[float] | Float[Array, " n"]) -> list[float]:
    """Distance of true values from the middles of their intervals, in half widths."""
    middle = limits.mean(axis=1)
    half = 0.5 * (limits[:, 1] - limits[:, 0])
    least = LEAST_WIDTH * np.maximum(np.abs(middle), LEAST_WIDTH)
    return (np.abs(np.asarray(true) - middle) / np.maximum(half, least)).tolist()


def wilson(share: float, count: int) -> tuple[float, float]:
    """Interval of a share. Source: Wilson 1927."""
    z = STANDARD_DEVIATIONS
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return float(middle - half), float(middle + half)


def drawn_again(of_arms: Sequence[Sequence[float] | Array]) -> tuple[float, float]:
    """Interval of the share that is held, by drawing arms again."""
    rng = np.random.default_rng(0)
    held = np.array([np.sum(np.asarray(arm) <= 1.0) for arm in of_arms])
    counts = np.array([len(arm) for arm in of_arms])
    drawn = rng.integers(len(of_arms), size=(DRAWS, len(of_arms)))
    shares = held[drawn].sum(axis=1) / np.maximum(counts[drawn].sum(axis=1), 1)
    low, high = np.quantile(shares, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return float(low), float(high)


def describe(name: str, of_arms: Sequence[Sequence[float] | Array]) -> str:
    """A line of the table."""
    every = np.concatenate([np.asarray(arm, dtype=float) for arm in of_arms])
    held = float(np.mean(every <= 1.0))
    by_count = wilson(held, len(every))
    by_arm = drawn_again(of_arms)
    wide = 1.0 / float(np.quantile(every, LEVEL))
    ends = " ".join(f"[{100 * low:.0f}, {100 * high:.0f}]" for low, high in (by_count, by_arm))
    return f"{name:<26}{len(every):>6}{100 * held:>8.1f} % {ends}{wide:>9.2f}"


def read_rows(path: Path) -> dict[str, Misses]:
    """Sessions that were fitted before."""
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {row["session"]: row["misses"] for row in map(json.loads, lines)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--every", action="store_true", help="sessions with effects, too")
    parser.add_argument("--rows", type=Path, required=True, help="file of rows, one a session")
    given = parser.parse_args()
    rows = read_rows(given.rows)
    for folder in given.folders:
        answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
        for session, answer in answers.items():
            name = f"{folder}/{session}"
            if name in rows or (answer["effects"] and not given.every):
                continue
            try:
                rows[name] = misses(folder, session, answer)
            except InputError as error:
                print(f"{name}: {error}", flush=True)
                continue
            with given.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"session": name, "misses": rows[name]}) + "\n")
    print(f"{len(rows)} arms")
    print(f"{'parameter':<26}{'count':>6}{'held, by count, by arm':>29}{'wide':>9}")
    for kind in (*LOSSES, LINKS):
        of_kind = [row[kind] for row in rows.values() if row.get(kind)]
        if of_kind:
            print(describe(kind, of_kind))
    of_losses = [np.concatenate([row[kind] for kind in LOSSES]) for row in rows.values()]
    print(describe("all losses", of_losses))


if __name__ == "__main__":
    main()
