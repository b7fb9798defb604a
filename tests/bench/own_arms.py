"""Sessions of the project's own simulator without an effect, as `tests.bench.other_simulator` writes those of another.

    python -m tests.bench.own_arms OUT --sessions 45 --seed 61

A folder for each robot with `robot.urdf`, a folder of recordings a session, and `answers.json` with the true losses
and links. Friction changes from run to run about its true value as the worlds have it, but does not wander off: what
wanders has no true value, only a mean along the session that no recording tells from it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.benchmark.corpus_worlds import shortened
from ident.errors import InputError
from ident.files import atomic_folder
from ident.recordings.save import fill_session
from ident.robot.arm import ArmModel
from ident.simulation.hardware import build_model, without_geometry
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.simulation.world import find_worlds
from tests.bench.other_simulator.links import link_numbers

# Step of the model that is asked for its links; it is never moved.
STEP_S = 1e-3


def answer(simulation: Simulation) -> dict[str, Any]:
    """True losses and links of a session."""
    world = simulation.options.world
    assert world is not None
    hardware = simulation.hardware
    arm = hardware.arm
    model = build_model(arm.urdf, arm.joint_names, arm.links, hardware.bodies, STEP_S)
    losses = simulation.answer.losses
    kinds = next(iter(losses.values()))
    return {
        "kind": "null",
        "effects": [],
        "true_loss": {kind: [losses[joint][kind] for joint in arm.joint_names] for kind in kinds},
        "true_links": link_numbers(model),
        "world": world.to_dict(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sessions", type=int, default=45)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--worlds", default="all")
    given = parser.parse_args()
    ranges = find_worlds(given.worlds)
    rng = np.random.default_rng(given.seed)
    written = 0
    while written < given.sessions:
        drawn = shortened(ranges[int(rng.integers(len(ranges)))].draw(rng))
        world = replace(drawn, friction_drift=0.0)
        seed = int(rng.integers(2**31))
        options = SimulationOptions(seed=seed, coarse=True).in_world(world)
        session = f"session_{written:03d}"
        try:
            simulation = simulate(options, session)
        except InputError as error:
            print(f"{world.robot} {world.name}: {error}", flush=True)
            continue
        home = given.folder / Path(world.robot).stem
        home.mkdir(parents=True, exist_ok=True)
        urdf = without_geometry(ArmModel.load(world.robot).urdf)
        (home / "robot.urdf").write_text(urdf, encoding="utf-8")
        with atomic_folder(home / session, "session") as folder:
            fill_session(simulation.session.replace(robot="../robot.urdf"), folder)
        listed = home / "answers.json"
        answers = json.loads(listed.read_text(encoding="utf-8")) if listed.is_file() else {}
        answers[session] = answer(simulation)
        listed.write_text(json.dumps(answers, indent=1), encoding="utf-8")
        written += 1
        print(f"{world.robot} {world.name} {session}", flush=True)


if __name__ == "__main__":
    main()
