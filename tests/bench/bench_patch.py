"""Patches of ten effects and more, verified on runs that the diagnosis never saw.

    python tests/bench/bench_patch.py [EFFECT:JOINT:SIZE …]

Two thirds of the runs are diagnosed, with the one effect in the catalogue: this is about patches, not about names. The
patch is made from the diagnosis alone and measured on the rest: torque gap over all joints in units of each joint's
noise, and the miss of the position after a quarter of a second under the logged torque. `before` are the URDF's
inertias with tuned losses, `tuned` are tuned inertias and losses, neither with the effect.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from ident.checks import inspect_sessions
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import find_effect
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.write import write_patch
from ident.motion.filter import FOR_DIAGNOSIS
from ident.motion.motion import prepare
from ident.robot.arm import ArmModel
from ident.simulation.simulate import Simulation, SimulationOptions, simulate

EFFECTS = (
    "payload:arm:0.6",
    "gravity_misalignment:arm:0.02",
    "link_inertial_error:joint_3:0.3",
    "encoder_offset:joint_3:0.05",
    "spring_torque:joint_3:10",
    "joint_elasticity:joint_2:8000",
    "torque_gain_error:joint_2:0.08",
    "torque_offset:joint_1:2",
    "torque_delay:arm:0.012",
    "nonlinear_viscous_friction:joint_1:3",
    "stribeck_friction:joint_1:4",
    "asymmetric_friction:joint_2:4",
)
RUNS, SEED = 9, 5
WHEN = ("before", "tuned", "after", "after_with_module")


def main(effects: list[str]) -> None:
    arm = ArmModel.load("tm5-900")
    print(f"{RUNS} runs, a third held out; gap in noise floors (root mean square over joints) / miss in mrad\n")
    columns = " | ".join(
        f"{form} {when}" for form in ("URDF", "MJCF") for when in ("before", "tuned", "patched", "+ module")
    )
    print(f"| effect | named | in URDF | in MJCF | {columns} | s |")
    print("|---|" + "---|" * 12)
    for effect in effects or EFFECTS:
        start = time.perf_counter()
        try:
            cells = measure(arm, effect)
        except InputError as error:
            cells = str(error)
        print(f"| `{effect}` | {cells} | {time.perf_counter() - start:.0f} |", flush=True)


def measure(arm: ArmModel, effect: str) -> str:
    """One row of the table."""
    simulation = simulate(SimulationOptions(effects=(effect,), seed=SEED, runs=RUNS, duration=6.0))
    record = patch(arm, simulation, effect.split(":")[0])
    wanted = [item for item in record["effects"] if item["effect"] == effect.split(":")[0]]
    shown = (wanted or record["effects"])[0]
    named = " + ".join(f"{item['effect']} {item['joints'][0]}" for item in record["effects"])
    formats = " | ".join(shown["formats"][form]["expressed"] for form in ("urdf", "mjcf"))
    floor = np.array(list(simulation.answer.noise_floor_Nm.values()))
    gaps = [record["heldout"]["gaps"][form][when] for form in ("urdf", "mjcf") for when in WHEN]
    return f"{named} | {formats} | " + " | ".join(_cell(gap, floor) for gap in gaps)


def _cell(gap: dict[str, Any], floor: np.ndarray) -> str:
    torque = np.array(list(gap["torque_rms_Nm"].values())) / floor
    miss = 1e3 * np.array(list(gap["position_rms_rad"].values()))
    return f"{np.sqrt(np.mean(torque**2)):.2f} / {np.sqrt(np.mean(miss**2)):.1f}"


def patch(arm: ArmModel, simulation: Simulation, effect: str) -> dict[str, Any]:
    """Diagnoses some runs and measures the patch on the others."""
    # Every third run, so that both parts hold all kinds of motion.
    rest = [k for k in range(RUNS) if k % 3 == 1]
    runs = simulation.session.runs
    training = simulation.session.replace(runs=tuple(run for k, run in enumerate(runs) if k not in rest))
    held_out = simulation.session.replace(runs=tuple(runs[k] for k in rest))
    diagnosis, _, _ = diagnose_reports(inspect_sessions([training], arm), arm, (find_effect(effect),))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "diagnosis.json"
        path.write_text(json.dumps(diagnosis.to_dict()), encoding="utf-8")
        return write_patch(Diagnosed.load(path), arm, Path(name) / "patch", prepare(held_out, FOR_DIAGNOSIS.cutoff_hz))


if __name__ == "__main__":
    main(sys.argv[1:])
