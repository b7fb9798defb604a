"""Mixed tasks in a number of seconds, every plan looked at by a checker that shares no code with `plan`.

    python tests/bench/bench_plan_mixed.py [TASKS] [--seconds S] [--first SEED] [--rows FILE]

Arms, folded wrists, tools and boxes as in bench_plan_checked.py; by turns with nothing more, a point
that is to be passed (in angles or in space), a cone about the tool's axis that is hardly wider than
start and goal need it, three goals of which any will do, a bent mesh, or a cloud. Each is given S
processor seconds (3), energy and time by turns. Told is what became of them, what the checker finds
broken, and the processor seconds of the call beside those asked for and those that the result tells.
A search that is done sooner spends less, and that is told by itself. FILE gets a line for each task,
and the summary speaks of all its lines.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.arrays import Array
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from plan.api.planning import solve
from plan.geometry.scene import Scene
from tests.bench.bench_plan_checked import ROBOTS, TIPS, Bench, draw, find_faults, prepared
from tests.plan.checker import Model

KINDS = ("plain", "pass", "cone", "goals", "mesh", "cloud")
# How much wider than its ends need it a cone is, and the widest one that counts [deg].
WIDER_DEG, WIDEST_DEG = 2.0, 150.0
# How far a point to be passed lies off the line, and other goals off the first [rad].
OFF, ELSEWHERE = 0.3, 0.4
# Size of a mesh and of a cloud, and radius of its points [m].
SIZE, BALL = 0.08, 0.01
POINTS = 300
# Spent beyond this multiple of the seconds asked for counts as late.
LATE = 1.1
# A bracket of two legs: its outline, and its triangles by their corners' numbers.
OUTLINE = ((0, 0), (1, 0), (1, 0.3), (0.3, 0.3), (0.3, 1), (0, 1))


@dataclass(frozen=True)
class Row:
    """What became of a task; seconds of the process, and those that the result tells."""

    task: int
    robot: str
    kind: str
    objective: str
    status: str
    broken: tuple[str, ...] = ()
    spent: float = 0.0
    told: float = 0.0
    reason: str = ""


def bracket() -> str:
    """A bent prism as an OBJ file."""
    lines = []
    count = len(OUTLINE)
    for height in (0.0, 0.6):
        for x, y in OUTLINE:
            lines.append(f"v {SIZE * x} {SIZE * y} {SIZE * height}")
    for k in range(count):
        after = (k + 1) % count
        lines.append(f"f {k + 1} {after + 1} {after + 1 + count}")
        lines.append(f"f {k + 1} {after + 1 + count} {k + 1 + count}")
    # The corner inside the bend sees all others.
    for k in range(count - 2):
        b, c = (4 + k) % count, (5 + k) % count
        lines.append(f"f 4 {c + 1} {b + 1}")
        lines.append(f"f {4 + count} {b + 1 + count} {c + 1 + count}")
    return "\n".join(lines) + "\n"


def away_from(arm: Any, rows: Array, rng: np.random.Generator) -> list[float]:
    """A place at which a thing leaves the tool's ends free [m]."""
    for _ in range(50):
        angle = rng.uniform(-np.pi, np.pi)
        reach = rng.uniform(0.35, 0.9)
        place = np.array([reach * np.cos(angle), reach * np.sin(angle), rng.uniform(0.1, 0.9)])
        tips = [pose[:3, 3] for q in rows for pose in arm.forward_kinematics(q).values()]
        if min(np.linalg.norm(tip - place) for tip in tips) > 0.3:
            break
    return place.tolist()


def whole_position(scene: dict[str, Any], angles: list[float]) -> Array:
    """Angles of all joints [rad]."""
    return np.radians([*angles, *scene["task"].get("wrist_deg", [])])


