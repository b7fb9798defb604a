"""Random tasks on four arms, every plan looked at by a checker that shares no code with `plan`.

    python tests/bench/bench_plan_checked.py [TASKS] [--seconds S] [--evaluations E[,E]] [--rows FILE]
                                             [--model FOLDER] [--first SEED]

TM5-900 (three joints and all six, with the given model and its net, else with losses drawn), UR5 and Panda, by turns;
none, 1, 12 or 100 boxes, a tool of up to 2 kg at the tip in every second task, 5 or 20 mm of clearance, on the TM5-900
a folded wrist in every second; energy or time, at most E evaluations a task, the numbers by turns (40). Few give
early plans, which is what a checker is to catch as well as good ones: not how low a plan ends is looked at, but whether
one that is said to keep everything does. Ends after TASKS, or S seconds of processor time. Limits, clearance, ends,
energy by Simpson's rule, dynamics, net, shapes (the URDF's meshes, by Coal) and the tool's place and weight at the
URDF's own frame are computed anew. FILE gets a line a task as it is done; the summary speaks of all its lines, so a
long run can be made in pieces. Told beside spent: processor seconds of the result, and of the call.
"""

import argparse
import json
import tempfile
import time
import tomllib
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import tomli_w

from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.api.planning import solve
from plan.geometry.scene import Scene
from plan.problem.result import PlanResult
from tests.plan.checker import Model, World, faults, rule_faults

# Arms and how many of their joints move.
ROBOTS = {"tm5-900/3": 3, "tm5-900": 6, "ur5": 6, "panda": 7}
BOXES = (0, 1, 12, 100)
# The frame of each arm's tip, for the checker, and wrists of the TM5-900 whose links are 2 mm apart [rad].
TIPS = {"tm5-900": "flange", "ur5": "tool0", "panda": "panda_hand_tcp"}
FOLDED = np.radians([[-144.0, -1.9, 140.5, -63.9], [54.6, 85.5, -91.9, 90.1], [7.5, 127.2, 80.7, 17.1]])


def prepared(robot: str, folder: Path, given: str | None) -> Path:
    """A model of the arm: the given one, or one with losses of a usual size for each joint's rating."""
    name = robot.split("/")[0]
    if given is not None and name == "tm5-900":
        return Path(given)
    arm = ArmModel.load(name)
    arm = arm.locked(arm.joint_names[7:], [0.0] * (arm.n - 7)) if arm.n > 7 else arm
    rated = arm.effort_limit
    loss = LossParameters(0.004 * rated, 0.04 * rated, 0.05 * rated, 0.01 * rated, np.full(arm.n, 0.01))
    heavier = arm.with_inertial_parameters(1.05 * arm.inertial_parameters)
    return HybridModel(arm, arm, heavier, loss, inertia="base").save(folder / name)


def draw(arm: ArmModel, free: Scene, rng: np.random.Generator, moving: int = 0, boxes: int = 3) -> dict:  # type: ignore[type-arg]
    """A scene: ends that are free of the arm itself, boxes that leave them free; the first joints move, or all."""
    moving = moving or arm.n
    folded = arm.name.startswith("tm5") and rng.integers(2)
    low, high = 0.8 * np.maximum(arm.lower, -2.5), 0.8 * np.minimum(arm.upper, 2.5)
    while True:
        ends = rng.uniform(low, high, (2, arm.n))
        ends[1] = np.clip(ends[1], ends[0] - 1.5, ends[0] + 1.5)
        if folded:
            ends[:, 2:] = FOLDED[rng.integers(len(FOLDED))]
        ends[1, moving:] = ends[0, moving:]
        if free.separation(ends).min() > 0.001:  # links of a Panda's hand are never farther apart than some millimetres
            break
    tips = [arm.forward_kinematics(q) for q in ends]
    objects = []
    for k in range(boxes):
        for _ in range(50):
            angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.9 if boxes < 50 else 1.2)
            xyz = np.array([away * np.cos(angle), away * np.sin(angle), rng.uniform(0.1, 1.0)])
            if min(np.linalg.norm(pose[:3, 3] - xyz) for tip in tips for pose in tip.values()) > 0.35:
                break
        size, rpy = (
            rng.uniform(0.06, 0.2, 3) / (1.0 if boxes < 12 else 2.0 if boxes < 50 else 3.0),
            rng.uniform(-np.pi, np.pi, 3),
        )
        objects.append({"name": f"box {k}", "size_m": size.tolist(), "xyz_m": xyz.tolist(), "rpy_rad": rpy.tolist()})
    need = float(np.max(np.abs(ends[1] - ends[0]) / np.minimum(arm.velocity_limit, np.pi)))
    start, goal = np.degrees(ends).tolist()
    task = {"start_deg": start[:moving], "goal_deg": goal[:moving], "wrist_deg": start[moving:]}
    task = {key: value for key, value in task.items() if value}
    task = {**task, "duration_s": need * rng.uniform(2.0, 4.0), "clearance_m": float(rng.choice([0.005, 0.02]))}
    tool = {"name": "tool", "size_m": [0.03, 0.03, 0.12], "xyz_m": [0.0, 0.0, 0.07]}
    weight = {"mass_kg": float(rng.uniform(0.2, 2.0)), "com_m": [0.0, 0.01, 0.05]}
    carried = {"attached": [tool], "payload": weight} if rng.integers(2) == 0 else {}
    return {"task": task, "obstacle": objects, **carried}


@dataclass(frozen=True)
class Bench:
    """One arm: its model's folder, the arm, the arm alone as the planner sees it, and the checker's own model."""

    model: Path
    arm: ArmModel
    free: Scene
    checked: Model


