"""How long the exported C++ takes a sample, and how far it and the ONNX graph are from the model.

    python tests/bench/bench_cpp.py [SAMPLES]

The arm is the TM5-900 with six joints, fitted to made-up runs whose friction grows with the load, bends
and remembers, so that laws, net and memory are all in the file. The program is compiled with -O2 and
timed over the samples of a run, again and again; the ONNX graph, where ONNX Runtime is installed, over
the same samples one by one, as a controller would call it.
"""

import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.command_options import ExportOptions, FitOptions
from ident.export.onnx_model import run_onnx
from ident.export.write import write_export
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.model.linearisation import stop_operator
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine

RATE = 100.0
SECONDS = 9
RUNS = 5
PROGRAM = """
#include <chrono>
#include <cstdio>
#include <vector>
#include "learned_torque.hpp"
int main(int, char** words) {
  using namespace SPACE;
  const long rounds = std::atol(words[1]);
  std::vector<Vector> states;
  Vector v;
  for (;;) {
    std::size_t read = 0;
    for (double& x : v) read += std::scanf("%lf", &x) == 1;
    if (read < kJoints) break;
    states.push_back(v);
  }
  const std::size_t rows = states.size() / 3;
  double sum = 0.0;
  const auto begin = std::chrono::steady_clock::now();
  for (long k = 0; k < rounds; ++k) {
    State state{};
    for (std::size_t i = 0; i < rows; ++i) {
      const Vector tau = model_torque(states[3 * i], states[3 * i + 1], states[3 * i + 2], DT, state);
      sum += tau[0];
      if (k == 0)
        for (double t : tau) std::fprintf(stderr, "%.17g ", t);
    }
  }
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  std::printf("%.6g %.6g\\n", 1e6 * spent.count() / (rounds * rows), sum);
}
"""


def make_runs(arm: ArmModel) -> list[Motion]:
    """Runs whose friction has what laws, net and memory are for, at every joint another."""
    rng = np.random.default_rng(5)
    clock = np.arange(int(SECONDS * RATE)) / RATE
    motions = []
    for k in range(RUNS):
        q, dq, ddq = multisine(rng, clock, arm.n)
        rigid = arm.inverse_dynamics(q, dq, ddq)
        tau = rigid + 6.0 * dq + 5.0 * np.tanh(dq / 0.01) + 0.15 * np.abs(rigid) * np.tanh(dq / 0.01)
        for j in range(arm.n):
            path = np.ascontiguousarray(q[:, j])
            tau[:, j] += 20.0 * stop_operator(path, 0.1) if j % 2 else 1.5 * np.sin(3.0 * dq[:, j])
        tau = tau + 0.1 * rng.standard_normal(dq.shape)
        motions.append(exact_motion(clock, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def run_cpp(folder: Path, run: Motion, rounds: int) -> tuple[float, Array]:
    """Microseconds a sample, and the torque along the run."""
    header = (folder / "learned_torque.hpp").read_text(encoding="utf-8")
    space = next(line.split()[1] for line in header.splitlines() if line.startswith("namespace "))
    text = PROGRAM.replace("SPACE", space).replace("DT", repr(run.interval))
    (folder / "time.cpp").write_text("#include <cstdlib>\n" + text, encoding="utf-8")
    subprocess.run(["c++", "-std=c++11", "-O2", "time.cpp", "-o", "time"], cwd=folder, check=True)
    rows = np.stack([run.q, run.dq, run.ddq], axis=1)
    given = " ".join(map(repr, map(float, rows.ravel())))
    words = [str(folder / "time"), str(rounds)]
    done = subprocess.run(words, input=given, capture_output=True, text=True, check=True)
    torque = np.array(done.stderr.split(), dtype=float).reshape(run.q.shape)
    return float(done.stdout.split()[0]), torque


def time_onnx(path: Path, run: Motion, model: HybridModel) -> tuple[float, Array]:
    """The same of the graph."""
    states = (run.q, run.dq, run.ddq, run.interval)
    begin = time.process_time()
    (torque,) = run_onnx(path, [states], model)
    return 1e6 * (time.process_time() - begin) / len(run.q), torque


def main(samples: int = 200_000) -> None:
    arm = ArmModel.load("tm5-900")
    runs = make_runs(arm)
    model = fit_hybrid(runs, arm, FitOptions()).model
    remembering = 0 if model.memory is None else int(model.memory.kept.sum())
    print(f"{len(model.named)} laws, net {model.net is not None}, memory at {remembering} of {arm.n} joints")
    run = runs[0]
    wanted = model.torque(run.q, run.dq, run.ddq)
    formats = ("cpp", "onnx") if find_spec("onnxruntime") else ("cpp",)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "out"
        write_export(model, folder, ExportOptions(formats=formats, nearest=True))
        measured = {"C++": run_cpp(folder, run, max(1, samples // len(run.q)))}
        if "onnx" in formats:
            measured["ONNX"] = time_onnx(folder / "torque_model.onnx", run, model)
    for name, (spent, torque) in measured.items():
        off = float(np.max(np.abs(torque - wanted)))
        print(f"{name}: {spent:.2f} us a sample, within {off:.2g} N m of the model")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
