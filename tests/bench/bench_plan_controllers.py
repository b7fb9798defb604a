"""Random tasks written for every controller, the files executed by code of their own and looked at by a second checker.

    python tests/bench/bench_plan_controllers.py [TASKS] [--controllers NAME,NAME] [--seconds S]
                                                 [--first SEED] [--known] [--alone] [--rows FILE]

Arms, models, scenes and tools as in bench_plan_checked.py; by turns energy and time, S processor
seconds a task (4). Plans go to their limits of torque and speed (`beyond`); with --known, as by
default, they stay where the makers advise, durations are drawn for that, and acceleration is looked
at, too. What a controller makes of the written file is emulated from its own sources, and torque
(dynamics written anew from the URDF), speed, clearance (Coal on the URDF's meshes), goal and
duration of that motion are looked at.

One line a controller: tasks, plans, what is broken, largest share of a limit that was executed, and
by how much the search on its step raised the cost over that of the same search without a
controller, where both found a plan; --alone leaves that second search out. Controllers take turns
at a task, so what was done when a run ends is shared out evenly. FILE gets a line for each task and
controller, and the summary speaks of all its lines: so a long run can be made in pieces.
"""

import argparse
import json
import tempfile
import time
import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import tomli_w

from ident.arrays import Array
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.robot.arm import ArmModel
from plan.api.planning import open_task, solve
from plan.command_options import SolveOptions
from plan.geometry.scene import Scene
from plan.problem.controllers import Controller, load_controllers
from plan.problem.execution import write_motion_file
from plan.problem.result import PlanResult
from plan.solving.obstruction import shortest_duration
from tests.bench.bench_plan_checked import BOXES, ROBOTS, TIPS, Bench, draw, prepared
from tests.plan.checker import SHORT, Model, World
from tests.plan.emulated_controllers import moved

# Arms by which each controller is tried, by turns.
ARMS = {
    "tmscript": ("tm5-900/3", "tm5-900"),
    "tm_ros2": ("tm5-900", "tm5-900/3"),
    "ros2_control": ("panda", "tm5-900", "ur5"),
    "ur_spline": ("ur5",),
    "ur_servoj": ("ur5",),
    "ur_servoj_cb3": ("ur5",),
}
# Durations that are drawn where the makers advise, as multiples of the shortest.
TIGHT = (1.05, 2.0)
# Rounding that is let pass, as a share of a limit; how near to the goal the motion ends [rad]; positions looked at.
ROUNDING, THERE, COARSE = 1e-6, 2e-5, 400


@dataclass(frozen=True)
class Row:
    """What became of a task of one controller.

    Seconds are the processor time of planning alone; `dearer` the cost above that of the same search
    without a controller, as a share, None where it is not known.
    """

    controller: str
    task: int
    robot: str
    objective: str
    status: str
    broken: tuple[str, ...] = ()
    largest: float = 0.0
    seconds: float = 0.0
    dearer: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class Asked:
    """How each task is planned: processor seconds, whether where the makers advise, whether for a controller alone."""

    seconds: float
    known: bool
    alone: bool


def one_task(number: int, controller: Controller, robot: str, bench: Bench, asked: Asked, folder: Path) -> Row:
    """Draws a task, plans and writes it, and has the executed motion looked at."""
    rng = np.random.default_rng([2028, number])
    moving = ROBOTS[robot]
    drawn = draw(bench.arm, bench.free, rng, moving, int(rng.choice(BOXES[:3])))
    objective = ("energy", "time")[number % 2]
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps({"robot": robot.split("/")[0], **drawn}))
    allowed = None
    if asked.known:
        try:
            problem = open_task(path, bench.model, SolveOptions()).problem
        except InputError:
            return Row(controller.name, number, robot, objective, "refused")
        allowed = problem.limits.acceleration
        needed = shortest_duration(problem) * rng.uniform(*TIGHT)
        drawn["task"]["duration_s"] = max(drawn["task"]["duration_s"], float(needed))
        path.write_text(tomli_w.dumps({"robot": robot.split("/")[0], **drawn}))
    row = Row(controller.name, number, robot, objective, "refused")
    options = {
        "objective": objective,
        "seconds": asked.seconds,
        "gap": False,
        "seed": number,
        "beyond": not asked.known,
    }
    began = time.process_time()
    try:
        result = solve(path, bench.model, controller=controller.name, **options)
    except InputError:  # the task is at fault: an end inside a box
        return row
    except Exception as error:  # ours is
        return replace(row, status="crashed", broken=(repr(error),))
    spent = time.process_time() - began
    row = replace(row, status=result.status, seconds=spent, reason=result.reason)
    if not result.solved:
        return row
    broken, largest = look_at(result, controller, bench, path, folder, allowed)
    row = replace(row, broken=tuple(broken), largest=largest)
    if asked.alone:
        return row
    plain = solve(path, bench.model, **options)
    return replace(row, dearer=result.cost / plain.cost - 1.0) if plain.solved else row