@dataclass(frozen=True)
class Row:
    """What became of a task: its status, what the checker found broken, seconds of planning (as claim, and to
    the first plan, too) and checking; what was asked: joints that move, boxes, whether a tool hangs there, a fold."""

    task: int
    robot: str
    objective: str
    evaluations: int
    status: str
    broken: tuple[str, ...] = ()
    planned: float = 0.0
    checked: float = 0.0
    claim: float = 0.0
    first: float = float("nan")
    boxes: int = 0
    tool: bool = False
    cuts: int = 0
    reason: str = ""


def one_task(number: int, robot: str, bench: Bench, evaluations: int, folder: Path) -> Row:
    """Draws a task, plans it, and has the plan looked at."""
    rng, moving, name = np.random.default_rng([2027, number]), ROBOTS[robot], robot.split("/")[0]
    drawn = draw(bench.arm, bench.free, rng, moving, int(rng.choice(BOXES)))
    scene, objective = {"robot": name, **drawn}, ("energy", "time")[int(rng.integers(2))]
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    row, began = Row(number, robot, objective, evaluations, "refused"), time.process_time()
    row = replace(row, boxes=len(scene["obstacle"]), tool="attached" in scene)
    try:
        result = solve(
            path, bench.model, objective=objective, evaluations=evaluations, gap=False, seed=number, beyond=True
        )
    except InputError:  # the task is at fault: an end inside a box
        return row
    except Exception as error:  # ours is
        return replace(row, status="crashed", broken=(repr(error),))
    first = next((seconds for _, seconds, cost in result.history if np.isfinite(cost)), float("nan"))
    row = replace(row, status=result.status, planned=time.process_time() - began, claim=result.cpu_seconds, first=first)
    row = replace(row, reason=result.reason)
    if not result.solved:
        return row
    assert result.certificate is not None
    found = find_faults(result, path, bench, objective)
    spent, cuts = time.process_time() - began - row.planned, len(result.certificate.cuts)
    return replace(row, broken=tuple(found), checked=spent, cuts=cuts)


def find_faults(result: PlanResult, path: Path, bench: Bench, objective: str) -> list[str]:
    """What the checker finds broken by a plan of a scene file, by limits, dynamics, shapes and the scene's rules."""
    whole = tomllib.loads(path.read_text())
    whole["task"]["objective"] = objective
    name = whole["robot"]
    moving = len(result.joints)
    source = ArmModel.load(name).source
    assert source is not None
    packages = [str(Path(pin.__file__).parents[4] / "share"), str(source.parents[3])]
    own = {"lower": "lower", "upper": "upper", "speed": "velocity_limit", "torque": "effort_limit"}
    limits = {key: getattr(bench.arm, attribute)[:moving] for key, attribute in own.items()}
    limits["clearance"] = whole["task"]["clearance_m"]
    world = World(source, packages, whole, path.parent, tip=TIPS[name])
    checked = bench.checked
    if "payload" in whole:
        checked = checked.carrying(whole["payload"], world, TIPS[name])
    plan = result.to_dict()
    found = faults(plan, whole, checked, world, limits)
    if any(key in whole for key in ("tool", "pass")) or "goals_deg" in whole["task"]:
        found += rule_faults(plan, whole, world, TIPS[name])
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--evaluations", default="40")
    parser.add_argument("--rows", type=Path, default=None)
    parser.add_argument("--model", default=None)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    budgets = [int(count) for count in options.evaluations.split(",")]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder, benches = Path(name), {}
        for robot in ROBOTS:
            model = prepared(robot, folder, options.model)
            arm = HybridModel.load(model).robot
            benches[robot] = Bench(model, arm, Scene.build(arm), Model(model))
        names = list(ROBOTS)
        for k in range(options.first, options.first + options.tasks):
            if time.process_time() > options.seconds:
                break
            robot, evaluations = names[k % len(names)], budgets[k // len(names) % len(budgets)]
            rows.append(one_task(k, robot, benches[robot], evaluations, folder))
            if rows[-1].broken:
                print(rows[-1], flush=True)
            if options.rows is not None:
                with options.rows.open("a") as stream:
                    stream.write(json.dumps(asdict(rows[-1])) + "\n")
    if options.rows is not None:
        rows = [Row(**json.loads(line)) for line in options.rows.read_text().splitlines()]
    tell("all", rows)
    for key in ("robot", "boxes", "tool"):
        for value in dict.fromkeys(getattr(row, key) for row in rows):
            tell(f"{key} {value}", [row for row in rows if getattr(row, key) == value])
    print(f"{time.process_time():.0f} s of processor time in this run")


def tell(name: str, rows: list[Row]) -> None:
    """What became of some tasks, how many are broken, and their seconds."""
    planned = [row for row in rows if row.claim > 0.0]
    first = np.array([row.first for row in rows if np.isfinite(row.first)])
    share = np.array([row.claim / row.planned for row in planned]) if planned else np.ones(1)
    seconds = f"first plan {np.median(first):.2f} s median, {first.max():.2f} s worst" if len(first) else "no plan"
    broken, cut = sum(bool(row.broken) for row in rows), sum(row.cuts > 0 for row in rows)
    states = dict(Counter(row.status for row in rows))
    print(f"{name}: {len(rows)} tasks {states}, broken {broken}, with cuts {cut}; {seconds}; ", end="")
    print(f"told {np.median(share):.1%} of what was spent, {share.min():.1%} least", flush=True)


if __name__ == "__main__":
    main()
