"""Plans tasks by RoboPlan: RRT-Connect, shortcuts, TOPP-RA; to be run where RoboPlan is installed.

    python tests/bench/peers/run_roboplan.py TASKS.json SECONDS OUT.json

TASKS.json is what bench_plan_first.py writes. Each task is planned from seed after seed, with the
corners of the path kept (Hermite) and rounded (adaptive), until SECONDS of processor time are spent;
OUT.json gets the seconds of the scene and of each motion that was better than those before, its
duration and its positions.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from roboplan import core, rrt, toppra

GROUP = "arm"
# Steps of a path's checks [rad], and of a motion [s].
STEP_RAD, STEP_S = 0.02, 0.005
MODES = (toppra.SplineFittingMode.Hermite, toppra.SplineFittingMode.Adaptive)


def build(tasks: dict, boxes: list) -> core.Scene:  # type: ignore[type-arg]
    """The scene of one task: the arm, its limits, pairs that are left out, and boxes."""
    scene = core.Scene(GROUP, core.loadUrdfSceneDescription(tasks["urdf"], []))
    names = tasks["joints"]
    joints = "".join(f'<joint name="{name}"/>' for name in names)
    pairs = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Never"/>' for a, b in tasks["left_out"])
    scene.importSrdf(f'<robot name="{tasks["robot"]}"><group name="{GROUP}">{joints}</group>{pairs}</robot>')
    rows = [f"  {name}:\n    max_acceleration: [{tasks['acceleration']}]\n" for name in names]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "limits.yaml"
        path.write_text("joint_limits:\n" + "".join(rows))
        scene.importJointLimitsFromConfig(core.loadJointLimitsConfig(path))
    for box in boxes:
        place = np.eye(4)
        place[:3, :3] = box["turn"]
        place[:3, 3] = box["place"]
        shape = core.Box(*box["size"])
        scene.addBoxGeometry(box["name"], "universe", shape, np.asfortranarray(place), np.ones(4))
    return scene


def plan(tasks: dict, task: dict, seconds: float) -> dict:  # type: ignore[type-arg]
    """What was found for one task, and when."""
    began = time.process_time()
    scene = build(tasks, task["boxes"])
    built = time.process_time() - began
    names = tasks["joints"]
    start = core.JointConfiguration(names, np.array(task["start"]))
    goal = core.JointConfiguration(names, np.array(task["goal"]))
    options = rrt.RRTOptions(group_name=GROUP, rrt_connect=True, max_nodes=20_000, collision_check_step_size=STEP_RAD)
    timing = toppra.PathParameterizerTOPPRA(scene, GROUP)
    found: list[dict] = []  # type: ignore[type-arg]
    reason = ""
    seed = 0
    while time.process_time() - began < seconds:
        planner = rrt.RRT(scene, options)
        planner.setRngSeed(seed)
        cutting = core.PathShortcuttingOptions(group_name=GROUP, max_step_size=STEP_RAD, seed=seed)
        seed += 1
        try:
            path = core.PathShortcutter(scene, cutting).shortcut(planner.plan(start, goal))
            motions = [timing.generate(path, toppra.TOPPRAOptions(dt=STEP_S, mode=mode)) for mode in MODES]
        except RuntimeError as error:
            reason = str(error)
            if "in collision" in reason:
                break
            continue
        motion = min(motions, key=lambda each: each.times[-1])
        if not found or motion.times[-1] < found[-1]["duration"]:
            row = {"seconds": time.process_time() - began, "duration": motion.times[-1]}
            found.append({**row, "positions": np.array(motion.positions).tolist()})
    return {"scene_s": built, "found": found, "tries": seed, "reason": reason}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", type=Path)
    parser.add_argument("seconds", type=float)
    parser.add_argument("out", type=Path)
    asked = parser.parse_args()
    tasks = json.loads(asked.tasks.read_text())
    rows = [plan(tasks, task, asked.seconds) for task in tasks["tasks"]]
    asked.out.write_text(json.dumps(rows))


if __name__ == "__main__":
    main()
