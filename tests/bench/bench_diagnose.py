"""Time and memory of a diagnosis. Run: pytest <this file> -s, or python <this file> --full for ten hours at 1 kHz.

1. 24,000 samples × 6 joints with the whole catalogue: processor time, and where it goes.
2. Sessions of 1 kHz that grow: the runs of a session are repeated on one clock, each smoothed, with a draw of encoder
   noise of its own, decimated and held as a session's are, in memory or on disk, then diagnosed. Each length runs in a
   process of its own, which tells its largest memory. Reading files is not part of it.
"""

from __future__ import annotations

import argparse
import cProfile
import itertools
import json
import pstats
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import freeze
from ident.diagnosis.diagnose import Analysis, diagnose
from ident.diagnosis.regression.decimation import decimate
from ident.effects.catalogue import CATALOGUE
from ident.motion.motion import Motion, prepare_run, session_noise
from ident.motion.out_of_core import hold
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate

CUTOFF = 25.0
STAGES = (
    "fit_baseline", "build_layout", "gather", "run", "compute_residuals", "measure_ceiling", "estimate_effects",
    "measure_reach", "map_gap",
)  # fmt: skip
MINUTES = (10, 20, 40, 60)  # the last two wait on disk
FULL_MINUTES = 600
MOST_SECONDS, MOST_BYTES = 600.0, 2 * 1024**3
# Memory may differ by so much between lengths that wait on disk.
MOST_GROWTH = 1.1


def recorded(rate: float, runs: int, duration: float) -> Session:
    """A simulated session with one effect."""
    options = SimulationOptions(
        robot="tm5-900", effects=("stribeck_friction:joint_2:3x",), rate=rate, runs=runs, duration=duration, seed=5
    )
    return simulate(options, "bench").session


def analyse(motions: Sequence[Motion], arm: ArmModel) -> tuple[Analysis, float]:
    """The diagnosis and its processor time [s]."""
    begin = time.process_time()
    analysis = diagnose(motions, arm, CATALOGUE)
    return analysis, time.process_time() - begin


def tiled(session: Session, minutes: float) -> Iterator[Motion]:
    """The session's runs, repeated on one clock until they last so long; smoothed and decimated one by one."""
    levels, rng = session_noise(session), np.random.default_rng(0)
    start = 0.0
    for k in itertools.count():
        run = session.runs[k % len(session.runs)]
        motion = decimate(prepare_run(run, levels, session.payload, CUTOFF, FOR_DIAGNOSIS, rng))
        motion = replace(motion, name=f"{k:04d}", time=freeze(motion.time - motion.time[0] + start))
        start = float(motion.time[-1]) + 1.0
        yield motion
        if start >= 60.0 * minutes:
            return


def measure_length(minutes: float) -> dict[str, float]:
    """Processor time and largest memory of a session of 1 kHz, in this process."""
    arm = ArmModel.load("tm5-900")
    session = recorded(1000.0, 5, 30.0)
    begin = time.process_time()
    motions = hold(tiled(session, minutes))
    analysis, _ = analyse(motions, arm)
    return {
        "minutes": minutes,
        "samples": 60e3 * minutes,
        "seconds": time.process_time() - begin,
        "bytes": 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "findings": len(analysis.diagnosis.findings),
    }


def in_process(minutes: float) -> dict[str, float]:
    """The same in a process of its own."""
    command = [sys.executable, __file__, "--minutes", str(minutes)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def tell(found: dict[str, float]) -> None:
    seconds, size = found["seconds"], found["bytes"] / 1024**2
    print(f"{found['samples'] / 1e6:6.2f} M samples: {seconds:6.1f} s of processor time, {size:5.0f} MiB at most")


def test_whole_catalogue_on_24000_samples() -> None:
    """24,000 samples × 6 joints, whole catalogue, gates, intervals and ceiling: at most 12 s of processor time."""
    arm = ArmModel.load("tm5-900")
    session = recorded(250.0, 12, 8.0)
    levels, rng = session_noise(session), np.random.default_rng(0)
    motions = [prepare_run(run, levels, session.payload, CUTOFF, FOR_DIAGNOSIS, rng) for run in session.runs]
    analyse(motions[:6], arm)  # compiles
    profile = cProfile.Profile()
    analysis, seconds = analyse(motions, arm)
    profile.runcall(analyse, motions, arm)
    samples = sum(len(motion.time) for motion in motions)
    print(f"\n{samples} samples × {arm.n} joints, {analysis.evidence.layout.size} columns: {seconds:.1f} s")
    table = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    for (file, _, name), (_, calls, own, cumulative, _) in sorted(table.items(), key=lambda row: -row[1][3]):
        if name in STAGES and "diagnosis" in file:
            print(f"  {name:18} {cumulative:6.2f} s in {calls} calls, {own:.2f} s of its own")
    assert seconds <= 12.0


def test_time_is_linear_in_length() -> None:
    """Sessions of 1 kHz: the last added minutes cost no more than the first did, and no memory."""
    found = [in_process(minutes) for minutes in MINUTES]
    for one in found:
        tell(one)
    minutes = np.array([one["minutes"] for one in found])
    slope, base = np.polyfit(minutes, [one["seconds"] for one in found], 1)
    print(f"{1e6 * slope / 60e3:.1f} µs a sample; ten hours at this rate: {base + slope * FULL_MINUTES:.0f} s")
    steps = np.diff([one["seconds"] for one in found]) / np.diff(minutes)
    assert steps[-1] <= 1.5 * steps[0]
    assert found[-1]["bytes"] <= MOST_GROWTH * found[-2]["bytes"]


def main() -> None:
    """One length, for a process of its own; or ten hours."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--full", action="store_true")
    chosen = parser.parse_args()
    if chosen.full:
        found = in_process(FULL_MINUTES)
        tell(found)
        kept = found["seconds"] <= MOST_SECONDS and found["bytes"] <= MOST_BYTES
        print("within 10 min and 2 GiB" if kept else "beyond 10 min or 2 GiB")
    else:
        print(json.dumps(measure_length(chosen.minutes or MINUTES[0])))


if __name__ == "__main__":
    main()
