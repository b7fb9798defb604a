"""Patches and exports of real and simulated arms, against the URDF and against tuning alone, on runs held back.

    IDENT_REAL_DATA=../shared/real python tests/bench/bench_patch.py FOLDER [ARM …]

Half of the runs are diagnosed, and fitted with what was named (`ident fit --with`); a third decides what is written
(`ident patch --on`, `ident export --on`); the rest, of simulated arms all after the ninth, is seen by nobody. A single
run is cut into six pieces. For every file the largest ratio over joints of its error to the smaller of the URDF's (with
tuned losses, and as it is) and the tuned arm's, in torque, energy and replay; the largest of which stretches make sure
(97.5 %, of all joints, measures and rivals at once, as the largest of many is above one by chance); the geometric mean;
and the least that the largest ratio of any of these rivals is itself, above one where none is the best everywhere: then
no file need be. An export that does not beat the URDF alone is not written, and said so.
FOLDER keeps diagnoses and models: what is there is not made again.
"""

import json
import os
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from ident.checks.inspection import inspect_sessions
from ident.command_options import ExportOptions, FitOptions
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.export.choose import MEASURES, Gap, measure_gap
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import FILE_OF, LoadedMjcf, LoadedModel, LoadedUrdf, WrittenFile
from ident.export.write import write_export, write_patch
from ident.fitting.fit import fit_hybrid
from ident.fitting.named_laws import read_named_laws
from ident.laws.motion import Losses
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion, prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.joint_names import match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Payload, Recording, Session
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate
from tests.ident.conftest import load_sapienza, ur10e_settings

REAL = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
PIECES, SEED, KNOWN, RUNS = 6, 5, 9, 21
SIMULATED = {
    "payload, Stribeck": "payload:arm:0.6 stribeck_friction:joint_1:4",
    "delay, spring, asymmetric": "torque_delay:arm:0.008 spring_torque:joint_3:10 asymmetric_friction:joint_2:4",
    "load friction, gain": "load_dependent_friction:joint_2:0.1 torque_gain_error:joint_3:0.08",
    "curved friction": "nonlinear_viscous_friction:joint_1:3",
}
Arm = tuple[ArmModel, Session]


def in_pieces(run: Recording) -> list[Recording]:
    """One run as several."""
    edges = np.linspace(0, len(run), PIECES + 1).astype(int)
    return [run.at(slice(a, b), f"part_{k}") for k, (a, b) in enumerate(pairwise(edges))]


def real(folder: str, robot: str = "robot.urdf", pattern: str = "*.parquet", settings: str = "") -> Arm:
    """Runs of a folder, each by itself; one run alone is cut into pieces."""
    place, toml = REAL / folder, Path(tempfile.gettempdir()) / "bench_patch.toml"
    toml.write_text(settings)
    given = {"session_file": toml} if settings else {}
    arm = ArmModel.load(place / robot if robot.endswith(".urdf") else robot)
    sessions = [match_joints(load_session(path, **given), arm.joint_names)[0] for path in sorted(place.glob(pattern))]
    runs = [run for session in sessions for run in session.runs]
    runs = in_pieces(runs[0]) if len(runs) == 1 else runs
    return arm, sessions[0].replace(runs=tuple(runs), common_clock=False)


def panda() -> Arm:
    return ArmModel.load("panda"), Session("panda", tuple(in_pieces(load_sapienza(REAL).runs[0])), common_clock=False)


def simulated(effects: str) -> Arm:
    session = simulate(SimulationOptions(effects=tuple(effects.split()), seed=SEED, runs=RUNS, duration=6.0)).session
    return ArmModel.load("tm5-900"), session


UR10E = "identification/ur-20_0[12]_[0-9][0-9][-_][12567u]*.csv"
ARMS: dict[str, Callable[[], Arm]] = {
    "UR10e": lambda: real("ur10e", "ur10e.urdf", UR10E, ur10e_settings()),
    "UR10": lambda: real("ur10_cb", "ur10", "*.db3"),
    "Panda": panda,
    "Rokae AR5": lambda: real("rokae_ar5", pattern="*.csv"),
    "dual arm": lambda: real("dual_arm_v2", pattern="**/*.parquet"),
    "AIRBOT": lambda: real("airbot_play"),
    "IC arm": lambda: real("ic_arm", "robot_scaled.urdf"),
    **{name: lambda effects=effects: simulated(effects) for name, effects in SIMULATED.items()},
}


def parts_of(session: Session) -> tuple[Session, ...]:
    """To be diagnosed, to choose by, and unseen."""
    number = range(len(session.runs))
    cycle, known = min(PIECES, len(number)), KNOWN if len(number) == RUNS else len(number)
    unseen = [k for k in number if k % cycle == cycle - 1 or k >= known]
    choosing = [k for k in number if k % 3 == 1 and k not in unseen]
    rest = [k for k in number if k not in {*unseen, *choosing}]
    return tuple(session.replace(runs=tuple(session.runs[k] for k in some)) for some in (rest, choosing, unseen))


