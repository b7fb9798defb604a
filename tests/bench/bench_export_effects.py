"""What each format holds of each effect: files loaded back and replayed on motion that none was made for.

    python tests/bench/bench_export_effects.py FOLDER [EFFECT ...] > effects.toml

The TM5-900 has known losses and one effect at a time, of the size that tests of patches give it; its log
is that of the effect's law along smooth motions. A diagnosis that says so is patched; files are loaded in
Pinocchio and MuJoCo and held against the log on other motions, beside the URDF alone: RMS error of the
torque over all joints, and millimetres at the tool after a quarter of a second of logged torque. What is
printed is a table for docs/figures.toml.
"""

import json
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import LawModel, LoadedModel, LoadedUrdf, load_module
from ident.export.promotion import Distance, measure_distance
from ident.export.write import write_patch
from ident.laws.carried import KINDS
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.bench.bench_patch import load
from tests.ident.export.diagnoses import FIGURES, write_diagnosis
from tests.ident.made_up import exact_motion, multisine

RATE = 100.0
SECONDS = 6.0
SEEDS = (11, 12)
# What is less than this is rounding [N m].
ROUNDING = 1e-9
COLUMNS = ["effect", "URDF alone", "URDF", "MJCF", "URDF + module", "MJCF + module", "C++, ONNX"]
ABOUT = (
    "Torque error [N m] and, after the semicolon, miss at the tool after 0.25 s of logged torque [mm] of files"
    " with one effect and known losses, loaded back in Pinocchio and MuJoCo, on motion that none was made for"
    " and whose log the law itself gives."
)
NOTE = (
    "Isaac Lab, ros2_control, Newton and feed-forward files hold the losses that stand in, as the URDF does."
    " Laws in C++ and ONNX are measured by tests/ident/export; what they lack is refused, or told, by name."
    " MuJoCo's steps and its dry friction at rest alone are 0.035 N m and 0.3 mm. A flat top takes torque from"
    " the log, with which nothing can be replayed; warmth stands still in these motions."
)


def make_runs(arm: ArmModel, law: LawModel) -> list[Motion]:
    """Logs of smooth motions of an arm by its law."""
    clock = np.arange(int(SECONDS * RATE)) / RATE
    motions = []
    for seed in SEEDS:
        states = multisine(np.random.default_rng(seed), clock, arm.n)
        torque = law.joint_torque(*states, 1.0 / RATE)
        log = law.read_log(torque, 1.0 / RATE)
        motions.append(exact_motion(clock, states, log, arm.joint_names, f"run_{seed}"))
    return motions


def measure_effect(effect: str, arm: ArmModel, folder: Path) -> dict[str, Distance]:
    """How far the URDF alone, the files, and the files with the module are from an arm with an effect."""
    diagnosed = Diagnosed.load(write_diagnosis(folder / f"{effect}.json", arm, effect))
    if not any(change.has_law for change in diagnosed.changes):
        raise ValueError("it has no law that files could hold")
    law = LawModel.of(diagnosed.candidates(arm)["after"])
    runs = make_runs(arm, law)
    out = folder / effect
    write_patch(diagnosed, arm, out)
    models: dict[str, LoadedModel] = {}
    for form in ("urdf", "mjcf"):
        models[form] = load(out, form, arm, None)
        models[f"{form} + module"] = load(out, form, arm, None)
        models[f"{form} + module"].module = load_module(out / "extra_torque.py")
    found = {"nominal": measure_distance(nominal_of(arm), runs, arm)}
    return found | {name: measure_distance(model, runs, arm) for name, model in models.items()}


def nominal_of(arm: ArmModel) -> LoadedModel:
    """The URDF alone."""
    return LoadedUrdf(arm, IdentifiedArm.as_urdf(arm).losses, None)


def cell(distance: Distance) -> str:
    torque = distance.rms("torque_rms_Nm")
    said = _short(torque) if torque > ROUNDING else "0"
    return f"{said}; {_short(1e3 * distance.rms('tool_rms_m'))}"


def _short(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def row(effect: str, distances: Mapping[str, Distance]) -> list[str]:
    """A row of the table."""
    order = ("nominal", "urdf", "mjcf", "urdf + module", "mjcf + module")
    compiled = "the law" if effect in KINDS else "not in it"
    return [effect, *(cell(distances[name]) for name in order), compiled]


def main(folder: str, *names: str) -> None:
    scratch = Path(folder)
    scratch.mkdir(parents=True, exist_ok=True)
    arm = ArmModel.load("tm5-900")
    rows = []
    for effect in names or FIGURES:
        try:
            rows.append(row(effect, measure_effect(effect, arm, scratch)))
        except (KeyError, ValueError) as error:
            print(f"# {effect}: {error}", file=sys.stderr)
            continue
        print(f"# {rows[-1]}", file=sys.stderr, flush=True)
    words = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    texts = {
        "about": ABOUT,
        "command": "python tests/bench/bench_export_effects.py FOLDER",
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit,
        "note": NOTE,
    }
    print("[export_effects]")
    for key, text in texts.items():
        print(f"{key} = {json.dumps(text, ensure_ascii=False)}")
    print(f"columns = {json.dumps(COLUMNS, ensure_ascii=False)}")
    lines = [f"  {json.dumps(cells, ensure_ascii=False)}," for cells in rows]
    print("\n".join(["rows = [", *lines, "]"]))


if __name__ == "__main__":
    main(*sys.argv[1:])
