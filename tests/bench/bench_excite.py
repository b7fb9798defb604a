"""Does the proposed motion tell tied effects apart? Each truth of each pair, on proposed and on random motion.

    python tests/bench/bench_excite.py [FOLDER] [MINUTES] [SIDE …]

SIDE is 1 or 2: which effect of each pair is planted; both if none is given. For every pair `plan excite` proposes a
motion; the simulated arm runs it, and random motion through via points of the same length, with an effect of the pair
at its typical size. The diagnosis then sees the recording alone. "right" means that the first finding is the truth at
its joint and its class single; "extra" counts findings of what is not there; D is the smaller of the two distances, by
which motions are judged, and of random motion the median of three draws. FOLDER keeps the diagnoses as JSON.
"""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.checks.inspection import inspect_sessions
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from plan.command_options import ExciteOptions
from plan.experiment.design import Designer
from plan.experiment.hypotheses import ask
from plan.experiment.result import Excitation

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
RATE = 100.0  # of the log [Hz]
MINUTES = 1.0
EVALUATIONS = 80


def random_motion(arm: ArmModel, proposed: Excitation) -> Sequence[ReferenceMotion]:
    count = len(proposed.runs)
    return plan_motions(arm, ("spline",), count, proposed.duration / count, np.random.default_rng(SEED))


def diagnosed(arm: ArmModel, truth: str, joint: str, motions: Sequence[ReferenceMotion]) -> dict[str, Any]:
    """The diagnosis of an arm with one effect, from a recording of some motions."""
    options = SimulationOptions(effects=(f"{truth}:{joint}",), seed=SEED, rate=RATE)
    session = simulate(options, "bench", motions=motions).session
    diagnosis, _, _ = diagnose_reports(inspect_sessions([session], arm), arm, CATALOGUE)
    return diagnosis.to_dict()


def verdict_of(record: dict[str, Any], truth: str, joint: str) -> str:
    """What was said in short, whether it is single and right, and how many findings are of what is not there."""
    findings = record["findings"]
    scope = find_effect(truth).scope

    def is_true(one: dict[str, Any]) -> bool:
        return one["effect"] == truth and (scope == "arm" or one["joints"] == [joint])

    names = ["/".join(one["class"]) + f"@{one['joints'][0]}" for one in findings]
    right = bool(findings) and is_true(findings[0]) and len(findings[0]["class"]) == 1
    extra = sum(not is_true(one) for one in findings)
    return f"{', '.join(names)} ({record['verdict']}) | {'yes' if right else 'no'} | {extra}"


def row(arm: ArmModel, pair: tuple[str, str, str], side: int, proposed: Excitation, folder: Path | None) -> str:
    """One effect of a pair, on proposed and on random motion."""
    truth, rival, joint = pair[side], pair[1 - side], pair[2]
    began, said = time.perf_counter(), []
    for kind, motions in (("proposed", proposed.runs), ("random", random_motion(arm, proposed))):
        record = diagnosed(arm, truth, joint, motions)
        said.append(verdict_of(record, truth, joint))
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{truth}_{rival}_{kind}.json").write_text(json.dumps(record, indent=1))
    smallest, by_chance = (f"{value:.3g}" for value in proposed.smallest)
    return (
        f"| {truth} against {rival} ({joint}) | {proposed.run_set.family}, {proposed.duration / 60:.1f} | "
        f"{smallest} | {by_chance} | "
        f"{' | '.join(said)} | {time.perf_counter() - began:.0f} |"
    )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    minutes = float(sys.argv[2]) if len(sys.argv) > 2 else MINUTES
    sides = [int(number) - 1 for number in sys.argv[3:]] or [0, 1]
    arm = ArmModel.load("tm5-900")
    print(
        "| truth against rival | family, min | D proposed | D random "
        "| on proposed motion | right | extra | on random motion | right | extra | s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    found: dict[int, Excitation] = {}
    for side in sides:
        for number, pair in enumerate(PAIRS):
            if number not in found:
                question = ask(arm, f"{pair[0]},{pair[1]}", pair[2], None)
                options = ExciteOptions(minutes=minutes, evaluations=EVALUATIONS, seed=SEED)
                found[number] = Designer(arm, question, options).best()
            print(row(arm, pair, side, found[number], folder), flush=True)


if __name__ == "__main__":
    main()
