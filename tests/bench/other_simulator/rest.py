"""Sessions of at most 25 dwells: poses that are held, slow moves between them, and what gravity and holds tell.

    python -m tests.bench.other_simulator.rest OUT --cases 40 --seed 1 [--arms tm5-900,ur5,panda]
    python -m ident.benchmark.real_check diagnose OUT
    python -m ident.benchmark.real_check score OUT

A dwell's torque is known to within the joint's static friction f: evenly so, with variance f² / 3. `asked` is the
distance of an effect in such units over all dwells and joints, each joint's mean taken away: an oracle has half its
square in nats. What no arm has by so much (the zero of a vertical axis) is drawn anew, another effect after some draws.
Every seventh session has nothing in it.
"""

import argparse
import itertools
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ident.robot.names import find_urdf
from tests.bench.other_simulator.drawn import WHOLE_ARM, Effect, draw_arm, draw_effect, draw_world
from tests.bench.other_simulator.sessions import FACTORS, lock_rest, moving_joints, record, strip
from tests.bench.other_simulator.simulator import STEP, Simulator

DRAWN = ("payload", "gravity_misalignment", "encoder_offset", "spring_torque", "torque_offset", "external_contact")
FIGURES = {"payload": "mass_kg", "spring_torque": "stiffness_Nm_rad", "torque_offset": "offset_Nm"}
DISTANCES = (6.0, 12.0)
LARGEST_ZERO, DRAWS = 0.3, 20  # [rad]; draws of one effect
RUNS, POSES, DWELL, MOVE = 4, 5, 1.2, 2.2  # poses a run, seconds of each


