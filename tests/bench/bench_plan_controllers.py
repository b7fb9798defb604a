"""Random tasks written for every controller, the files executed by code of their own and looked at by a second checker.

    python tests/bench/bench_plan_controllers.py [TASKS] [--controllers NAME,NAME] [--seconds S] [--first SEED]
                                                 [--known]

Arms, models, scenes and tools as in bench_plan_checked.py; by turns energy and time, S processor seconds a task (4).
Plans go to their limits of torque and speed (`beyond`), with --known they stay where the makers advise. What a
controller makes of the written file is emulated from its own sources, and torque (dynamics written anew from the URDF),
speed, clearance (Coal on the URDF's meshes), goal and duration of that motion are looked at. One line a controller:
tasks, plans, what is broken, largest share of a limit that was executed, and by how much the search on its step raised
the cost over that of the same search without a controller, where both found a plan.
"""

import argparse
import json
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
import tomli_w

from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.robot.arm import ArmModel
from plan.api.planning import solve
from plan.geometry.scene import Scene
from plan.problem.controllers import Controller, load_controllers
from plan.problem.execution import write_motion_file
from tests.bench.bench_plan_checked import BOXES, ROBOTS, TIPS, Bench, draw, prepared
from tests.plan.checker import SHORT, Model, World
from tests.plan.emulated_controllers import (
    moved,
)

# Arms by which each controller is tried, by turns.
ARMS = {
    "tmscript": ("tm5-900/3", "tm5-900"),
    "tm_ros2": ("tm5-900", "tm5-900/3"),
    "ros2_control": ("panda", "tm5-900", "ur5"),
    "ur_spline": ("ur5",),
    "ur_servoj": ("ur5",),
    "ur_servoj_cb3": ("ur5",),
}
# Rounding that is let pass, as a share of a limit; how near to the goal the motion ends [rad]; positions looked at.
ROUNDING, THERE, COARSE = 1e-6, 2e-5, 400


@dataclass
class Tally:
    """What became of a controller's tasks."""

    tasks: int = 0
    plans: int = 0
    broken: list[str] = field(default_factory=list)
    largest: float = 0.0
    dearer: list[float] = field(default_factory=list)


def one_task(
    number: int,
    controller: Controller,
    robot: str,
    bench: Bench,
    seconds: float,
    known: bool,
    tally: Tally,
    folder: Path,
) -> None:
    """Draws a task, plans and writes it, and has the executed motion looked at."""
    rng, moving, name = np.random.default_rng([2028, number]), ROBOTS[robot], robot.split("/")[0]
    drawn = draw(bench.arm, bench.free, rng, moving, int(rng.choice(BOXES[:3])))
    objective = ("energy", "time")[number % 2]
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps({"robot": name, **drawn}))
    asked = {"objective": objective, "seconds": seconds, "gap": False, "seed": number, "beyond": not known}
    try:
        result = solve(path, bench.model, controller=controller.name, **asked)
    except InputError:  # the task is at fault: an end inside a box
        return
    tally.tasks += 1
    if not result.solved:
        return
    tally.plans += 1
    out = folder / f"motion{controller.suffix}"
    write_motion_file(result, out)
    rest = np.array(list(result.held.values()))
    run = moved(controller.name, controller.tick_s, out, np.concatenate([result.splines.points[0, 0], rest]))
    whole = tomllib.loads(path.read_text())
    source = ArmModel.load(name).source
    packages = [str(Path(pin.__file__).parents[4] / "share"), str(source.parents[3])]
    world = World(source, packages, whole, tip=TIPS[name])
    model = bench.checked.carrying(whole["payload"], world, TIPS[name]) if "payload" in whole else bench.checked
    count = len(bench.checked.joints)
    torque = np.abs(model.torque(*(part[:, :count] for part in (run.q, run.dq, run.ddq)))[:, :moving])
    shares = {
        "torque": float((torque / bench.arm.effort_limit[:moving]).max()),
        "speed": float((np.abs(run.dq[:, :moving]) / bench.arm.velocity_limit[:moving]).max()),
    }
    label = f"task {number}, {robot}, {objective}, {controller.name}"
    for limit, share in shares.items():
        tally.largest = max(tally.largest, share)
        if share > 1.0 + ROUNDING:
            tally.broken.append(f"{label}: {limit} {100 * share:.3f} %")
    goal = np.radians(whole["task"]["goal_deg"])
    if np.abs(run.q[-1, :moving] - goal).max() > THERE:
        tally.broken.append(f"{label}: goal missed")
    asked_for = whole["task"]["duration_s"]
    if (
        objective == "energy"
        and abs(run.times[-1] - run.times[0] - asked_for) > 2.0 * controller.tick_s + controller.stamp_s
    ):
        tally.broken.append(f"{label}: takes {run.times[-1]:.4f} s for {asked_for:.4f} s")
    record = result.to_dict()
    left_out = {frozenset(pair["links"]) for pair in record["unchecked_pairs"]}
    named = {**dict.fromkeys(record["joints"], float("nan")), **record["held"]}
    kept = {frozenset(cut["links"]): cut["kept_m"] for cut in record["clearance_cuts"]}
    some = run.q[:: max(1, len(run.q) // COARSE), :moving]
    near = world.near(named, some, left_out, whole["task"]["clearance_m"] - 2.0 * SHORT, kept)
    tally.broken += [f"{label}: {pair}" for pair in near]
    plain = solve(path, bench.model, **asked)
    if plain.solved:
        tally.dearer.append(result.cost / plain.cost - 1.0)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=100)
    parser.add_argument("--controllers", default=",".join(ARMS))
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--known", action="store_true")
    options = parser.parse_args()
    known = {controller.name: controller for controller in load_controllers()}
    benches: dict[str, Bench] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name in options.controllers.split(","):
            tally = Tally()
            for k in range(options.first, options.first + options.tasks):
                robot = ARMS[name][(k // 2) % len(ARMS[name])]
                if robot not in benches:
                    fitted = prepared(robot, folder, None)
                    arm = HybridModel.load(fitted).robot
                    benches[robot] = Bench(fitted, arm, Scene.build(arm), Model(fitted))
                one_task(k, known[name], robot, benches[robot], options.seconds, options.known, tally, folder)
            dearer = f"{100 * np.median(tally.dearer):.2f} %" if tally.dearer else "none"
            print(json.dumps(tally.broken), flush=True)
            print(
                f"{name}: {tally.tasks} tasks, {tally.plans} plans, {len(tally.broken)} broken; largest share "
                f"{100 * tally.largest:.2f} %; dearer by {dearer} (median)",
                flush=True,
            )


if __name__ == "__main__":
    main()
