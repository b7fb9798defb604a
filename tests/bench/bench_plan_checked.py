"""Random tasks on three arms, every plan looked at by a checker that shares no code with `plan`.

    python tests/bench/bench_plan_checked.py [TASKS] [--seconds S] [--evaluations E]
                                             [--model FOLDER] [--first SEED]

TM5-900 (all six joints, with the given model and its net, else with losses drawn), Panda and UR5, by turns; up to three
boxes, energy or time, at most E evaluations a task (400). Ends after TASKS, or S seconds of processor time. Limits,
clearance, ends, energy by Simpson's rule, dynamics, net and shapes (the URDF's meshes, by Coal) are computed anew.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin
import tomli_w

from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.api.planning import solve
from plan.geometry.scene import Scene
from tests.plan.checker import Model, World, faults

ROBOTS = ("tm5-900", "ur5", "panda")
# Tasks after which the count so far is told: a long run that is ended early has then said something.
TOLD_EVERY = 20


def prepared(robot: str, folder: Path, given: str | None) -> Path:
    """A model of the arm: the given one, or one with losses of a usual size for each joint's rating."""
    if given is not None and robot == "tm5-900":
        return Path(given)
    arm = ArmModel.load(robot)
    arm = arm.locked(arm.joint_names[7:], [0.0] * (arm.n - 7)) if arm.n > 7 else arm
    rated = arm.effort_limit
    loss = LossParameters(0.004 * rated, 0.04 * rated, 0.05 * rated, 0.01 * rated, np.full(arm.n, 0.01))
    heavier = arm.with_inertial_parameters(1.05 * arm.inertial_parameters)
    return HybridModel(arm, arm, heavier, loss, inertia="base").save(folder / robot)


def draw(arm: ArmModel, free: Scene, rng: np.random.Generator) -> dict:  # type: ignore[type-arg]
    """A scene: ends that are free of the arm itself, boxes that leave them free."""
    low, high = 0.8 * np.maximum(arm.lower, -2.5), 0.8 * np.minimum(arm.upper, 2.5)
    while True:
        ends = rng.uniform(low, high, (2, arm.n))
        ends[1] = np.clip(ends[1], ends[0] - 1.5, ends[0] + 1.5)
        if free.separation(ends).min() > 0.001:  # links of a Panda's hand are never farther apart than some millimetres
            break
    tips = [arm.forward_kinematics(q) for q in ends]
    objects = []
    for k in range(rng.integers(0, 4)):
        for _ in range(50):
            angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.9)
            xyz = np.array([away * np.cos(angle), away * np.sin(angle), rng.uniform(0.1, 1.0)])
            if min(np.linalg.norm(pose[:3, 3] - xyz) for tip in tips for pose in tip.values()) > 0.35:
                break
        size, rpy = rng.uniform(0.06, 0.2, 3), rng.uniform(-np.pi, np.pi, 3)
        objects.append({"name": f"box {k}", "size_m": size.tolist(), "xyz_m": xyz.tolist(), "rpy_rad": rpy.tolist()})
    need = float(np.max(np.abs(ends[1] - ends[0]) / np.minimum(arm.velocity_limit, np.pi)))
    task = {"start_deg": np.degrees(ends[0]).tolist(), "goal_deg": np.degrees(ends[1]).tolist()}
    return {"task": {**task, "duration_s": need * rng.uniform(2.0, 4.0)}, "obstacle": objects}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--evaluations", type=int, default=400)
    parser.add_argument("--model", default=None)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    statuses, broken, spent = Counter[str](), [], Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known = {}
        for robot in ROBOTS:
            model = prepared(robot, folder, options.model)
            arm = HybridModel.load(model).robot
            known[robot] = (model, arm, Scene.build(arm), Model(model))
        for i in range(options.first, options.first + options.tasks):
            if time.process_time() > options.seconds:
                break
            if i > options.first and (i - options.first) % TOLD_EVERY == 0:
                print(f"{i - options.first} tasks: {dict(statuses)}, broken: {len(broken)}", flush=True)
            robot = ROBOTS[i % len(ROBOTS)]
            model, arm, free, checked = known[robot]
            rng = np.random.default_rng([2027, i])
            scene, objective = {"robot": robot, **draw(arm, free, rng)}, ("energy", "time")[int(rng.integers(2))]
            path = folder / "scene.toml"
            path.write_text(tomli_w.dumps(scene))
            began = time.process_time()
            try:
                result = solve(path, model, objective=objective, evaluations=options.evaluations, gap=False, seed=i)
            except Exception as error:  # the task is at fault: an end inside a box
                statuses[f"{robot}: refused ({type(error).__name__})"] += 1
                continue
            spent[robot] += time.process_time() - began
            statuses[f"{robot}: {result.status}"] += 1
            if not result.solved:
                continue
            whole = tomllib.loads(path.read_text())
            whole["task"]["objective"] = objective
            source = ArmModel.load(robot).source
            assert source is not None
            packages = [str(Path(pin.__file__).parents[4] / "share"), str(source.parents[3])]
            limits = {"lower": arm.lower, "upper": arm.upper, "speed": arm.velocity_limit, "clearance": 0.005}
            asked = result.certificate.asked_clearance if result.certificate is not None else 0.0
            limits["clearance"] = min(0.005, asked)
            limits["torque"] = arm.effort_limit
            found = faults(result.to_dict(), whole, checked, World(source, packages, whole), limits)
            if found:
                broken.append((i, robot, objective, found))
                print(i, robot, objective, found, flush=True)
        for line, count in sorted(statuses.items()):
            print(f"{line}: {count}")
        print({robot: f"{seconds:.0f} s" for robot, seconds in spent.items()}, f"broken: {len(broken)}")


if __name__ == "__main__":
    main()
