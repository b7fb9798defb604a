"""Recordings of a session and its answer."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.bench.other_simulator.drawn import (
    DRAWN,
    OUTSIDE,
    SIZES,
    Arm,
    Effect,
    World,
    draw_arm,
    draw_effect,
    draw_world,
)
from tests.bench.other_simulator.links import link_numbers
from tests.bench.other_simulator.motions import draw_reference
from tests.bench.other_simulator.simulator import STEP, Simulator

# Effects that are no torque of their own: they show in what the motors need.
BY_DIFFERENCE = (
    "payload",
    "gravity_misalignment",
    "link_inertial_error",
    "joint_elasticity",
    "backlash",
    "encoder_offset",
)
# Least and largest amounts that an arm has, as factors of the drawn ones: a pilot may ask for more.
FACTORS = (0.05, 6.0)
LONGEST_DELAY = 0.025  # [s]


def strip(urdf: Path) -> str:
    """The URDF without shapes, which neither MuJoCo nor a diagnosis needs, and without friction of its own.

    MuJoCo would add it, in a law that bends with speed, to the bristles'.
    """
    root = ET.parse(urdf).getroot()
    for link in root.findall("link"):
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
    for joint in root.findall("joint"):
        for part in joint.findall("dynamics"):
            joint.remove(part)
    for part in (*root.findall("transmission"), *root.findall("gazebo")):
        root.remove(part)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", fusestatic="false", balanceinertia="true")
    return ET.tostring(root, encoding="unicode")


def moving_joints(text: str) -> list[ET.Element]:
    """Revolute and continuous joints that bear load, the gripper's left out."""
    joints = [j for j in ET.fromstring(text).findall("joint") if j.get("type") in ("revolute", "continuous")]
    return [j for j in joints if "finger" not in str(j.get("name"))]


def lock_rest(text: str, keep: list[str]) -> str:
    """Other joints are fixed: fingers and the like."""
    root = ET.fromstring(text)
    for joint in root.findall("joint"):
        if joint.get("type") in ("revolute", "continuous", "prismatic") and joint.get("name") not in keep:
            joint.set("type", "fixed")
            for part in ("axis", "limit", "mimic", "dynamics"):
                for one in joint.findall(part):
                    joint.remove(one)
    return ET.tostring(root, encoding="unicode")


def record(
    log: dict[str, np.ndarray], sim: Simulator, names: list[str], rng: np.random.Generator
) -> list[pd.DataFrame]:
    """What the controller logs of each run."""
    world = sim.world
    keep = np.arange(0, log["q"].shape[1], max(round(1.0 / (world.rate * STEP)), 1))
    late = sum(e.size for e in sim.effects if e.name == "torque_delay")
    frames = []
    for r in range(world.runs):
        length = int(len(keep) * rng.uniform(0.8, 1.0))
        rows = keep[:length]
        t = rows * STEP
        q = log["q"][r, rows] + world.encoder_noise * rng.standard_normal((length, sim.n))
        grain = 2 * np.pi / 2**world.bits
        q = np.round(q / grain) * grain
        tau = log["tau"][r, rows].copy()
        for j in range(sim.n) if late else ():
            everywhere = np.arange(log["q"].shape[1]) * STEP
            tau[:, j] = np.interp(t - late, everywhere, log["tau"][r, :, j])
        grow = 1.0 + 0.3 * np.abs(tau) / sim.arm.rated
        white, red = rng.standard_normal((2, length, sim.n))
        pole = np.exp(-2 * np.pi * world.coloured / world.rate)
        for i in range(1, length):
            red[i] = pole * red[i - 1] + np.sqrt(1 - pole**2) * red[i]
        tau = tau + world.torque_noise * grow * (0.85 * white + 0.5 * red)
        columns: dict[str, np.ndarray] = {"time": t + r * (world.seconds + 20.0)}
        for j, name in enumerate(names):
            columns[f"{name}/position"] = q[:, j]
        for j, name in enumerate(names):
            if world.velocity == "differenced":
                columns[f"{name}/velocity"] = np.gradient(q[:, j], t)
            elif world.velocity == "true":
                columns[f"{name}/velocity"] = log["v"][r, rows, j] + 1e-3 * rng.standard_normal(length)
        for j, name in enumerate(names):
            columns[f"{name}/effort"] = tau[:, j]
        frames.append(pd.DataFrame(columns))
    return frames


def visible(log: dict[str, np.ndarray], healthy: dict[str, np.ndarray] | None, sim: Simulator) -> np.ndarray:
    """What an effect's torque leaves at each joint beside sign, speed, acceleration and a constant [x noise]."""
    extra = log["extra"].copy()
    if healthy is not None:
        extra += log["tau"] - healthy["tau"]
    every = slice(None, None, 8)
    out = np.zeros(sim.n)
    for j in range(sim.n):
        v = log["v"][:, :, j]
        a = np.gradient(v, STEP, axis=1)
        x = np.stack([np.sign(v) * (np.abs(v) > 0.003), v, a, np.ones_like(v)], axis=-1)[:, every].reshape(-1, 4)
        y = extra[:, every, j].ravel()
        if any(e.name == "torque_offset" for e in sim.effects):
            x = x[:, :3]
        out[j] = np.std(y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) / sim.world.torque_noise[j]
    return out