def add(kind: str, scene: dict[str, Any], bench: Bench, rng: np.random.Generator, folder: Path) -> None:
    """Adds to a drawn scene what its kind asks for."""
    arm, task = bench.arm, scene["task"]
    start = whole_position(scene, task["start_deg"])
    goal = whole_position(scene, task["goal_deg"])
    moving = len(task["start_deg"])
    tip = TIPS[scene["robot"]]
    if kind == "pass":
        there = 0.5 * (start + goal)
        there[:moving] += rng.uniform(-OFF, OFF, moving)
        there = np.clip(there, arm.lower, arm.upper)
        scene["pass"] = [{"deg": np.degrees(there[:moving]).tolist()}]
        if rng.integers(2):
            place = arm.forward_kinematics(there)[tip][:3, 3]
            scene["pass"] = [{"xyz_m": place.tolist()}]
    elif kind == "cone":
        axes = [arm.forward_kinematics(q)[tip][:3, 2] for q in (start, goal)]
        middle = axes[0] + axes[1]
        half = np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1.0, 1.0))) / 2.0
        if half + WIDER_DEG < WIDEST_DEG and np.linalg.norm(middle) > 1e-3:
            cone = {"towards": middle.tolist(), "allowed_deg": float(half + WIDER_DEG)}
            scene["tool"] = {"frame": tip, "cone": [cone]}
    elif kind == "goals":
        first = np.array(task.pop("goal_deg"))
        others = first + np.degrees(rng.uniform(-ELSEWHERE, ELSEWHERE, (2, moving)))
        low, high = np.degrees(arm.lower[:moving]), np.degrees(arm.upper[:moving])
        task["goals_deg"] = [first.tolist(), *np.clip(others, low, high).tolist()]
    elif kind == "mesh":
        (folder / "bracket.obj").write_text(bracket())
        place = away_from(arm, np.array([start, goal]), rng)
        turn = rng.uniform(-np.pi, np.pi, 3).tolist()
        thing = {"name": "bracket", "shape": "mesh", "file": "bracket.obj"}
        scene["obstacle"].append({**thing, "xyz_m": place, "rpy_rad": turn})
    elif kind == "cloud":
        points = rng.standard_normal((POINTS, 3))
        points *= SIZE / np.linalg.norm(points, axis=1, keepdims=True)
        place = away_from(arm, np.array([start, goal]), rng)
        np.save(folder / "scan.npy", points + np.array(place))
        scene["obstacle"].append({"name": "scan", "cloud": "scan.npy", "radius_m": BALL})


def one_task(number: int, robot: str, kind: str, bench: Bench, seconds: float, folder: Path) -> Row:
    """Draws a task of a kind, plans it, and has the plan looked at."""
    rng = np.random.default_rng([2033, number])
    objective = ("energy", "time")[number % 2]
    boxes = int(rng.choice((0, 1, 12)))
    scene = {"robot": robot.split("/")[0], **draw(bench.arm, bench.free, rng, ROBOTS[robot], boxes)}
    add(kind, scene, bench, rng, folder)
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    row = Row(number, robot, kind, objective, "refused")
    asked = {"objective": objective, "seconds": seconds, "gap": False, "seed": number, "beyond": True}
    began = time.process_time()
    try:
        result = solve(path, bench.model, **asked)
    except InputError as error:  # the task is at fault: an end inside a box
        return replace(row, reason=str(error))
    except Exception as error:  # ours is
        return replace(row, status="crashed", broken=(repr(error),))
    spent = time.process_time() - began
    row = replace(row, status=result.status, spent=spent, told=result.cpu_seconds)
    row = replace(row, reason=result.reason)
    if not result.solved:
        return row
    return replace(row, broken=tuple(find_faults(result, path, bench, objective)))


def summarise(name: str, rows: list[Row], seconds: float) -> None:
    """What became of some tasks, and their seconds."""
    tried = [row for row in rows if row.status not in ("refused", "crashed")]
    states = dict(Counter(row.status for row in rows))
    broken = sum(bool(row.broken) for row in rows)
    line = f"{name}: {len(rows)} tasks {states}, broken {broken}"
    if tried:
        spent = np.array([row.spent for row in tried])
        told = np.array([row.told for row in tried]) / spent
        late = int((spent > LATE * seconds).sum())
        line += f"; spent {np.median(spent):.2f} s (median), {spent.max():.2f} s (most) of {seconds:g} s"
        line += f", {late} of {len(tried)} more than {LATE - 1.0:.0%} late"
        line += f"; told {np.median(told):.1%} of what was spent, {told.min():.1%} least"
    print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", type=Path, default=None)
    options = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        benches = {}
        for robot in ROBOTS:
            model = prepared(robot, folder, None)
            arm = HybridModel.load(model).robot
            benches[robot] = Bench(model, arm, Scene.build(arm), Model(model))
        names = list(ROBOTS)
        for k in range(options.first, options.first + options.tasks):
            robot = names[k // len(KINDS) % len(names)]
            row = one_task(k, robot, KINDS[k % len(KINDS)], benches[robot], options.seconds, folder)
            rows.append(row)
            if row.broken:
                print(row, flush=True)
            if options.rows is not None:
                with options.rows.open("a") as stream:
                    stream.write(json.dumps(asdict(row)) + "\n")
    if options.rows is not None:
        rows = [Row(**json.loads(line)) for line in options.rows.read_text().splitlines()]
    summarise("all", rows, options.seconds)
    for kind in KINDS:
        summarise(kind, [row for row in rows if row.kind == kind], options.seconds)


if __name__ == "__main__":
    main()
