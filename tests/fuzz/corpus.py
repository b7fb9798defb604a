"""Writes one good file of every kind that a command takes."""

import json
import os
import shutil
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
from plyfile import PlyData, PlyElement
from pypcd4 import PointCloud
from rosbags.rosbag2 import StoragePlugin

from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.residual_net import PRESETS, fit_residual_net
from ident.monitor.store import Store, write_rows
from ident.outputs import write_marker
from ident.recordings.load import load_session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.sessions import open_sessions
from ident.simulation.request import Answer, TrueEffect, seal
from tests.fuzz.samples import (
    APPLIED,
    CALIBRATION,
    CATALOGUE,
    CUBE,
    CYCLE,
    LIMITS,
    LINKS,
    SCENE,
    SESSION_TOML,
    WORLD,
    XACRO,
    dae,
    obj,
    ply,
    shaped,
    stl,
)
from tests.ident.benchmark.made_up_board import write_board
from tests.ident.export.diagnoses import write_diagnosis
from tests.ident.foreign import write_bag
from tests.ident.recordings.test_bags import rows_of
from tests.ident.recordings.test_foreign_files import write_old_bag

ROWS = 120
JOINTS = [f"joint_{k}" for k in range(1, 7)]
KEY = bytes(range(16))
# Of the net that is trained rather than solved for; its checkpoint is written at the tenth epoch.
OPTIONS = replace(PRESETS["paper"], epochs=10, hidden=(8, 4))


def in_a_child(act: Any, *arguments: Any) -> None:
    """Does something in a forked process: libraries' threads that it starts would be missing in later children."""
    child = os.fork()
    if not child:
        try:
            act(*arguments)
        except BaseException:
            import traceback

            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        raise SystemExit(f"{act.__name__} failed")


def write_files(folder: Path, net: bool = True) -> None:
    """All of them; a model without a net, and no checkpoint, where that would take too long."""
    arm = ArmModel.load("tm5-900")
    _recordings(folder)
    _model(folder, arm, net)
    _settings(folder)
    _scenes(folder, arm)
    _records(folder, arm)


def training_data(arm: ArmModel) -> tuple[Any, ...]:
    """States and torque of a training."""
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 400, arm.n))
    return q, dq, ddq, arm.inverse_dynamics(q, dq, ddq)


def _recordings(folder: Path) -> None:
    run = Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet"
    table = pq.read_table(run).slice(0, ROWS)
    pq.write_table(table, folder / "run.parquet")
    pacsv.write_csv(table, folder / "run.csv")
    np.savez(folder / "run.npz", **{name: table[name].to_numpy() for name in table.column_names})
    arrays = {name: np.column_stack([table[f"{joint}/{name}"] for joint in JOINTS]) for name in ("position", "effort")}
    _data_set(folder / "set", table["time"], arrays)
    foreign = [",".join(map(str, row.values())).replace(",", " ; ") for row in islice(table.to_pylist(), ROWS)]
    (folder / "foreign.txt").write_text("\n".join(foreign))
    columns = "\n".join(f'{k} = "{name}"' for k, name in enumerate(table.column_names, start=1))
    (folder / "foreign.toml").write_text(f"[columns]\n{columns}\n")
    (folder / "trapped").mkdir()
    (folder / "trapped/seed.txt").write_text("all of a trap folder follows from these bytes\n")
    recording = load_session(folder / "run.parquet").runs[0]
    write_old_bag(folder / "old.bag", recording)
    for storage in StoragePlugin:
        write_bag(folder / f"bag_{storage.name}", rows_of(recording), storage)


def _data_set(folder: Path, time: pa.ChunkedArray, arrays: dict[str, np.ndarray]) -> None:
    """The same as a LeRobot data set."""
    lists = {"observation.state": arrays["position"].tolist(), "observation.effort": arrays["effort"].tolist()}
    columns = {**lists, "timestamp": time, "episode_index": [0] * len(time)}
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    features = {name: {"dtype": "float32", "shape": [6], "names": JOINTS} for name in lists}
    (folder / "meta/info.json").write_text(json.dumps({"fps": 200, "features": features}))
    pq.write_table(pa.table(columns), folder / "data/chunk-000/file-000.parquet")


def _model(folder: Path, arm: ArmModel, net: bool) -> None:
    opened = open_sessions([Path(data_path("logs/tm5_900")) / "E1"], arm)
    quick = FitOptions(links=6, inertia="nominal", net="none")
    model = fit_hybrid(opened.motions, opened.arm, quick, opened.data_records()).model
    if not net:
        model.save(folder / "model")
        return
    q, dq, ddq, tau = training_data(arm)
    states, training = [(q, dq, ddq, tau)], folder / "model.training"
    fit_residual_net(states, [0.1 * tau], options=OPTIONS, checkpoint=training)
    replace(model, net=fit_residual_net(states, [0.1 * tau])).save(folder / "model")