def poses_and_reference(low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Poses `[R P n]` and the references that hold them `[R T n]`."""
    middle, reach = 0.5 * (low + high), 0.35 * (high - low)
    poses = middle + reach * rng.uniform(-1.0, 1.0, (RUNS, POSES, len(low)))
    t = np.arange(int(POSES * (DWELL + MOVE) / STEP)) * STEP
    reference = np.repeat(poses[:, :1], len(t), axis=1)
    for k in range(1, POSES):
        s = np.clip((t - k * (DWELL + MOVE) + MOVE) / MOVE, 0.0, 1.0)
        ease = s**3 * (10 - 15 * s + 6 * s**2)
        reference = reference + ease[None, :, None] * (poses[:, k] - poses[:, k - 1])[:, None]
    return poses, reference


def held_torque(sim: Simulator, poses: np.ndarray) -> np.ndarray:
    """What holding the poses takes and the log tells, as far as the arm's bodies and effects say `[R P n]`."""
    data, out = mujoco.MjData(sim.model), np.zeros_like(poses)
    for r, p in np.ndindex(poses.shape[:2]):
        data.qpos[:] = poses[r, p]
        for e in sim.effects:
            if e.name == "encoder_offset":
                data.qpos[e.joint] -= e.size
        mujoco.mj_forward(sim.model, data)
        out[r, p] = data.qfrc_bias
        for e in sim.effects:
            if e.name == "spring_torque":
                out[r, p, e.joint] += e.size * (poses[r, p, e.joint] - e.figures["rest"])
            elif e.name == "torque_offset":
                out[r, p, e.joint] += e.size
            elif e.name == "external_contact" and r % 3 == int(e.figures["which"]) and p == int(e.figures["pose"]):
                jac, body = np.zeros((3, sim.n)), int(sim.model.jnt_bodyid[e.joint])
                mujoco.mj_jac(sim.model, data, jac, None, data.xpos[body], body)
                # The push swells and fades: its mean over the dwell is half of its height while it lasts.
                mean = 0.5 * e.size * e.figures["long"] / DWELL
                out[r, p] -= mean * (jac.T @ np.array([e.figures[axis] for axis in "xyz"]))
    return out


def make_rest(text: str, names: list[str], name: str, seed: int, out: Path) -> dict[str, Any]:
    """One session; its answer."""
    rng = np.random.default_rng(seed)
    limits = [joint.find("limit") for joint in moving_joints(text) if joint.get("name") in names]
    rated, low, high = (
        np.array([float(one.get(key) or other) for one in limits if one is not None])
        for key, other in (("effort", 50.0), ("lower", -3.1), ("upper", 3.1))
    )
    low, high = np.maximum(low, 0.5 * (low + high) - 2.0), np.minimum(high, 0.5 * (low + high) + 2.0)
    world = replace(draw_world(rated, rng), runs=RUNS, seconds=POSES * (DWELL + MOVE))
    arm = draw_arm(text, rated, rng)
    poses, reference = poses_and_reference(low, high, rng)
    child, wanted = int(rng.integers(2**32)), float(rng.choice(DISTANCES))
    effects: tuple[Effect, ...] = ()
    shown = np.zeros(len(names))
    kinds = [name, *(one for one in DRAWN if one != name)]
    for draw in itertools.count() if name else ():
        name = kinds[draw // DRAWS]
        effect = draw_effect(name, arm, low, high, rng)
        if name == "external_contact":  # on the standing arm, during one dwell
            pose = int(rng.integers(1, POSES))
            start = pose * (DWELL + MOVE) + 0.1
            effect = replace(effect, figures={**effect.figures, "pose": pose, "from": start, "long": DWELL - 0.2})
        largest = LARGEST_ZERO if name == "encoder_offset" else FACTORS[1] * effect.size
        for _ in range(2):  # nearly linear in its size
            plain, changed = (
                held_torque(Simulator(text, world, arm, some, np.random.default_rng(child)), poses)
                for some in ((), (effect,))
            )
            felt = (changed - plain).reshape(-1, len(names))
            felt = felt if name in ("torque_offset", "external_contact") else felt - felt.mean(axis=0)
            shown = np.sqrt(np.sum((felt / arm.coulomb) ** 2 * 3.0, axis=0))
            effect = replace(effect, size=effect.size * wanted / max(float(np.sqrt(np.sum(shown**2))), 1e-9))
        if effect.size <= largest:
            effects = (effect,)
            break
    sim = Simulator(text, world, arm, effects, np.random.default_rng(child))
    frames = record(sim.run(reference, np.random.default_rng(child)), sim, names, np.random.default_rng(child + 1))
    out.mkdir(parents=True, exist_ok=True)
    for r, frame in enumerate(frames):
        frame.to_parquet(out / f"run_{r:02d}.parquet")
    return {
        "kind": "single" if name else "untouched",
        "control": "",
        "effects": [seen(one, names, shown, wanted) for one in effects],
        "static_friction_Nm": dict(zip(names, arm.coulomb.tolist(), strict=True)),
    }


def seen(effect: Effect, names: list[str], shown: np.ndarray, wanted: float) -> dict[str, Any]:
    """An effect as semi-real answers tell it."""
    at = [name for name, one in zip(names, shown, strict=True) if one >= shown.max() / 3.0]
    felt = [name for name, one in zip(names, shown, strict=True) if one > 1.0]
    whole, own = effect.name in WHOLE_ARM, [names[effect.joint]]
    parameters = {FIGURES[effect.name]: effect.size} if effect.name in FIGURES else {}
    if effect.name == "encoder_offset":
        parameters = {"offset_rad": -effect.size}
    return {
        "effect": effect.name,
        "in_catalogue": True,
        "asked": wanted,
        "joints": at if whole else own,
        "may_stand_at": {"external_contact": felt, "payload": [*at, names[-1]]}.get(effect.name, at if whole else own),
        "parameters": parameters,
        "visible": dict(zip(names, shown.round(2).tolist(), strict=True)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--arms", default="tm5-900,ur5,panda")
    given = parser.parse_args()
    arms = given.arms.split(",")
    (given.out / "answers").mkdir(parents=True, exist_ok=True)
    for i in range(given.cases):
        arm, name = arms[i % len(arms)], ("", *DRAWN)[(i // len(arms)) % (len(DRAWN) + 1)]
        text = strip(Path(find_urdf(arm)))
        names = [str(joint.get("name")) for joint in moving_joints(text)]
        text = lock_rest(text, names)
        case = given.out / "cases" / f"case_{i:03d}"
        answer = make_rest(text, names, name, int(np.random.default_rng([given.seed, i]).integers(2**62)), case)
        (case / "robot.urdf").write_text(_plain(text), encoding="utf-8")
        answer |= {"arm": arm}
        (given.out / "answers" / f"{case.name}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
        print(case.name, arm, name or "nothing", [one["joints"] for one in answer["effects"]], flush=True)


def _plain(text: str) -> str:
    """The URDF without what only MuJoCo reads."""
    root = ET.fromstring(text)
    for part in root.findall("mujoco"):
        root.remove(part)
    return ET.tostring(root, encoding="unicode")


if __name__ == "__main__":
    main()
