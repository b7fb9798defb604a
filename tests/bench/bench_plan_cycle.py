"""What planning a cycle as a whole gains: durations shared out, and turns of the grip that are free.

    python tests/bench/bench_plan_cycle.py [--cases three,six,wide,ur5] [--turns N] [--seconds S]

Each case is a cycle of two stops, 2 kg gripped at the first and released at the second, without a
fitted model, of least energy in a fixed duration and S processor seconds (12). Told are the energy
of the certified motions; what the durations as shared out cost on the motions' curves, beside each
motion taking the same multiple of its shortest; and the seconds spent. With --turns the stops are
given as poses of the last link, at N turns about its axis, as a round part may be held.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.robot.arm import ArmModel
from plan.api.cycles import cycle

SCENE = """robot = "{robot}"
[task]
start_deg = {start}
goal_deg = {start}
duration_s = {duration}
[payload]
mass_kg = 2.0
com_m = [0, 0, 0.05]
[[leg]]
{grip}
dwell_s = 0.3
does = "grip"
[[leg]]
{release}
dwell_s = 0.2
does = "release"
"""
# Robot, start, where it grips and releases [deg], and duration [s].
CASES = {
    "three": ("tm5-900", [50, 0, -120], [80, 30, -90], [20, 20, -100], 8.5),
    "six": (
        "tm5-900",
        [0, 0, 90, 0, 90, 0],
        [70, 10, 100, -20, 90, 30],
        [-60, 20, 80, -10, 90, -40],
        8.5,
    ),
    "wide": (
        "tm5-900",
        [0, 0, 90, 0, 90, 0],
        [150, 30, 90, -30, 90, 0],
        [-100, 30, 90, -30, 90, 90],
        9.5,
    ),
    "ur5": (
        "ur5",
        [0, -90, 90, -90, -90, 0],
        [90, -70, 110, -130, -90, 60],
        [-80, -60, 100, -130, -90, -50],
        9.5,
    ),
}


def place_keys(robot: str, q: list[float], turns: int) -> str:
    """A stop's keys: its angles [deg], or poses of the last link at so many turns."""
    if turns == 0:
        return f"deg = {q}"
    arm = ArmModel.load(robot)
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, np.radians(q))
    placement = data.oMf[arm.model.getFrameId(arm.links[-1])]
    poses = []
    for turn in 2.0 * np.pi * np.arange(turns) / turns:
        rotation = placement.rotation @ pin.utils.rotate("z", float(turn))
        quaternion = pin.Quaternion(rotation).coeffs().tolist()
        place = placement.translation.tolist()
        poses.append(f"{{ xyz_m = {place}, quaternion_xyzw = {quaternion} }}")
    return f"pose = [{', '.join(poses)}]"


def measure(name: str, turns: int, seconds: float, folder: Path) -> str:
    """A case's row."""
    robot, start, grip, release, duration = CASES[name]
    path = folder / "cycle.toml"
    text = SCENE.format(
        robot=robot,
        start=start,
        duration=duration,
        grip=place_keys(robot, grip, turns),
        release=place_keys(robot, release, turns),
    )
    path.write_text(text)
    began = time.process_time()
    found = cycle(path, beyond=True, seconds=seconds, gap=False)
    spent = time.process_time() - began
    if not found.solved:
        return f"| {name} | no plan: {found.reason} |"
    gain = 1.0 - found.shared / found.even
    energies = f"{found.energy:.2f} | {found.shared:.2f} | {found.even:.2f} | {gain:.2%}"
    return f"| {name} | {energies} | {spent:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--turns", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=12.0)
    options = parser.parse_args()
    print("| cycle | found [J] | shared out [J] | one by one [J] | gain | CPU [s] |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.cases.split(","):
            print(measure(name, options.turns, options.seconds, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
