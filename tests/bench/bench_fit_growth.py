"""How processor time and memory of `ident fit --net none` grow with the recording.

Run: python tests/bench/bench_fit_growth.py [--samples 1e4,1e5,1e6] [--rate 1000] [--net none] [--scratch DIR]

A recording is a folder of runs of a minute each: motion of random Fourier series of the TM5-900 with friction that
changes a little from run to run, sampled at the rate. Each fit is a process of its own; memory is its greatest resident
size, mapped files that the system may drop at any time counted in. Runs repeat with new clocks after `--different`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel

RUN_S = 60.0
FIT = "from ident.cli.start import main; main()"
JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
VISCOUS, COULOMB, ROTOR = np.array([[8.0, 8, 6, 1.5, 1.5, 1.2], [8.0, 9, 6, 2, 2, 1.5], [0.9, 0.9, 0.5, 0.1, 0.1, 0.1]])


def make_run(arm: ArmModel, rate: float, rng: np.random.Generator) -> dict[str, Array]:
    """Positions and efforts of a minute."""
    time = np.arange(round(RUN_S * rate)) / rate
    q, dq, ddq = (np.zeros((len(time), arm.n)) for _ in range(3))
    for order in range(1, 7):
        w = 2.0 * np.pi * 0.11 * order
        size, phase = rng.uniform(0.1, 0.9, arm.n) / order, rng.uniform(0.0, 2.0 * np.pi, arm.n)
        turn = w * time[:, None] + phase
        q += size * np.sin(turn)
        dq += w * size * np.cos(turn)
        ddq -= w**2 * size * np.sin(turn)
    friction = 1.0 + 0.01 * rng.standard_normal((2, arm.n))
    own = ROTOR * ddq + friction[0] * VISCOUS * dq + friction[1] * COULOMB * np.tanh(dq / 0.01)
    effort = arm.inverse_dynamics(q, dq, ddq) + own + 0.3 * rng.standard_normal(q.shape)
    return {"time": time, "position": q + 1e-6 * rng.standard_normal(q.shape), "effort": effort}


def write_session(folder: Path, runs: list[dict[str, Array]], samples: int) -> None:
    """Runs with going clocks, the last one cut, until there are so many samples."""
    clock, written = 0.0, 0
    while written < samples:
        k = len(list(folder.iterdir()))
        run = {name: values[: samples - written] for name, values in runs[k % len(runs)].items()}
        columns: dict[str, Float[Array, " T"]] = {"time": run["time"] + clock}
        for j, joint in enumerate(JOINTS):
            columns[f"{joint}/position"], columns[f"{joint}/effort"] = run["position"][:, j], run["effort"][:, j]
        pq.write_table(pa.table(columns), folder / f"{k:05d}.parquet")
        clock, written = columns["time"][-1] + 5.0, written + len(run["time"])


def measure(folder: Path, net: str, out: Path) -> tuple[float, float]:
    """Processor time [s] and greatest resident size [GB] of a fit."""
    command = [sys.executable, "-c", FIT, "fit", str(folder), "--robot", "tm5-900", "--net", net, "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"the fit of {folder} ended with {process.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", default="1e4,1e5,1e6")
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--different", type=int, default=12)
    parser.add_argument("--net", default="none")
    parser.add_argument("--scratch", type=Path, default=None)
    asked = parser.parse_args()
    rng, arm = np.random.default_rng(14), ArmModel.load("tm5-900")
    runs = [make_run(arm, asked.rate, rng) for _ in range(asked.different)]
    print(f"{'samples':>12}{'processor s':>14}{'µs a sample':>14}{'greatest GB':>14}")
    for samples in (int(float(one)) for one in asked.samples.split(",")):
        scratch = Path(tempfile.mkdtemp(prefix="growth-", dir=asked.scratch))
        try:
            (scratch / "session").mkdir()
            write_session(scratch / "session", runs, samples)
            seconds, memory = measure(scratch / "session", asked.net, scratch / "model")
        finally:
            shutil.rmtree(scratch)
        print(f"{samples:>12}{seconds:>14.1f}{1e6 * seconds / samples:>14.1f}{memory:>14.2f}", flush=True)


if __name__ == "__main__":
    main()
