"""`ident watch` over recordings: detection delay, false alarms an arm-year, cost of a session, two Dask workers.

    python tests/bench/bench_watch_sessions.py [--arms 20] [--sessions 18] [--seed N] [--folder DIR] [--dask 2]

Each arm is another individual of the simulated plant, which repeats its own three short motions at even intervals over
a year. Every day each joint's friction is another (3 %), with the noise. Every other arm changes in the middle, at one
joint: friction + 30 %, a drive's gain + 8 %, an offset. `bench_watch.py` draws figures, and many more of them.
"""

from __future__ import annotations

import argparse
import json
import secrets
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ident.api.watching import watch
from ident.monitor.watch import Watch
from ident.recordings.save import write_session
from ident.simulation.simulate import SimulationOptions, simulate

ROBOT, RUNS, SECONDS, RATE = "tm5-900", 3, 4.0, 125.0
# Standard deviation of a joint's friction from day to day.
DAY = 0.03
CHANGES: dict[str, Mapping[str, Any]] = {
    "friction": {"factor": 1.3},
    "gain": {"effect": "torque_gain_error:{joint}:0.08"},
    "offset": {"effect": "torque_offset:{joint}:2.0"},
}
# Which figures tell each change.
FIGURES = {"friction": {"coulomb", "viscous"}, "gain": {"gain", "coulomb", "viscous", "rotor"}, "offset": {"offset"}}


@dataclass(frozen=True)
class Fate:
    """What happens to an arm: the kind, where, and before which session; nothing if the kind is empty."""

    kind: str = ""
    joint: int = 0
    first: int = 0


def record_arm(folder: Path, seed: int, sessions: int, fate: Fate) -> None:
    """A year of an arm."""
    rng = np.random.default_rng([seed, 15])
    usual = SimulationOptions(ROBOT, arm_seed=seed, runs=RUNS, duration=SECONDS, rate=RATE, commands=False)
    motions = None
    for k in range(sessions):
        changed = bool(fate.kind) and k >= fate.first
        what = CHANGES[fate.kind] if changed else {}
        factors = np.exp(DAY * rng.standard_normal(6))
        factors[fate.joint] *= what.get("factor", 1.0)
        effects = (what["effect"].format(joint=f"joint_{fate.joint + 1}"),) if "effect" in what else ()
        options = replace(usual, seed=int(rng.integers(2**31)), friction_factors=tuple(factors), effects=effects)
        made = simulate(options, motions=motions)
        motions = made.motions
        day = date(2025, 1, 1) + timedelta(days=round(365.0 * k / sessions))
        write_session(made.session, folder / day.isoformat())


def judge(found: Watch, fates: Mapping[str, Fate]) -> dict[str, Any]:
    """False alarms, delays in sessions, and what was missed."""
    false, beside, delays, missed = [], [], {kind: [] for kind in CHANGES}, []
    for arm in found.arms:
        fate, names = fates[arm.arm], [row["session"] for row in arm.sessions]
        told = []
        for alarm in arm.alarms:
            at = names.index(alarm.session)
            words = f"{arm.arm} {alarm.joint} {alarm.figure} in session {at + 1}"
            if not fate.kind or at < fate.first:
                false.append(words)
            elif alarm.joint == f"joint_{fate.joint + 1}" and alarm.figure in FIGURES[fate.kind]:
                told.append(at - fate.first + 1)
            else:
                beside.append(words)
        if told:
            delays[fate.kind].append(min(told))
        elif fate.kind:
            missed.append(f"{arm.arm} {fate.kind} joint_{fate.joint + 1}")
    quiet = sum(1.0 if not fate.kind else fate.first / len(found.arms[0].sessions) for fate in fates.values())
    return {"quiet_arm_years": round(quiet, 1), "false": false, "beside": beside, "delays": delays, "missed": missed}


def on_dask(folder: Path, store: Path, workers: int) -> dict[str, Any]:
    """The same sessions in another store, by workers of a Dask cluster on this machine."""
    from dask.distributed import Client, LocalCluster

    started = time.monotonic()
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        found = watch(folder, store, ROBOT, diagnosed=False, settle=0.0, scheduler=cluster.scheduler_address)
        processor = client.run(time.process_time)
    return {"workers": workers, "sessions": len(found.fresh), "wall_s": round(time.monotonic() - started, 1)} | {
        "processor_s_of_each_worker": [round(value, 1) for value in processor.values()]
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--arms", type=int, default=20)
    parser.add_argument("--sessions", type=int, default=18)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--folder", default=None, help="Recordings that are there already are not made again.")
    parser.add_argument("--dask", type=int, default=2, help="Workers; 0 leaves that run out.")
    given = parser.parse_args()
    seed = secrets.randbelow(2**31) if given.seed is None else given.seed
    root = Path(given.folder or tempfile.mkdtemp())
    rng, kinds, fates = np.random.default_rng(seed), list(CHANGES), {}
    started = time.process_time()
    for k in range(given.arms):
        kind = kinds[(k // 2) % len(kinds)] if k % 2 else ""
        fates[f"arm_{k:02}"] = Fate(kind, int(rng.integers(1, 5)), given.sessions // 2)
        if not (root / "arms" / f"arm_{k:02}").exists():
            record_arm(root / "arms" / f"arm_{k:02}", seed + k, given.sessions, fates[f"arm_{k:02}"])
    print(f"seed {seed}; recorded in {time.process_time() - started:.0f} s of processor time", flush=True)
    started = time.process_time()
    found = watch(root / "arms", root / "store", ROBOT, diagnosed=False, settle=0.0)
    spent = time.process_time() - started
    unfit = [row for arm in found.arms for row in arm.sessions if row["status"] != "done"]
    print(
        f"{len(found.fresh)} sessions, {len(unfit)} unfit, {spent / max(len(found.fresh), 1):.2f} s of processor each"
    )
    print(json.dumps(judge(found, fates), indent=1), flush=True)
    if given.dask:
        print(json.dumps(on_dask(root / "arms", root / "store_dask", given.dask)))


if __name__ == "__main__":
    main()