def make_session(text: str, names: list[str], kind: str, seed: int, out: Path) -> dict[str, Any]:
    """One session and its answer."""
    rng = np.random.default_rng(seed)
    root = ET.fromstring(text)
    limits = {str(j.get("name")): j.find("limit") for j in root.findall("joint")}
    rated = np.array([float(limits[n].get("effort")) for n in names])
    reach = [(float(limits[n].get("lower") or -3.1), float(limits[n].get("upper") or 3.1)) for n in names]
    low = np.array([max(a, 0.5 * (a + b) - 2.2) + 0.1 for a, b in reach])
    high = np.array([min(b, 0.5 * (a + b) + 2.2) - 0.1 for a, b in reach])
    low, high = np.minimum(low, high), np.maximum(low, high)
    top = np.array([min(float(limits[n].get("velocity") or 2.0), 3.0) for n in names]) * 0.5
    world = draw_world(rated, rng)
    arm = draw_arm(text, rated, rng)
    drawn = [draw_effect(name, arm, low, high, rng) for name in hidden_names(kind, rng)]
    sizes = {"outside": [2.0], "pair": [1.0, 3.0]}.get(kind_of(kind), list(SIZES))
    chance = [0.2, 0.4, 0.4] if len(sizes) == len(SIZES) else None
    wanted = [float(rng.choice(sizes, p=chance)) for _ in drawn]
    child = int(rng.integers(2**32))
    reference = draw_reference(world, low, high, top, rng)
    effects: tuple[Effect, ...] = ()
    seen = []
    for effect, size in zip(drawn, wanted, strict=True):
        if effect.name == "torque_saturation":
            plain = Simulator(text, world, arm, (), np.random.default_rng(child))
            log = plain.run(reference[:2], np.random.default_rng(child))
            knee = 0.6 * float(np.abs(log["tau"][:, :, effect.joint]).max())
            effect = replace(effect, figures={"knee": knee})
        grown, shown = scaled(text, world, arm, effect, reference, child, size)
        effects, seen = (*effects, grown), [*seen, shown]
    sim = Simulator(text, world, arm, effects, np.random.default_rng(child))
    log = sim.run(reference, np.random.default_rng(child))
    out.mkdir(parents=True, exist_ok=True)
    for r, frame in enumerate(record(log, sim, names, np.random.default_rng(child + 1))):
        frame.to_parquet(out / f"run_{r:02d}.parquet")
    return {
        "kind": kind_of(kind),
        "effects": [
            {
                "effect": e.name,
                "joint": names[e.joint] if e.joint >= 0 else None,
                "size": e.size,
                "params": e.figures,
                "visible": round(float(shown.max()), 2),
                "shows_at": names[int(shown.argmax())],
            }
            for e, shown in zip(effects, seen, strict=True)
        ],
        "true_loss": {
            "motor_inertia_kgm2": arm.rotor.tolist(),
            "viscous_Nms_rad": arm.viscous.tolist(),
            "coulomb_Nm": arm.coulomb.tolist(),
        },
        "true_links": link_numbers(sim.model),
        "world": {k: v for k, v in vars(world).items() if k != "torque_noise"},
        "torque_noise_Nm": world.torque_noise.tolist(),
        "rms_speed": np.sqrt((log["v"] ** 2).mean((0, 1))).round(3).tolist(),
        "largest_error_rad": float(np.abs(log["q"] - reference).max()),
    }


def kind_of(kind: str) -> str:
    """What a session shows: nothing, one effect, two of them, or a law of none."""
    return {"healthy": "null", "pair": "pair"}.get(kind, "outside" if kind in OUTSIDE else "single")


def hidden_names(kind: str, rng: np.random.Generator) -> list[str]:
    """The effects of a session; a pair's are two different ones."""
    if kind == "healthy":
        return []
    return [str(name) for name in rng.choice(DRAWN, 2, replace=False)] if kind == "pair" else [kind]


def scaled(
    text: str, world: World, arm: Arm, effect: Effect, reference: np.ndarray, child: int, wanted: float
) -> tuple[Effect, np.ndarray]:
    """The effect at the amount whose pilot leaves `wanted` times the noise, if arms have it; and what it leaves."""
    some = reference[: min(4, len(reference))]
    ran = []
    for chosen in ((), (effect,)):
        sim = Simulator(text, world, arm, chosen, np.random.default_rng(child))
        ran.append((sim, sim.run(some, np.random.default_rng(child))))
    if effect.name == "torque_delay":
        rate = np.gradient(ran[1][1]["tau"], STEP, axis=1)
        ran[1][1]["extra"] = -effect.size * rate
    found = visible(ran[1][1], ran[0][1] if effect.name in BY_DIFFERENCE else None, ran[1][0])
    least, most = FACTORS[0], FACTORS[1] if effect.name != "torque_delay" else LONGEST_DELAY / effect.size
    factor = float(np.clip(wanted / max(found.max(), 1e-9), least, most))
    return replace(effect, size=effect.size * factor), found * factor