def learn(name: str, cache: Path) -> tuple[ArmModel, list[tuple[Motion, ...]], Path, HybridModel]:
    """The arm, motions to choose by and unseen, the diagnosis, and the model with its laws."""
    arm, session = ARMS[name]()
    training, *others = parts_of(session)
    arm = arm.keeping(session.joints)
    motions = [tuple(prepare(one, settings=FOR_DIAGNOSIS)) for one in others]
    stem = name.replace(" ", "_").replace(",", "")
    path = cache / f"{stem}.json"
    if not path.is_file():
        diagnosis, _, _ = diagnose_reports(inspect_sessions([training], arm), arm, CATALOGUE)
        path.write_text(json.dumps(diagnosis.to_dict()), encoding="utf-8")
    folder = cache / f"{stem}_model"
    if not folder.is_dir():
        named = read_named_laws(path, arm) if json.loads(path.read_text())["findings"] else None
        fit_hybrid(prepare(training), arm, FitOptions(net="none"), named=named).model.save(folder)
    return arm, motions, path, HybridModel.load(folder)


def cell(own: Gap, rivals: Sequence[Gap], joints: Sequence[str]) -> str:
    """The worst ratio and where it is, the largest that is sure, the mean, and the least worst ratio of a rival."""
    found = own.over(rivals)
    sure = own.over(rivals, level=0.025 / (found.size * len(rivals)))
    where = np.unravel_index(int(found.argmax()), found.shape)
    least = min(float(one.over(rivals).max()) for one in rivals)
    place = f"({list(MEASURES)[where[0]]}, {joints[where[1]][-8:]})"
    most = f"{np.exp(found[where]):.2f} {place}, sure {np.exp(sure.max()):.2f}"
    return f"{most}, mean {np.exp(found.mean()):.2f}, rivals {np.exp(least):.2f}"


def rows(name: str, cache: Path) -> str:
    """One arm's row."""
    arm, (choosing, unseen), path, model = learn(name, cache)
    diagnosed, cells = Diagnosed.load(path) if json.loads(path.read_text())["findings"] else None, []
    laws = "none" if diagnosed is None else ", ".join(f"{c.effect} {'/'.join(c.joints[:1])}" for c in diagnosed.changes)
    jobs: dict[str, tuple[Mapping[str, Any], Mapping[str, IdentifiedArm]]] = {}
    if diagnosed is not None:
        jobs["patch"] = write_patch(diagnosed, arm, cache / "patch", choosing), diagnosed.candidates(arm)
    written = write_export(model, cache / "export", ExportOptions(nearest=True), choosing)
    jobs["export"] = written, IdentifiedArm.of_models(model, nearest=True)
    for folder, (record, options) in jobs.items():
        nominal = options["after"].nominal
        rivals = {key: one for key, one in options.items() if key != "after"}
        if not record.get("promotion", {"passed": True})["passed"]:
            cells += ["not promoted"] * 4
            continue
        for form, runs in product(("urdf", "mjcf"), (choosing, unseen)):
            payload = runs[0].payload
            own = measure_gap(load(cache / folder, form, nominal, payload), runs)
            files = (WrittenFile.write(form, cache / "scratch", one) for one in rivals.values())
            others = [measure_gap(file.load(payload), runs) for file in files]
            cells.append(f"{record['written'][form] * (runs is choosing)} {cell(own, others, arm.joint_names)}")
    return f"| {name} | {laws} | " + " | ".join([*[""] * (8 - len(cells)), *cells])


def load(folder: Path, form: str, arm: ArmModel, payload: Payload | None) -> LoadedModel:
    """A written file as it lies there; losses that a URDF has no place for are those of the parameter file."""
    if form == "mjcf":
        return LoadedMjcf(folder / FILE_OF[form], arm.joint_names, payload)
    record = tomllib.loads((folder / "parameters.toml").read_text(encoding="utf-8"))
    table = record.get("losses_of_urdf", record["losses"])
    keys = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm", "transition_rad_s", "sliding_range_rad")
    losses = Losses(*(np.array([table[joint][key] for joint in arm.joint_names]) for key in keys))
    return LoadedUrdf.read(folder / FILE_OF[form], tuple(arm.locked_joints), losses, payload)


def main(folder: str, *names: str) -> None:
    cache = Path(folder)
    cache.mkdir(parents=True, exist_ok=True)
    for name in names or ARMS:
        try:
            line = rows(name, cache)
        except InputError as error:
            line = f"| {name} | {error}"
        print(f"{line} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
