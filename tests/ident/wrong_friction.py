"""An arm whose URDF states friction, recorded by MuJoCo alone: nothing of it is armgap's but the URDF."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

ROOT = Path(__file__).parents[2]
JOINTS = [f"joint_{k}" for k in range(1, 7)]
# What the URDF says of each joint [N m s/rad, N m]; rotors, of which no URDF can say anything [kg m²].
DAMPING = (8.0, 10.0, 6.0, 2.0, 1.5, 1.0)
FRICTION = (6.0, 8.0, 5.0, 1.5, 1.2, 0.8)
ROTORS = (0.6, 0.8, 0.5, 0.15, 0.12, 0.1)
STEP = 0.001  # [s]
TORQUE_NOISE, ENCODER_NOISE = 0.05, 1e-5  # [N m, rad]


def state_friction(damping: tuple[float, ...] = DAMPING, friction: tuple[float, ...] = FRICTION) -> str:
    """The shipped arm's URDF, which states this friction."""
    rows = iter(zip(damping, friction, strict=True))

    def stated(match: re.Match[str]) -> str:
        viscous, dry = next(rows)
        return f'<dynamics damping="{viscous!r}" friction="{dry!r}"/>'

    text = (ROOT / "urdf" / "tm5_900.urdf").read_text()
    return re.sub(r"<dynamics [^>]*/>", stated, text)


def load(text: str, rotors: tuple[float, ...] = ROTORS) -> mujoco.MjModel:
    """MuJoCo's own reading of a URDF or MJCF, without contacts, dry friction hard."""
    spec = mujoco.MjSpec.from_string(text)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    model = spec.compile()
    model.opt.timestep = STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if rotors:
        model.dof_armature[:] = rotors
    model.dof_solref[:] = 0.002, 1.0
    model.dof_solimp[:, :2] = 0.999
    return model


def reference(run: int, seconds: float) -> np.ndarray:
    """A run's wanted angles at every step: waves of all joints, other ones in every run [rad]."""
    rng = np.random.default_rng(100 + run)
    time = np.arange(0.0, seconds, STEP)[:, None]
    angle = np.zeros((len(time), 6)) + np.array([0.0, 0.0, 1.2, 0.0, 1.2, 0.0])
    for _ in range(3):
        size = rng.uniform(0.15, 0.4, 6)
        pulse = rng.uniform(0.6, 3.0, 6)
        phase = rng.uniform(0.0, 2.0 * np.pi, 6)
        angle += size * np.sin(pulse * time + phase)
    return angle


def play(model: mujoco.MjModel, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles and torques of a model that follows wanted angles under a PD controller with feed-forward."""
    speed = np.gradient(wanted, STEP, axis=0)
    acceleration = np.gradient(speed, STEP, axis=0)
    data, ideal = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = wanted[0], speed[0]
    angles, torques = np.zeros_like(wanted), np.zeros_like(wanted)
    stiff = np.array([6000.0, 6000.0, 4000.0, 1200.0, 900.0, 600.0])
    for k in range(len(wanted)):
        ideal.qpos[:], ideal.qvel[:], ideal.qacc[:] = wanted[k], speed[k], acceleration[k]
        mujoco.mj_inverse(model, ideal)
        pull = stiff * (wanted[k] - data.qpos) + 0.05 * stiff * (speed[k] - data.qvel)
        torque = ideal.qfrc_inverse + pull
        angles[k], torques[k] = data.qpos, torque
        data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data)
    return angles, torques


def record(model: mujoco.MjModel, folder: Path, runs: int = 8, seconds: float = 8.0, first: int = 0) -> Path:
    """A session of a model in native columns, at 250 Hz."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(first)
    for run in range(first, first + runs):
        angles, torques = play(model, reference(run, seconds))
        # A controller holds its torque for an interval of the log; its mean is what an arm feels in between.
        every = slice(0, None, 4)
        angles = angles[every] + ENCODER_NOISE * rng.standard_normal(angles[every].shape)
        torques = torques[every] + TORQUE_NOISE * rng.standard_normal(torques[every].shape)
        columns = {"time": (seconds + 2.0) * run + 4 * STEP * np.arange(len(angles))}
        for j, joint in enumerate(JOINTS):
            columns[f"{joint}/position"] = angles[:, j]
            columns[f"{joint}/effort"] = torques[:, j]
        pq.write_table(pa.table(columns), folder / f"run_{run:02d}.parquet")
    return folder