def look_at(
    result: PlanResult,
    controller: Controller,
    bench: Bench,
    scene: Path,
    folder: Path,
    acceleration: Array | None,
) -> tuple[list[str], float]:
    """What is broken by the executed motion of a plan, and the largest share of a limit."""
    out = folder / f"motion{controller.suffix}"
    write_motion_file(result, out)
    rest = np.array(list(result.held.values()))
    start = np.concatenate([result.splines.points[0, 0], rest])
    run = moved(controller.name, controller.tick_s, out, start)
    whole = tomllib.loads(scene.read_text())
    name = whole["robot"]
    source = ArmModel.load(name).source
    packages = [str(Path(pin.__file__).parents[4] / "share"), str(source.parents[3])]
    world = World(source, packages, whole, tip=TIPS[name])
    carries = "payload" in whole
    model = bench.checked.carrying(whole["payload"], world, TIPS[name]) if carries else bench.checked
    count = len(bench.checked.joints)
    moving = len(result.joints)
    torque = np.abs(model.torque(run.q[:, :count], run.dq[:, :count], run.ddq[:, :count]))
    torque = torque[:, :moving]
    speed = np.abs(run.dq[:, :moving])
    shares = {
        "torque": float((torque / bench.arm.effort_limit[:moving]).max()),
        "speed": float((speed / bench.arm.velocity_limit[:moving]).max()),
    }
    if acceleration is not None:
        shares["acceleration"] = float((np.abs(run.ddq[:, :moving]) / acceleration).max())
    broken = []
    for limit, share in shares.items():
        if share > 1.0 + ROUNDING:
            broken.append(f"{limit} {share:.3%}")
    missed = np.abs(run.q[-1, :moving] - np.radians(whole["task"]["goal_deg"])).max()
    if missed > THERE:
        broken.append(f"goal missed by {missed:.2e} rad")
    spent = float(run.times[-1] - run.times[0])
    wanted = whole["task"]["duration_s"]
    if result.objective == "energy" and abs(spent - wanted) > 2.0 * controller.tick_s + controller.stamp_s:
        broken.append(f"takes {spent:.4f} s for {wanted:.4f} s")
    record = result.to_dict()
    left_out = {frozenset(pair["links"]) for pair in record["unchecked_pairs"]}
    named = {**dict.fromkeys(record["joints"], float("nan")), **record["held"]}
    kept = {frozenset(cut["links"]): cut["kept_m"] for cut in record["clearance_cuts"]}
    some = run.q[:: max(1, len(run.q) // COARSE), :moving]
    clearance = whole["task"]["clearance_m"] - 2.0 * SHORT
    broken += [str(pair) for pair in world.near(named, some, left_out, clearance, kept)]
    return broken, max(shares.values())


def summarise(name: str, rows: list[Row]) -> None:
    """A controller's line, and what is broken."""
    asked = [row for row in rows if row.status != "refused"]
    plans = [row for row in asked if row.status == "solved"]
    broken = [row for row in asked if row.broken]
    for row in broken:
        print(f"  task {row.task}, {row.robot}, {row.objective}: {'; '.join(row.broken)}")
    for row in asked:
        if row.reason:
            print(f"  task {row.task}, {row.robot}, {row.objective}: no plan: {row.reason}")
    dearer = [row.dearer for row in plans if row.dearer is not None]
    costs = f"; dearer by {np.median(dearer):.2%} (median)" if dearer else ""
    largest = max((row.largest for row in plans), default=0.0)
    seconds = np.median([row.seconds for row in asked]) if asked else 0.0
    print(
        f"{name}: {len(asked)} tasks, {len(plans)} plans, {len(broken)} broken; largest share "
        f"{largest:.4%}{costs}; {seconds:.2f} s of planning (median)",
        flush=True,
    )


def read_rows(path: Path) -> list[Row]:
    """The rows of a file."""
    return [Row(**json.loads(line)) for line in path.read_text().splitlines()]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=100)
    parser.add_argument("--controllers", default=",".join(ARMS))
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--rows", type=Path, default=None)
    options = parser.parse_args()
    known = {controller.name: controller for controller in load_controllers()}
    asked = Asked(options.seconds, options.known, options.alone)
    names = options.controllers.split(",")
    benches: dict[str, Bench] = {}
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for k in range(options.first, options.first + options.tasks):
            for name in names:
                robot = ARMS[name][(k // 2) % len(ARMS[name])]
                if robot not in benches:
                    fitted = prepared(robot, folder, None)
                    arm = HybridModel.load(fitted).robot
                    benches[robot] = Bench(fitted, arm, Scene.build(arm), Model(fitted))
                rows.append(one_task(k, known[name], robot, benches[robot], asked, folder))
                if options.rows is not None:
                    with options.rows.open("a") as stream:
                        stream.write(json.dumps(asdict(rows[-1])) + "\n")
    if options.rows is not None:
        rows = read_rows(options.rows)
    for name in dict.fromkeys(row.controller for row in rows):
        summarise(name, [row for row in rows if row.controller == name])


if __name__ == "__main__":
    main()