def _settings(folder: Path) -> None:
    (folder / "session.toml").write_text(SESSION_TOML)
    shutil.copy(data_path("urdf/tm5_900.urdf"), folder / "robot.urdf")
    (folder / "own").mkdir()
    shutil.copy(data_path("urdf/tm5_900.urdf"), folder / "own/own.urdf")
    (folder / "own/own.xml").write_text(mujoco.MjSpec.from_file(str(data_path("urdf/tm5_900.urdf"))).to_xml())
    (folder / "arm.xacro").write_text(XACRO)
    (folder / "links.xacro").write_text(LINKS)
    (folder / "limits.toml").write_text(LIMITS)
    (folder / "applied").mkdir()
    (folder / "applied/session.toml").write_text(APPLIED)
    shutil.copy(folder / "run.parquet", folder / "applied/run.parquet")
    (folder / "calibration.json").write_text(CALIBRATION)
    (folder / "world.toml").write_text(WORLD)
    (folder / "own_effect.py").write_text(CATALOGUE)
    _store(folder / "store")
    place = folder / "marked"
    place.mkdir()
    (place / "file").write_text("armgap")
    write_marker(place, "model")


def _store(folder: Path) -> None:
    """What a watch keeps of two sessions of an arm."""
    for day, value in (("2026-05-03", 1.0), ("2026-05-10", 1.2)):
        row = {"arm": "left", "session": day, "date": day, "joint": "joint_1", "figure": "viscous", "unit": "N m s/rad"}
        row |= {"value": value, "low": value - 0.1, "high": value + 0.1, "std": 0.05, "status": "done"}
        row |= {"effect": "payload", "joints": "joint_1", "probability": 0.9, "shrink": 0.5, "stamp": "0"}
        for kind in ("figures", "effects", "sessions"):
            write_rows(Store(folder).place(kind, "left", day), kind, [row])


def _scenes(folder: Path, arm: ArmModel) -> None:
    (folder / "cube.stl").write_text(stl())
    (folder / "cube.obj").write_text(obj())
    (folder / "cube.ply").write_text(ply())
    (folder / "cube.dae").write_text(dae())
    corners = np.array(CUBE, dtype=np.float32)
    rows = np.array([tuple(corner) for corner in corners], dtype=[(axis, "f4") for axis in "xyz"])
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(folder / "scan.ply"))
    PointCloud.from_xyz_points(corners).save(folder / "scan.pcd")
    np.save(folder / "scan.npy", corners)
    (folder / "scene.toml").write_text(SCENE)
    (folder / "cycle.toml").write_text(CYCLE)
    (folder / "shaped").mkdir()
    shutil.copy(folder / "cube.obj", folder / "shaped/link.obj")
    (folder / "shaped/arm.urdf").write_text(shaped(Path(data_path("urdf/tm5_900.urdf")).read_text(), "link.obj"))
    pairs = '<disable_collisions link1="link_1" link2="link_2" reason="Adjacent"/>'
    (folder / "arm.srdf").write_text(f'<robot name="{arm.name}">{pairs}</robot>')


def _records(folder: Path, arm: ArmModel) -> None:
    write_diagnosis(folder / "diagnosis.json", arm, "stribeck_friction", "payload")
    asked = json.loads((folder / "diagnosis.json").read_text())
    gap = {name: {"rms_Nm": 1.0, "noise_floor_Nm": 0.3} for name in arm.joint_names}
    for finding in asked["findings"]:
        finding["class"] = [finding["effect"], "torque_gain_error"]
    untold = [{"effect": "backlash", "joints": ["joint_2"], "reason": "no reversals"}]
    (folder / "question.json").write_text(json.dumps({**asked, "gap": gap, "not_testable": untold}))
    (folder / "commands.csv").write_text(_commands(arm))
    (folder / "plan.json").write_text(json.dumps(_plan(arm)))
    (folder / "sealed").mkdir()
    seal(_answer(arm), folder / "sealed", KEY)
    write_board(folder / "boards")


def _commands(arm: ArmModel) -> str:
    names = ["time", *(f"{name}/position_command" for name in arm.joint_names)]
    rows = ([k / 50.0, *([0.01 * np.sin(0.2 * k)] * arm.n)] for k in range(60))
    return "\n".join([",".join(names), *(",".join(f"{value:.4f}" for value in row) for row in rows)])


def _plan(arm: ArmModel) -> dict[str, Any]:
    points = [[0.1 * k * (j + 1) / 6 for j in range(arm.n)] for k in range(4)]
    return {
        "schema": "plan.result/1",
        "status": "solved",
        "robot": arm.name,
        "joints": list(arm.joint_names[:5]),
        "held": {arm.joint_names[5]: 0.0},
        "start_rad": points[0][:5],
        "via_points_rad": [points[1][:5], points[2][:5]],
        "goal_rad": points[3][:5],
        "times_s": [0.5, 1.0],
        "duration_s": 1.5,
        "execution": {"ramp_s": 0.1},
    }


def _answer(arm: ArmModel) -> Answer:
    """An answer as a session of the simulated arm has it."""
    one = TrueEffect("payload", True, (), 1.0, "mass_kg", {"mass_kg": 1.0}, {"joint_2": 3.0})
    return Answer(arm.name, 3, (one,), ("inertia",), dict.fromkeys(arm.joint_names, 0.3))
