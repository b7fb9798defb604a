"""A law that is one function in one file and one row of the table is an effect of every command."""

import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
FILE = '''"""Magnets in a housing."""


def magnet(at, shape):
    """sin k q."""
    return [at.xp.sin(shape["cycles"] * at.q)]
'''
ROW = """
[effects.magnet]
states = { file = "magnets", words = "torque that repeats over a turn", shape = ["cycles"] }
grid = { cycles = [2.0, 3.0, 5.0] }
summary = "torque repeats several times a turn"
shown_by = "slow"
figures = ["amplitude_Nm"]
defining = ["amplitude_Nm"]
typical = { figure = "amplitude_Nm", share = 0.5 }
prior = ["1 coulomb"]
open_law = true
drawn_over = "angle"
"""
# What a process does that finds the law in its package; it prints what the law's torque is in each place.
COMMANDS = """
import json
from pathlib import Path
import numpy as np
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.export.identified import Diagnosed
from ident.export.loaded import load_module
from ident.export.write import write_patch
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.fitting.named_laws import read_named_laws
from ident.show.report.diagnosis_pages import write_diagnosis_report
from plan.dynamics.power import differentiate_torque
from plan.dynamics.power import torque_of_model
from plan.experiment.hypotheses import ask
from tests.ident.diagnosis.planted import analyse, at_joint, load_arm, named, record

def plant(arm, q, dq, ddq):
    return at_joint(2, 2.0 * np.sin(3.0 * q[:, 2]))

arm, few = load_arm(), [find_effect(name) for name in ("magnet", "torque_offset")]
found = analyse(arm, plant, few)
path = Path("diagnosis.json")
path.write_text(json.dumps(found.diagnosis.to_dict()))
write_diagnosis_report("report.html", found.diagnosis.to_dict())

model = fit_hybrid(record(arm, plant), arm, FitOptions(net="none"), named=read_named_laws(path, arm)).model
model = HybridModel.load(model.save("model"))
write_patch(Diagnosed.load(path), arm, Path("patch"))
module = load_module(Path("patch/extra_torque.py"))

q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
dq, ddq = 0.5 + 0.0 * q, 0.0 * q
bare = torque_of_model(model, 3, ())
parts = [differentiate_torque(one, q, dq, ddq) for one in (bare, type(bare)(bare.chain, bare.losses))]
told = {
    "names": sorted(named(found)),
    "last": CATALOGUE[-1].id,
    "report": "magnet" in Path("report.html").read_text(),
    "motion": ask(arm, "magnet", None, path).family,
    "fit": model.torque_terms(q, dq, ddq)["named"][:, 2].tolist(),
    "module": module.extra_torque(q, dq, ddq)[:, 2].tolist(),
    "plan": (parts[0][0] - parts[1][0])[:, 2].tolist(),
    "slope": (parts[0][1][0] - parts[1][1][0])[:, 2, 2].tolist(),
    "q": q[:, 2].tolist(),
}
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package that has the file and the row."""
    place = tmp_path_factory.mktemp("package")
    (place / "ident").mkdir()
    for source in (*ROOT.glob("*"), *(ROOT / "ident").glob("*")):
        copy = place / source.relative_to(ROOT)
        if not copy.exists():
            copy.symlink_to(source)
    for folder in ("laws", "effects"):  # the others are links
        (place / "ident" / folder).unlink()
        copytree(ROOT / "ident" / folder, place / "ident" / folder)
    (place / "ident/laws/magnets.py").write_text(FILE)
    with (place / "ident/effects/effects.toml").open("a") as table:
        table.write(ROW)
    return place


@pytest.fixture(scope="module")
def seen(package: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What that copy says."""
    work = tmp_path_factory.mktemp("work")
    environment = {**os.environ, "PYTHONPATH": str(package)}
    command = [sys.executable, "-c", COMMANDS]
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_it_is_diagnosed_and_reported_and_a_motion_is_known_for_it(seen: dict[str, Any]) -> None:
    """Law: named at its joint, alone; it stands in the page, and its row's motion is what `plan excite` asks for."""
    assert seen["last"] == "magnet"
    assert seen["names"] == [["magnet", "joint_3"]]
    assert seen["report"]
    assert seen["motion"] == "slow"


@pytest.mark.parametrize("place", ["fit", "module", "plan"])
def test_its_torque_is_the_same_everywhere(place: str, seen: dict[str, Any]) -> None:
    """Law: model, written module, and planner give 2 sin 3q within what the recordings leave open."""
    assert seen[place] == pytest.approx(2.0 * np.sin(3.0 * np.array(seen["q"])), abs=0.1)


def test_its_slope_is_its_torques(seen: dict[str, Any]) -> None:
    """Law: planners differentiate it by the angle."""
    assert seen["slope"] == pytest.approx(6.0 * np.cos(3.0 * np.array(seen["q"])), abs=0.3)


def test_the_tests_of_the_catalogue_hold_for_it(package: Path) -> None:
    """Law: whoever adds a law need not touch them; they are run for it as for all others."""
    (package / "tests").unlink()
    copytree(ROOT / "tests/ident/effects", package / "tests/ident/effects")
    for source in ("tests/conftest.py", "tests/fuzz", "tests/ident/conftest.py"):
        (package / source).symlink_to(ROOT / source)
    environment = {**os.environ, "PYTHONPATH": str(package)}
    files = ("test_effect_catalogue.py", "test_effect_sentences.py")
    command = [sys.executable, "-m", "pytest", "-vv", "-k", "magnet or fixed or rows_of_the_table"]
    command += [str(package / "tests/ident/effects" / name) for name in files]
    done = subprocess.run(command, cwd=package, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    assert done.stdout.count("[magnet] PASSED") >= len(files)
