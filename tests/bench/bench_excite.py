"""Does the proposed motion tell tied effects apart? Each truth of each pair, on proposed and on random motion.

    python tests/bench/bench_excite.py [FOLDER] [MINUTES] [SIDE …]

SIDE is 1 or 2: which effect of each pair is planted; both if none is given. For every pair `plan excite` proposes a
motion; the simulated arm runs it, and random motion through via points of the same length, with an effect of the pair
at its typical size. The diagnosis then sees the recording alone. "right" means that the class of the first finding is
single and is the truth. FOLDER keeps the diagnoses as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.arm import ArmModel
from ident.diagnosis.command import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.plant.motions import plan_motions
from ident.plant.session import SimulationOptions, simulate
from ident.plant.shapes import Motion
from ident.telemetry import inspect_sessions
from plan.excitation.excite import excite
from plan.excitation.question import ask
from plan.excitation.result import Excitation

# Two effects and the joint at which each is planted.
PAIRS = (
    ("joint_elasticity", "torque_delay", "joint_3"),
    ("stribeck_friction", "presliding_hysteresis", "joint_2"),
    ("stribeck_friction", "nonlinear_viscous_friction", "joint_2"),
    ("load_dependent_friction", "position_dependent_friction", "joint_2"),
    ("spring_torque", "gravity_misalignment", "joint_3"),
    ("torque_offset", "asymmetric_friction", "joint_2"),
)
SEED = 11
RATE = 125.0  # of the log [Hz]
MINUTES = 1.5
EVALUATIONS = 100


def random_motion(arm: ArmModel, proposed: Excitation) -> Sequence[Motion]:
    count = len(proposed.runs)
    return plan_motions(arm, ("spline",), count, proposed.duration / count, np.random.default_rng(SEED))


def diagnosed(arm: ArmModel, truth: str, joint: str, motions: Sequence[Motion]) -> dict[str, Any]:
    """The diagnosis of an arm with one effect, from a recording of some motions."""
    options = SimulationOptions(effects=(f"{truth}:{joint}",), seed=SEED, rate=RATE)
    session = simulate(options, "bench", motions=motions).session
    diagnosis, _, _ = diagnose_reports(inspect_sessions([session], arm), arm, CATALOGUE)
    return diagnosis.to_dict()


def verdict_of(record: dict[str, Any], truth: str) -> tuple[str, bool]:
    """What was said in short, and whether it is single and right."""
    if not record["findings"]:
        return record["verdict"], False
    names = ["/".join(one["class"]) + f"@{one['joints'][0]}" for one in record["findings"]]
    return ", ".join(names), record["findings"][0]["class"] == [truth]


def row(arm: ArmModel, pair: tuple[str, str, str], side: int, proposed: Excitation, folder: Path | None) -> str:
    """One effect of a pair, on proposed and on random motion."""
    truth, rival, joint = pair[side], pair[1 - side], pair[2]
    began, said = time.perf_counter(), []
    for kind, motions in (("proposed", proposed.runs), ("random", random_motion(arm, proposed))):
        record = diagnosed(arm, truth, joint, motions)
        said.append(verdict_of(record, truth))
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{truth}_{rival}_{kind}.json").write_text(json.dumps(record, indent=1))
    cells = [f"{words} | {'yes' if right else 'no'}" for words, right in said]
    return (
        f"| {truth} against {rival} ({joint}) | {proposed.programme.family}, {proposed.duration / 60:.1f} | "
        f"{proposed.distances[(truth, rival)]:.3g} | {proposed.random[(truth, rival)]:.3g} | "
        f"{' | '.join(cells)} | {time.perf_counter() - began:.0f} |"
    )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    minutes = float(sys.argv[2]) if len(sys.argv) > 2 else MINUTES
    sides = [int(number) - 1 for number in sys.argv[3:]] or [0, 1]
    arm = ArmModel.load("tm5-900")
    print("| truth against rival | family, min | D proposed | D random | proposed | right | random | right | s |")
    print("|---|---|---|---|---|---|---|---|---|")
    found: dict[int, Excitation] = {}
    for side in sides:
        for number, pair in enumerate(PAIRS):
            if number not in found:
                question = ask(arm, f"{pair[0]},{pair[1]}", pair[2], None)
                found[number] = excite(arm, question, minutes, evaluations=EVALUATIONS, seed=SEED)
            print(row(arm, pair, side, found[number], folder), flush=True)


if __name__ == "__main__":
    main()
