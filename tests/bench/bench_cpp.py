"""How long the exported C++ takes a sample of six joints, and how far it and ONNX are from the model.

    python tests/bench/bench_cpp.py [SAMPLES]

The model is the largest that a fit gives: at each joint of the TM5-900 a law, a net of full width and
a memory of all its trees, with numbers drawn. The program is compiled with -O2 and timed over the
samples of a run, again and again, by the processor's clock; the ONNX graph, where ONNX Runtime is
installed, over the same samples one by one, as a controller would call it.
"""

import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.export.learned import write_learned
from ident.export.onnx_model import run_onnx, write_onnx
from ident.laws.carried import NamedLaw
from ident.model.boosted import DEPTH, TREES, Trees
from ident.model.hybrid import HybridModel
from ident.model.joint_nets import JointNets, width_of
from ident.model.loss import LossParameters
from ident.model.memory import SEVERAL, JointMemory, own_inputs
from ident.model.nearness import POSES, Nearness
from ident.model.net_bounds import NetBounds
from ident.model.residual_net import JOINT_FEATURES, PRESETS, ResidualNet
from ident.model.sampling import sampling_interval
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine

RATE = 100.0
SECONDS = 9
PROGRAM = """
#include <cstdio>
#include <cstdlib>
#include <ctime>
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
  const std::clock_t begin = std::clock();
  for (long k = 0; k < rounds; ++k) {
    State state{};
    for (std::size_t i = 0; i < rows; ++i) {
      const Vector* now = &states[3 * i];
      const Vector tau = model_torque(now[0], now[1], now[2], DT, state);
      sum += tau[0];
      if (k == 0)
        for (double t : tau) std::fprintf(stderr, "%.17g ", t);
    }
  }
  const double spent = double(std::clock() - begin) / CLOCKS_PER_SEC;
  std::printf("%.6g %.6g\\n", 1e6 * spent / (rounds * rows), sum);
}
"""


def full_model(arm: ArmModel) -> HybridModel:
    """A model with a law, a net and a memory at every joint."""
    rng = np.random.default_rng(0)
    n = arm.n
    width = width_of(JOINT_FEATURES)
    layers = (rng.normal(size=(n, JOINT_FEATURES, width)), 0.1 * rng.normal(size=(n, width, 1)))
    biases = (rng.normal(size=(n, 1, width)), rng.normal(size=(n, 1, 1)))
    bounds = NetBounds(np.full((3, n), -50.0), np.full((3, n), 50.0))
    scales = (np.zeros((n, JOINT_FEATURES)), np.ones((n, JOINT_FEATURES)), np.ones(n))
    net = ResidualNet(PRESETS["default"], JointNets(layers, biases), *scales, bounds=bounds)
    laws = []
    trees = []
    for joint in range(n):
        shape = {"stribeck_velocity_rad_s": 0.3, "exponent": 1.3}
        laws.append(NamedLaw("stribeck_friction", joint, shape, ((1.0, 0.9, 1.1),)))
        asked = rng.integers(0, own_inputs() + SEVERAL * n, (TREES, DEPTH))
        leaves = 0.01 * rng.normal(size=(TREES, 1 << DEPTH))
        trees.append(Trees(asked, rng.normal(size=(TREES, DEPTH)), leaves))
    loss = LossParameters(*(np.full(n, value) for value in (0.1, 8.0, 6.0, 0.7, 0.02)))
    nearness = Nearness(rng.standard_normal((POSES, n)), np.full(n, 0.5))
    memory = JointMemory(tuple(trees), nearness)
    return HybridModel(arm, arm, arm, loss, net=net, memory=memory, named=tuple(laws))


def run_cpp(folder: Path, run: Motion, interval: float, rounds: int) -> tuple[float, Array]:
    """Microseconds a sample, and the torque along the run [N m]."""
    header = (folder / "learned_torque.hpp").read_text(encoding="utf-8")
    space = next(line.split()[1] for line in header.splitlines() if line.startswith("namespace "))
    text = PROGRAM.replace("SPACE", space).replace("DT", repr(interval))
    (folder / "time.cpp").write_text(text, encoding="utf-8")
    subprocess.run(["c++", "-std=c++11", "-O2", "time.cpp", "-o", "time"], cwd=folder, check=True)
    rows = np.stack([run.q, run.dq, run.ddq], axis=1)
    given = " ".join(map(repr, map(float, rows.ravel())))
    words = [str(folder / "time"), str(rounds)]
    done = subprocess.run(words, input=given, capture_output=True, text=True, check=True)
    torque = np.array(done.stderr.split(), dtype=float).reshape(run.q.shape)
    return float(done.stdout.split()[0]), torque


def time_onnx(path: Path, run: Motion, interval: float, model: HybridModel) -> tuple[float, Array]:
    """The same of the graph."""
    begin = time.process_time()
    (torque,) = run_onnx(path, [(run.q, run.dq, run.ddq, interval)], model)
    return 1e6 * (time.process_time() - begin) / len(run.q), torque


def main(samples: int = 100_000) -> None:
    arm = ArmModel.load("tm5-900")
    model = full_model(arm)
    clock = np.arange(int(SECONDS * RATE)) / RATE
    states = multisine(np.random.default_rng(1), clock, arm.n)
    run = exact_motion(clock, states, np.zeros_like(states[0]), arm.joint_names, "run")
    # The model finds the interval in the states: what remembers must be given the same.
    interval = sampling_interval(run.q, run.dq) or run.interval
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "learned_torque.hpp").write_text(write_learned(model), encoding="utf-8")
        measured = {"C++": run_cpp(folder, run, interval, max(1, samples // len(clock)))}
        if find_spec("onnxruntime"):
            path = folder / "torque_model.onnx"
            path.write_bytes(write_onnx(model))
            measured["ONNX"] = time_onnx(path, run, interval, model)
    wanted = model.torque(run.q, run.dq, run.ddq)
    for name, (spent, torque) in measured.items():
        off = float(np.max(np.abs(torque - wanted)))
        print(f"{name}: {spent:.2f} us a sample, within {off:.2g} N m of the model")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
