"""Tables that others published, on their split and by their metric, without an option.

    python -m tests.bench.bench_published xmate|lwr4|xl330 [--real DIR] [--json FILE]

xmate   Rokae xMate 7 Pro: fitted on trajectory 1, foretold 2 and 3; 100 |tau - foretold| / |tau| over all joints, all
        signals through a Butterworth filter of third order at 2.5 Hz both ways, 3 s cut at the start and 1 s at the
        end. Published by NKU-ZiXuan/xMate7p_dyn_ident: 3.04 and 3.49 %.
lwr4    KUKA LWR4+: fitted on recording 1, foretold 2; mean over joints of the RMSE over twice the URDF's effort limit.
        Published by FloBaRoID 0.9.8: 0.176 % (0.211 with even weights).
xl330   XL330 servo with 0.49 kg at 0.10 m: fitted on its eight runs of sinusoids, the other eight rolled out freely;
        mean absolute error of position. Published by Rhoban/bam: m3 82.5 mrad, m1 96.2.

Recordings: IDENT_REAL_DATA, or --real; none of them is part of this project.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, filtfilt

from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion
from ident.origin import code_commit
from ident.robot.arm import ArmModel
from ident.servos.roll_out import Drive, fit_servo
from tests.bench.peers.held_out_sets import neutral_motion, read_lwr4

Figures = dict[str, Any]

# xMate: its authors' filter and cuts.
XMATE_HZ, XMATE_ORDER, XMATE_CORNER_HZ = 50.0, 3, 2.5
XMATE_START_S, XMATE_END_S = 3.0, 1.0
XMATE_PUBLISHED = {"traj2": 3.04, "traj3": 3.49}
LWR4_PUBLISHED = {"FloBaRoID 0.9.8": 0.176, "even weights": 0.211}
XL330_PUBLISHED = {"m3": 82.5, "m1": 96.2}
SINUSOIDS = ("sin_sin", "sin_time_square")
GRAVITY = 9.81


def xmate_motion(path: Path, arm: ArmModel) -> Motion:
    """One of the trajectories: 28 columns q, dq, ddq, tau at 50 Hz, through the authors' filter."""
    table = np.loadtxt(path, delimiter=",")
    numerator, denominator = butter(XMATE_ORDER, XMATE_CORNER_HZ, fs=XMATE_HZ)
    smooth = filtfilt(numerator, denominator, table, axis=0)
    inside = smooth[round(XMATE_START_S * XMATE_HZ) : len(smooth) - round(XMATE_END_S * XMATE_HZ)]
    q, dq, ddq, tau = np.split(inside, 4, axis=1)
    time = np.arange(len(q)) / XMATE_HZ
    lowpass = Lowpass.design(XMATE_HZ, XMATE_CORNER_HZ)
    std = np.zeros((3, arm.n))
    return Motion(path.stem, arm.joint_names, time, q, dq, ddq, tau, lowpass, std, log_interval=1.0 / XMATE_HZ)


def fitted(arm: ArmModel, motions: list[Motion]) -> HybridModel:
    """`ident fit` as it comes."""
    return fit_hybrid(motions, arm, FitOptions()).model


def foretold(model: HybridModel, motion: Motion) -> Float[Array, "T n"]:
    return np.asarray(model.torque(motion.q, motion.dq, motion.ddq))


def xmate(folder: Path) -> Figures:
    """Relative error of torque [%]."""
    place = folder / "published/xmate7p"
    arm = ArmModel.load(place / "robot.urdf")
    motions = {name: xmate_motion(place / f"{name}.csv", arm) for name in ("traj1", "traj2", "traj3")}
    model = fitted(arm, [motions["traj1"]])
    ours: Figures = {}
    for name in XMATE_PUBLISHED:
        motion = motions[name]
        left = motion.tau - foretold(model, motion)
        ours[name] = round(100.0 * float(np.linalg.norm(left) / np.linalg.norm(motion.tau)), 2)
    return {"unit": "%", "ours": ours, "published": XMATE_PUBLISHED}


def lwr4(folder: Path) -> Figures:
    """RMSE over twice the effort limit, mean over joints [%]."""
    place = folder / "published/kuka_lwr4"
    arm = ArmModel.load(place / "robot.urdf")
    first, second = (neutral_motion(run) for run in read_lwr4(place)[:2])
    model = fitted(arm, [first])
    left = second.tau_filtered - second.filtered(foretold(model, second))
    rms = np.sqrt(np.mean(left**2, axis=0))
    share = 100.0 * float(np.mean(rms / (2.0 * arm.effort_limit)))
    return {"unit": "%", "ours": {"recording 2": round(share, 3)}, "published": LWR4_PUBLISHED}


def read_drive(path: Path, gains: list[int]) -> tuple[str, Drive]:
    """A raw run of the servo: its trajectory's name, and what it was told and did."""
    record = json.loads(path.read_text())
    entries = record["entries"]
    columns = {key: np.array([entry[key] for entry in entries]) for key in ("timestamp", "position", "goal_position")}
    driven = np.array([bool(entry["torque_enable"]) for entry in entries])
    moment = record["mass"] * record["length"]
    count = len(entries)
    drive = Drive(
        name=path.stem,
        session=gains.index(record["kp"]),
        time=columns["timestamp"].astype(float),
        goal=columns["goal_position"].astype(float),
        position=columns["position"].astype(float),
        driven=driven,
        inertia=moment * record["length"],
        cosine=np.zeros(count),
        sine=np.full(count, GRAVITY * moment),
    )
    return record["trajectory"], drive


def xl330(folder: Path) -> Figures:
    """Mean absolute error of position in free roll-outs [mrad]."""
    paths = sorted((folder / "published/xl330/raw").glob("*.json"))
    gains = sorted({int(json.loads(path.read_text())["kp"]) for path in paths})
    runs = [read_drive(path, gains) for path in paths]
    train = [drive for name, drive in runs if name in SINUSOIDS]
    held = [replace(drive) for name, drive in runs if name not in SINUSOIDS]
    error = fit_servo(train).error(held)
    ours = {"free roll-out": round(1e3 * error, 1)}
    return {"unit": "mrad", "runs": [len(train), len(held)], "ours": ours, "published": XL330_PUBLISHED}


TABLES: dict[str, Callable[[Path], Figures]] = {"xmate": xmate, "lwr4": lwr4, "xl330": xl330}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=TABLES)
    parser.add_argument("--real", type=Path, default=Path(os.environ.get("IDENT_REAL_DATA", "../shared/real")))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    figures = {"table": asked.table, "commit": code_commit(), **TABLES[asked.table](asked.real)}
    print(json.dumps(figures, indent=1))
    if asked.json is not None:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
