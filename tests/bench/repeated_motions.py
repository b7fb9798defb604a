"""How near runs come to one another in which real arms made a motion again, and the same runs written anew.

    python tests/bench/repeated_motions.py FOLDER

FOLDER holds a folder for each arm, with its sessions. Of every pair of runs of one arm it is counted how many of the
moments of the one (`ident.recordings.series`) lie in the other; then of every run, written with five decimals at half
its rate, how many of its own.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.recordings.series import SearchedRun, Series

# Runs of an arm that are compared with each other, and samples of one that are looked through.
MOST_RUNS, MOST_SAMPLES = 40, 200_000
# A copy at half the rate has half of the moments; fewer are told.
RATHER_FEW = 0.3


def main() -> None:
    others, copies = [], []
    for arm in sorted(path for path in Path(sys.argv[1]).iterdir() if path.is_dir()):
        runs = read_runs(arm)[:MOST_RUNS]
        for run, other in itertools.permutations(runs, 2):
            share = shared(run, other)
            if share is not None:
                others.append(share)
                if share > 0.0:
                    print(f"  {where(run)} and {where(other)}: {share:.3f}", flush=True)
        for run in runs:
            share = shared(run, written_anew(run))
            if share is not None:
                copies.append(share)
                if share < RATHER_FEW:
                    print(f"  {where(run)} written anew: {share:.3f}", flush=True)
        print(f"{arm.name}: {len(runs)} runs", flush=True)
    near = np.count_nonzero(np.array(others))
    print(f"{len(others)} pairs of runs: of {near} some moments of one lie in the other, at most {max(others):.3f}")
    print(f"{len(copies)} copies: at least {min(copies):.3f} of the moments, median {np.median(copies):.3f}")


def shared(run: Recording, other: Recording) -> float | None:
    """Share of a run's moments that another one holds; None where it has no moments of its own, or other joints."""
    series = Series.of(run)
    if series is None or set(run.joints) != set(other.joints):
        return None
    return series.found_in(SearchedRun(other)) / len(series.moments)


def where(run: Recording) -> str:
    return run.name if run.source is None else f"{run.source.parent.name}/{run.name}"


def read_runs(arm: Path) -> list[Recording]:
    """All runs of an arm's folder and of those in it; what can't be read is passed over."""
    runs: list[Recording] = []
    for folder in (arm, *sorted(arm.iterdir())):
        if folder.is_dir():
            try:
                session = load_session(folder)
            except InputError:
                continue
            runs += [run for run in session.runs if len(run) <= MOST_SAMPLES]
    return runs


def written_anew(run: Recording) -> Recording:
    """With five decimals, at half its rate, twenty samples shorter, a thousand seconds later."""
    rows = slice(20, None, 2)
    return run.replace(
        time=np.round(run.time[rows] + 1000.0, 5),
        position=np.round(run.position[rows], 5),
        effort=np.round(run.effort[rows], 5),
        **{name: None for name in run.channels() if name not in ("position", "effort")},
    )


if __name__ == "__main__":
    main()
