"""Law of the whole model in C++: it gives the model's own torque along a motion, laws, net and memory included."""

import inspect
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ident.arrays import Array
from ident.command_options import ExportOptions
from ident.errors import InputError
from ident.export.learned import _law
from ident.export.write import write_export
from ident.laws.carried import KINDS, NamedLaw
from ident.model.hybrid import HybridModel
from ident.model.sampling import sampling_interval
from ident.motion.motion import Motion
from tests.ident.export.learned_arm import within_reach

# What a net's numbers in single precision, large ones that cancel among them, are off by [N m].
SINGLE = 2e-3
MAIN = """
#include <cstdio>
#include <cstdlib>
#include <new>
#include "learned_torque.hpp"
static bool running = false;
void* operator new(std::size_t size) {
  if (running) std::abort();
  return std::malloc(size);
}
void operator delete(void* place) noexcept { std::free(place); }
int main() {
  using namespace SPACE;
  State state{};
  Vector q, dq, ddq;
  while (std::scanf("%lf %lf %lf %lf %lf %lf", &q[0], &q[1], &dq[0], &dq[1], &ddq[0], &ddq[1]) == 6) {
    running = true;
    const Vector tau = model_torque(q, dq, ddq, DT, state);
    running = false;
    std::printf("%.17g %.17g\\n", tau[0], tau[1]);
  }
}
"""


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
@pytest.mark.parametrize("reach", [np.inf, 0.05])
def test_the_header_gives_the_models_own_torque(
    learned_runs_and_model: tuple[list[Motion], HybridModel], tmp_path: Path, reach: float
) -> None:
    """Along a run, sample by sample, without a word of heap: laws, offsets, net and memory as the model has them."""
    runs, fitted = learned_runs_and_model
    model = within_reach(fitted, reach)
    record = write_export(model, tmp_path / "out", ExportOptions(formats=("cpp",), nearest=True))
    assert "learned_torque.hpp" in record["files"]
    run = runs[0]
    space = next(
        line.split()[1]
        for line in (tmp_path / "out/learned_torque.hpp").read_text().splitlines()
        if line.startswith("namespace ")
    )
    states = np.column_stack([run.q, run.dq, run.ddq])
    # The model finds the interval in the states.
    interval = sampling_interval(run.q, run.dq)
    assert interval is not None
    said = run_header(tmp_path / "out", states, interval, space)
    off = np.abs(said - model.torque(run.q, run.dq, run.ddq)).max(axis=0)
    assert model.memory is not None
    assert off[model.memory.kept].max() < 1e-9
    assert off.max() < SINGLE


def test_a_law_without_words_in_cpp_is_refused() -> None:
    """Law: an added law is never written as another one's torque; every shipped one has its own words."""
    added = SimpleNamespace(effect="magnet", figures=((0.3, 0.2, 0.4),) * 2, shape={"order": 3.0})
    with pytest.raises(InputError, match="magnet"):
        _law(cast(NamedLaw, added))
    assert all(f'law.effect == "{effect}"' in inspect.getsource(_law) for effect in KINDS)
