"""The plant's table: each effect's typical size, its visible amplitude at every joint, and the real-time factor.

    python tests/bench/bench_plant.py [JOINT]

The visible amplitude is given in multiples of the noise floor, on a session of ten rich runs of the TM5-900.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from ident.plant.causes import CATALOGUE, OUTSIDE, Circumstances
from ident.plant.hardware import draw_hardware
from ident.plant.simulate import RICH
from ident.plant.simulator import Simulator
from ident.plant.visibility import VisibilityMeter
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions


def main(joint_name: str = "joint_2") -> None:
    arm = ArmModel.load("tm5-900")
    joint = arm.joint_names.index(joint_name)
    hardware = draw_hardware(arm, np.random.default_rng([0, 1]))
    motions = plan_motions(arm, RICH, 10, 8.0, np.random.default_rng(0))
    meter = VisibilityMeter(hardware, motions, [8.0] * len(motions), 0)
    total = sum(motion.duration for motion in motions)
    floor = ", ".join(f"{value:.3f}" for value in hardware.sensing.noise_floor)
    print(f"{len(motions)} runs, {total:.0f} s; noise floor [N m]: {floor}\n")
    print("| effect | at | size | " + " | ".join(f"J{j + 1}" for j in range(arm.n)) + " | × real time |")
    print("|---|---|---|" + "---|" * (arm.n + 1))
    for cause in (*CATALOGUE.values(), *OUTSIDE.values()):
        scene = Circumstances(hardware, joint, motions, np.random.default_rng(2))
        size = cause.typical(scene)
        seen = meter.measure(cause, scene, size, 2) / hardware.sensing.noise_floor
        changed, _ = cause.apply(Circumstances(hardware, joint, motions, np.random.default_rng(2)), size)
        start = time.process_time()
        Simulator(changed, np.random.default_rng(0)).run(motions, [8.0] * len(motions), lambda: None)
        factor = total / (time.process_time() - start)
        cells = " | ".join(f"{value:.2f}" for value in seen)
        where = "arm" if cause.whole_arm else joint_name
        print(f"| `{cause.id}` | {where} | {cause.parameter} {size:.4g} | {cells} | {factor:.0f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
