"""MuJoCo's own armature, damping and frictionloss of arms, from logs with one slow run, and back in a written MJCF.

    python -m tests.bench.bench_mujoco_losses OUT --seeds 61,62,63 [--arms tm5-900,ur5,panda]

Plant: MuJoCo with these three attributes of every joint (`implicitfast`, 1 kHz), under a PD controller with
feed-forward that is logged at 100 Hz with noise. Four runs of 20 s, the first slow. `ident fit --net none` and
`ident export --format mjcf` as a user runs them; the attributes are read from the file. Printed: the largest relative
error of each attribute over the joints, in per cent, and how many of the fit's intervals hold the truth.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.robot.names import find_urdf
from tests.bench.other_simulator.sessions import lock_rest, moving_joints, strip

STEP_S, LOG_HZ, SECONDS = 0.001, 100.0, 20.0
# Speeds of the runs, as shares of what moves a joint through 40 % of its range ten times in a run.
PACES = (0.15, 0.5, 0.8, 1.0)
ATTRIBUTES = ("armature", "damping", "frictionloss")
# Noise of torque as a share of its largest, of encoders [rad].
TORQUE_NOISE, ENCODER_NOISE = 0.01, 2e-5
BANDWIDTH_HZ = 8.0
HARMONICS = 5


def draw_losses(rated: Float[Array, " n"], rng: np.random.Generator) -> dict[str, Float[Array, " n"]]:
    """The three attributes of every joint, as large as arms have them."""
    sizes = {"armature": 0.006, "damping": 0.04, "frictionloss": 0.04}
    return {name: size * rated * rng.uniform(0.6, 1.4, len(rated)) for name, size in sizes.items()}


def draw_reference(
    low: Float[Array, " n"], high: Float[Array, " n"], pace: float, rng: np.random.Generator
) -> Float[Array, "t n"]:
    """A Fourier sum of every joint, inside its limits."""
    time = np.arange(round(SECONDS / STEP_S)) * STEP_S
    middle = 0.5 * (low + high)
    reach = 0.4 * np.minimum(high - low, np.pi) / 2.0
    angle = np.zeros((len(time), len(low)))
    for harmonic in range(1, HARMONICS + 1):
        rate = 2.0 * np.pi * pace * 2.0 * harmonic / SECONDS
        phase = rng.uniform(0.0, 2.0 * np.pi, len(low))
        size = rng.uniform(0.3, 1.0, len(low)) / np.sqrt(harmonic)
        angle += size * np.sin(rate * time[:, None] + phase)
    return middle + reach * angle / np.abs(angle).max(axis=0)


def record(model: mujoco.MjModel, reference: Float[Array, "t n"], rng: np.random.Generator) -> Float[Array, "T k"]:
    """Time, positions and torques of one run."""
    data = mujoco.MjData(model)
    speed = np.gradient(reference, STEP_S, axis=0)
    acceleration = np.gradient(speed, STEP_S, axis=0)
    data.qpos[:] = reference[0]
    data.qvel[:] = speed[0]
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    stiffness = np.diag(inertia) * (2.0 * np.pi * BANDWIDTH_HZ) ** 2
    damper = 1.4 * np.diag(inertia) * 2.0 * np.pi * BANDWIDTH_HZ
    every = round(1.0 / (LOG_HZ * STEP_S))
    angles = []
    torques = []
    for k in range(len(reference)):
        logged_angle = data.qpos.copy()
        torque = data.qfrc_bias + model.dof_damping * speed[k] + model.dof_frictionloss * np.sign(speed[k])
        torque = torque + np.diag(inertia) * acceleration[k]
        torque = torque + stiffness * (reference[k] - data.qpos) + damper * (speed[k] - data.qvel)
        data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data)
        if k % every == 0:
            angles.append(logged_angle)
            torques.append(torque)
    q = np.array(angles) + ENCODER_NOISE * rng.standard_normal((len(angles), model.nv))
    tau = np.array(torques)
    tau += TORQUE_NOISE * np.abs(tau).max(axis=0) * rng.standard_normal(tau.shape)
    return np.column_stack([np.arange(len(q)) / LOG_HZ, q, tau])


def write_session(place: Path, arm: str, seed: int) -> dict[str, Float[Array, " n"]]:
    """URDF and runs of an arm; returns its true attributes."""
    rng = np.random.default_rng(seed)
    text = strip(Path(find_urdf(arm)))
    joints = moving_joints(text)
    names = [str(joint.get("name")) for joint in joints]
    text = lock_rest(text, names)
    limits = [joint.find("limit") for joint in joints]
    rated = np.array([float(limit.get("effort")) for limit in limits])
    low = np.array([float(limit.get("lower") or -np.pi) for limit in limits])
    high = np.array([float(limit.get("upper") or np.pi) for limit in limits])
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = STEP_S
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    true = draw_losses(rated, rng)
    for name, values in true.items():
        getattr(model, f"dof_{name}")[:] = values
    mujoco.mj_setConst(model, mujoco.MjData(model))
    (place / "session").mkdir(parents=True)
    (place / "arm.urdf").write_text(text, encoding="utf-8")
    columns = ["time", *(f"{name}/position" for name in names), *(f"{name}/effort" for name in names)]
    for number, pace in enumerate(PACES):
        table = record(model, draw_reference(low, high, pace, rng), rng)
        table[:, 0] += number * (SECONDS + 10.0)
        path = place / "session" / f"run_{number}.csv"
        np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.8g")
    return true


def run(*words: str) -> None:
    """`ident` with some words, its exit status checked."""
    command = [sys.executable, "-c", "from ident.cli.start import main; main()", *words]
    subprocess.run(command, check=True, capture_output=True)


def read_attributes(mjcf: Path) -> dict[str, Float[Array, " n"]]:
    """The attributes of all joints of a written file, as MuJoCo loads it."""
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    return {name: np.array(getattr(model, f"dof_{name}")).ravel() for name in ATTRIBUTES}


def held_in_model(folder: Path, true: dict[str, Float[Array, " n"]]) -> tuple[int, int]:
    """How many of the fit's intervals hold the truth, of how many."""
    loss = tomllib.loads((folder / "model.toml").read_text(encoding="utf-8"))["loss"]
    names = dict(zip(("motor_inertia", "viscous", "coulomb"), ATTRIBUTES, strict=True))
    held = 0
    count = 0
    joints = list(dict.fromkeys(figure["joint"] for figure in loss["figures"]))
    for figure in loss["figures"]:
        if figure["name"] not in names:
            continue
        value = true[names[figure["name"]]][joints.index(figure["joint"])]
        held += figure["low"] <= value <= figure["high"]
        count += 1
    return held, count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="61,62,63")
    parser.add_argument("--arms", default="tm5-900,ur5,panda")
    given = parser.parse_args()
    for arm in given.arms.split(","):
        for seed in map(int, given.seeds.split(",")):
            place = given.folder / f"{re.sub('[^a-z0-9]', '', arm)}_{seed}"
            true = write_session(place, arm, seed)
            run("fit", f"{place}/session", "--robot", f"{place}/arm.urdf", "--net", "none", "--out", f"{place}/model")
            run("export", f"{place}/model", "--format", "mjcf", "--out", f"{place}/files")
            written = read_attributes(place / "files" / "robot.xml")
            worst = [100.0 * np.abs(written[name] / true[name] - 1.0).max() for name in ATTRIBUTES]
            held, count = held_in_model(place / "model", true)
            figures = " ".join(f"{name} {error:.2f} %" for name, error in zip(ATTRIBUTES, worst, strict=True))
            print(f"{arm:<10}{seed:>6}  {figures}  intervals {held} of {count}", flush=True)


if __name__ == "__main__":
    main()
