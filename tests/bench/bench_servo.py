"""A servo's roll-outs on a published split, by our own steps and by the files that simulators load.

    IDENT_REAL_DATA=../shared/real python tests/bench/bench_servo.py [--short]

The XL330 of `published/xl330`: fitted to the eight runs of sines, rolled out from their first position by
goals alone on the eight others; mean absolute error of the position, run by run alike. Published on this
split: 82.5 mrad (BAM's m3), 96.2 (m1). MuJoCo's file is loaded by MuJoCo, BAM's by BAM where that is
installed. With --short the twelve seconds of two sines of one gain alone are fitted, and the other two
runs of that gain rolled out.
"""

import json
import os
import sys
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ident.servos.in_mujoco import mujoco_error
from ident.servos.roll_out import Drive, ServoModel, fit_servo
from ident.servos.servo_files import as_bam

REAL = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
RAW = REAL / "published/xl330/raw"
GRAVITY = 9.80665  # [m/s²]
GAINS = (100, 200, 400, 800)
# Supply of BAM's XL330, which replaces that of a log [V].
BAM_VOLTS = 7.5


def read_drive(path: Path) -> tuple[str, Drive]:
    """A run and the name of its motion."""
    record = json.loads(path.read_text(encoding="utf-8"))
    rows = record["entries"]
    time, goal, position = (
        np.array([row[key] for row in rows], dtype=float) for key in ("timestamp", "goal_position", "position")
    )
    driven = np.array([bool(row["torque_enable"]) for row in rows])
    mass, length = record["mass"], record["length"]
    cosine = np.zeros(len(rows))
    sine = np.full(len(rows), mass * GRAVITY * length)
    session = GAINS.index(record["kp"])
    drive = Drive(path.stem, session, time, goal, position, driven, mass * length**2, cosine, sine)
    return record["trajectory"], drive


def bam_error(model: ServoModel, held: list[Drive]) -> float:
    """Mean absolute error of BAM's own simulator with our file of its m4 [rad]."""
    from bam.model import load_model
    from bam.simulate import Simulator

    record = as_bam("xl330", model)
    shared = model.shared
    constant = shared["back_emf_Nms_rad"] * BAM_VOLTS / shared["limit_Nm"]
    record |= {"kt": constant, "R": constant * BAM_VOLTS / shared["limit_Nm"], "volts": BAM_VOLTS}
    errors = []
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "bam.json"
        path.write_text(json.dumps(record), encoding="utf-8")
        for drive in held:
            loaded = load_model(str(path))
            # BAM's gain of the log, which is to give our stiffness.
            gain = model.stiffness[drive.session] / (shared["limit_Nm"] * loaded.actuator.error_gain)
            log = as_log(drive, gain)
            positions, _, _ = Simulator(loaded).rollout_log(log, simulate_control=True)
            errors.append(float(np.mean(np.abs(np.array(positions) - log_positions(log)))))
    return float(np.mean(errors))


def as_log(drive: Drive, gain: float, step: float = 0.005) -> dict:
    """A run as BAM processes it, on an even grid."""
    grid = np.arange(drive.time[0], drive.time[-1], step)
    position = np.interp(grid, drive.time, drive.position)
    held = np.searchsorted(drive.time, grid, side="right") - 1
    speed = np.gradient(position, step)
    entries = []
    for k, row in enumerate(held):
        entries.append(
            {
                "position": float(position[k]),
                "speed": 0.0 if k == 0 else float(speed[k]),
                "goal_position": float(drive.goal[row]),
                "torque_enable": bool(drive.driven[row]),
                "control": 0.0,
            }
        )
    mass = drive.inertia / 0.1**2
    return {"mass": mass, "arm_mass": 0.0, "length": 0.1, "kp": gain, "vin": BAM_VOLTS, "dt": step, "entries": entries}


def log_positions(log: dict) -> np.ndarray:
    return np.array([entry["position"] for entry in log["entries"]])


def report(train: list[Drive], held: list[Drive]) -> None:
    """Errors of one fit."""
    sessions = sorted({drive.session for drive in train})
    train, held = (
        [replace(drive, session=sessions.index(drive.session)) for drive in drives] for drives in (train, held)
    )
    model = fit_servo(train)
    seconds = sum(float(np.ptp(drive.time)) for drive in train)
    errors = {
        "goal taken for position": float(np.mean([np.mean(np.abs(drive.goal - drive.position)) for drive in held])),
        "roll-out": model.error(held),
        "servo.xml in MuJoCo": mujoco_error("servo", model, held),
    }
    if find_spec("bam"):
        errors["m4 file in BAM"] = bam_error(model, held)
    print(f"fitted to {len(train)} runs, {seconds:.0f} s; {len(held)} others: mean absolute error [mrad]")
    for name, error in errors.items():
        print(f"  {name}: {1e3 * error:.1f}", flush=True)


def main(words: list[str]) -> None:
    runs = [read_drive(path) for path in sorted(RAW.glob("*.json"))]
    train = [drive for motion, drive in runs if motion.startswith("sin")]
    held = [drive for motion, drive in runs if not motion.startswith("sin")]
    if "--short" not in words:
        report(train, held)
        return
    for session in range(len(GAINS)):
        print(f"gain {GAINS[session]}: ", end="")
        report([one for one in train if one.session == session], [one for one in held if one.session == session])


if __name__ == "__main__":
    main(sys.argv[1:])
