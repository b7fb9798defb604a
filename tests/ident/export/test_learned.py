"""Law of the whole model in C++: it gives the model's own torque along a motion, laws, net and memory included."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.export.write import write_export
from ident.fitting.fit import fit_hybrid
from ident.model.linearisation import stop_operator
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine, two_joint_arm

RATE = 100.0
MAIN = """
#include <cstdio>
#include "learned_torque.hpp"
int main() {
  using namespace SPACE;
  State state{};
  Vector q, dq, ddq;
  while (std::scanf("%lf %lf %lf %lf %lf %lf", &q[0], &q[1], &dq[0], &dq[1], &ddq[0], &ddq[1]) == 6) {
    const Vector tau = model_torque(q, dq, ddq, DT, state);
    std::printf("%.12g %.12g\\n", tau[0], tau[1]);
  }
}
"""


def _runs(arm: ArmModel) -> list[Motion]:
    """Runs with friction that grows with the load, a bend that a net may learn, and a hysteresis."""
    rng, time, motions = np.random.default_rng(5), np.arange(900) / RATE, []
    for k in range(5):
        q, dq, ddq = multisine(rng, time, 2)
        rigid = arm.inverse_dynamics(q, dq, ddq)
        hidden = 2.0 * stop_operator(np.ascontiguousarray(q[:, 0]), 0.1) / 0.1
        loaded = 0.15 * np.abs(rigid[:, 1]) * np.tanh(dq[:, 1] / 0.01) + 1.5 * np.sin(3.0 * dq[:, 1])
        tau = rigid + 6.0 * dq + 5.0 * np.tanh(dq / 0.01) + np.column_stack([hidden, loaded])
        tau = tau + 0.1 * rng.standard_normal(dq.shape)
        motions.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def run_header(folder: Path, states: Array, interval: float, space: str) -> Array:
    """What the header's `model_torque` gives along a motion [N m]."""
    text = MAIN.replace("SPACE", space).replace("DT", repr(interval))
    (folder / "try.cpp").write_text(text, encoding="utf-8")
    command = ["c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-O1", "try.cpp", "-o", "try"]
    subprocess.run(command, cwd=folder, check=True)
    given = "\n".join(" ".join(map(repr, map(float, row))) for row in states)
    said = subprocess.run([str(folder / "try")], input=given, capture_output=True, text=True, check=True)
    return np.array([line.split() for line in said.stdout.splitlines()], dtype=float)


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_the_header_gives_the_models_own_torque(tmp_path: Path) -> None:
    """Along a run, sample by sample: laws, offsets, net and memory as the model has them; nothing is left out."""
    arm = two_joint_arm()
    runs = _runs(arm)
    model = fit_hybrid(runs, arm, FitOptions()).model
    assert model.named
    assert model.memory is not None
    assert model.memory.kept.any()
    assert not model.memory.kept.all()
    record = write_export(model, tmp_path / "out", ["cpp"], nearest=True)
    assert "learned_torque.hpp" in record["files"]
    run = runs[0]
    space = next(
        line.split()[1]
        for line in (tmp_path / "out/learned_torque.hpp").read_text().splitlines()
        if line.startswith("namespace ")
    )
    states = np.column_stack([run.q, run.dq, run.ddq])
    said = run_header(tmp_path / "out", states, run.interval, space)
    assert np.allclose(said, model.torque(run.q, run.dq, run.ddq), rtol=1e-3, atol=2e-3)
