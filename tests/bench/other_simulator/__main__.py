"""Simulated sessions that share no code with this project's plant: MuJoCo's dynamics, bristles, another controller.

    python -m tests.bench.other_simulator FOLDER --sessions 20 --seed 1 [--arms tm5-900,ur5,panda]

Writes for each arm a folder with `robot.urdf` (the nominal arm, stripped of meshes), one folder of recordings a session
and `answers.json`, which `bench_otherworld.py` reads beside a diagnosis of each. Own throughout: MuJoCo integrates the
rigid body at 2 kHz, friction is a LuGre bristle per joint (Canudas de Wit, Olsson, Aström and Lischinsky 1995), springy
and loose gears are two masses, a PD controller with feed-forward follows splines, Fourier sums, slow sweeps and chirps,
and torque is logged with white and coloured noise that grows with load. All runs of a session move at once: the step
costs one call of MuJoCo a run and some array arithmetic for all of them.

An effect's size is set by a pilot: what its torque leaves when each joint's sign, speed, acceleration and a constant
are fitted to it, in units of the torque's noise at the joint where it shows most.
"""

import argparse
import json
import shutil
from pathlib import Path

import numpy as np

from ident.robot.names import find_urdf
from tests.bench.other_simulator.drawn import DRAWN, OUTSIDE
from tests.bench.other_simulator.sessions import lock_rest, make_session, moving_joints, strip

LOST = 0.5  # [rad] between reference and motion


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--arms", default="tm5-900,ur5,panda")
    parser.add_argument("--healthy", type=float, default=0.35)
    parser.add_argument("--outside", type=float, default=0.1)
    parser.add_argument("--pairs", type=float, default=0.0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    arms = given.arms.split(",")
    for arm in arms:
        text = strip(Path(find_urdf(arm)))
        names = [str(j.get("name")) for j in moving_joints(text)]
        text = lock_rest(text, names)
        home = given.folder / arm
        home.mkdir(parents=True, exist_ok=True)
        (home / "robot.urdf").write_text(text, encoding="utf-8")
        answers = {}
        for i in range(given.sessions // len(arms)):
            draw = rng.random()
            kind = drawn_kind(draw, given, rng)
            session = f"session_{i:03d}"
            answers[session] = make_session(text, names, kind, int(rng.integers(2**62)), home / session)
            if answers[session]["largest_error_rad"] > LOST:  # the controller lost the arm: no session
                print(arm, session, kind, "lost", flush=True)
                answers.pop(session)
                shutil.rmtree(home / session)
                continue
            (home / "answers.json").write_text(json.dumps(answers, indent=1), encoding="utf-8")
            seen = answers[session]["effects"]
            print(arm, session, kind, *((one["effect"], one["visible"]) for one in seen), flush=True)


def drawn_kind(draw: float, given: argparse.Namespace, rng: np.random.Generator) -> str:
    """A session's kind from a number between 0 and 1: healthy, single, pair, outside in this order."""
    if draw < given.healthy:
        return "healthy"
    if draw > 1.0 - given.outside:
        return str(rng.choice(OUTSIDE))
    return "pair" if draw > 1.0 - given.outside - given.pairs else str(rng.choice(DRAWN))


if __name__ == "__main__":
    main()
