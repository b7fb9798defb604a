"""Every kind of file that a command takes: a good one, its reader, and what must hold of whatever is read."""

import json
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin

from ident.benchmark.board.report import BoardReport, render_board, score_board
from ident.checks.inspection import inspect_sessions
from ident.checks.report import TOO_LITTLE, TelemetryReport
from ident.effects.catalogue import load_catalogue
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.into import require_loadable, write_into
from ident.export.own_file import read_own_file
from ident.model.evaluation_limits import load_limits
from ident.model.hybrid import HybridModel
from ident.model.net_options import NAME as CHECKPOINT
from ident.model.residual_net import ResidualNet, fit_residual_net
from ident.monitor.pages import arm_estimates, arm_sessions, arm_verdict
from ident.monitor.store import Store
from ident.monitor.watch import ArmHistory, read_histories
from ident.outputs import require_own_folder
from ident.recordings.lerobot import read_calibration
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.recordings.session_toml import load_session_file
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.robot.pinocchio_model import read_geometry
from ident.show.report.page import render_page
from ident.simulation.request import ENVELOPE_NAME, open_envelope
from ident.simulation.world import find_world
from ident.trajectories.files import read_commands
from ident.trajectories.plan_record import read_plan
from plan.experiment.hypotheses import ask
from plan.geometry.clouds import read_cloud
from plan.geometry.obstacle_files import read_mesh
from plan.geometry.pairs import read_disabled
from plan.problem.task_file import load_surroundings, load_task
from tests.fuzz.corpus import KEY, OPTIONS, training_data
from tests.fuzz.trapped import lay_traps

# Of nanoseconds since 1970, in seconds or metres no figure of an arm; and no figure that is told has more digits.
BEYOND = 1e12
# A control character of a name is shown by its code, \x1e say, which begins no figure.
UNTOLD = re.compile(r"(?<!\\x)\d[eE]\+?(\d{2,})")
LARGEST_TOLD = 20
# One in so many recordings is inspected as well, which takes long; the others are read only.
INSPECTED = 12
# No drive holds so many times what it is rated for.
MOST_RATED = 20.0
Read = Callable[[Path], object]


class WrongError(AssertionError):
    """What was read can't be right."""


@dataclass(frozen=True)
class Kind:
    """One kind of file."""

    name: str  # in the table
    path: Path  # a good one
    read: Read  # its reader, as a command calls it
    check: Callable[[Any], None] = lambda found: None  # raises WrongError where what was read must not have been taken
    share: float = 1.0  # how often it is drawn against the others
    writes: bool = False  # whether the reader may write the file anew where it is damaged
    prepare: Callable[[], object] = lambda: None  # loads what no good file alone has loaded


def must(holds: object, what: str) -> None:
    if not holds:
        raise WrongError(what)


def finite(what: str, *values: Any) -> None:
    for one in values:
        if one is not None:
            must(np.isfinite(np.asarray(one, dtype=float)).all(), f"{what} is not finite")


def check_report(report: TelemetryReport) -> None:
    """Whatever is fit for use is finite and of this world; nothing told is beyond physics."""
    for issue in report.issues:
        seen = [int(power) for power in UNTOLD.findall(issue.evidence)]
        must(max(seen, default=0) <= LARGEST_TOLD, f"tells {issue.evidence!r}")
        must(len(issue.evidence.splitlines()) == 1, f"tells several lines: {issue.evidence!r}")
    if all(issue.issue in TOO_LITTLE for issue in report.fatal):  # of so short a run there is always too little
        check_session(report.session)
        if report.arm is not None:
            rated = report.arm.model.effortLimit
            for run in report.session.runs:
                must((np.median(np.abs(run.effort), axis=0) < MOST_RATED * rated).all(), "torque beyond any drive's")
                must(len(run) < 2 or (np.ptp(run.effort, axis=0) > 0.0).any(), "no torque at all")


def check_session(session: Session) -> None:
    for run in session.runs:
        must((np.diff(run.time) > 0).all(), "time does not rise")
        for name, values in run.channels().items():
            finite(name, values)
            must(np.abs(values).max(initial=0.0) < BEYOND, f"{name} is beyond any arm")


def check_arm(arm: ArmModel) -> None:
    at = np.zeros((1, arm.n))
    finite("the arm", arm.lower, arm.upper, arm.velocity_limit, arm.inertial_parameters)
    finite("its torque", arm.inverse_dynamics(at, at, at + 1.0))


def check_model(model: HybridModel) -> None:
    at = np.zeros((3, model.arm.n))
    finite("its torque", model.torque(at, at + 0.1, at))


def check_diagnosed(found: tuple[Diagnosed, ArmModel]) -> None:
    for change in found[0].changes:
        finite("a figure", *(v for v in change.values.values() if isinstance(v, float)))
    losses, links = found[0].tuned
    finite("a loss", losses.coulomb, losses.viscous, links)


def check_motions(found: Any) -> None:
    for motion in found if isinstance(found, tuple) else (found,):
        finite("a motion", motion.q, motion.dq, motion.ddq)


def check_task(task: Any) -> None:
    given = (task.start, task.goal, task.duration, task.wrist, task.lower, task.upper, task.torque, task.speed)
    finite("the task", *given)
    check_boxes(task)


def check_boxes(around: Any) -> None:
    for box in (*around.obstacles, *(one.box for one in around.attached)):
        finite("an obstacle", box.centre, box.rotation, box.half)


# What is made by its reader: it is no file that is only read.
MADE = ("trap folder", "own/own.xml", "own/own.urdf")
NETS = ("model/residual.json", "model/residual.safetensors", "checkpoint")


def kinds(folder: Path) -> list[Kind]:
    """The kinds, of which `write_files` wrote one each into a folder."""
    arm = ArmModel.load("tm5-900")
    return [
        *recordings(folder, arm),
        *models(folder, arm),
        *settings(folder, arm),
        *scenes(folder, arm),
        *records(folder, arm),
        *boards(folder / "boards"),
        *own_files(folder / "own", arm),
    ]


def recordings(folder: Path, arm: ArmModel) -> list[Kind]:
    """Tables and bags. Whole inspections take long: most inputs are read only."""
    names = {StoragePlugin.SQLITE3: "db3", StoragePlugin.MCAP: "mcap"}
    bags = [folder / f"bag_{one.name}" / f"bag_{one.name}.{ending}" for one, ending in names.items()]

    def load(path: Path) -> TelemetryReport:
        session = load_session(path)
        return TelemetryReport(session, (), arm) if _skipped(path) else inspect_sessions([session], arm)[0]

    def bag(path: Path) -> TelemetryReport:
        return load(path.parent)

    def data_set(path: Path) -> TelemetryReport:
        return load(path.parents[2])

    def prepare() -> object:
        return inspect_sessions([load_session(folder / "run.parquet")], arm)

    def trapped(path: Path) -> TelemetryReport:
        return load(lay_traps(path.read_bytes(), folder / "run.parquet", path.parent / "session"))

    found = [Kind("parquet", folder / "run.parquet", load, check_loaded, prepare=prepare)]
    found += [Kind("npz", folder / "run.npz", load, check_loaded)]
    found += [Kind("trap folder", folder / "trapped/seed.txt", trapped, check_loaded, 0.5, writes=True)]
    found += [Kind("bag", folder / "old.bag", load, check_loaded, 0.3)]
    found += [Kind("lerobot", folder / "set/data/chunk-000/file-000.parquet", data_set, check_loaded, 0.3)]
    found += [Kind("info.json", folder / "set/meta/info.json", lambda path: load(path.parents[1]), check_loaded, 0.3)]
    found += [Kind("csv", folder / "run.csv", load, check_loaded, 0.3)]
    found += [Kind("foreign text", folder / "foreign.txt", load, check_loaded, 0.1)]
    found += [Kind(path.suffix[1:], path, load, check_loaded, 0.5) for path in bags]
    for one, name in ((StoragePlugin.MCAP, "metadata.yaml"), (StoragePlugin.SQLITE3, "metadata.yaml of a .db3")):
        metadata = folder / f"bag_{one.name}" / "metadata.yaml"
        found.append(Kind(name, metadata, bag, check_loaded, 0.5))
    return found


def _skipped(path: Path) -> bool:
    """Whether an input is one of the many that are read and not inspected."""
    return not path.is_file() or zlib.crc32(path.read_bytes()) % INSPECTED != 0


def check_loaded(report: TelemetryReport) -> None:
    if report.effort or report.issues:
        check_report(report)


def models(folder: Path, arm: ArmModel) -> list[Kind]:
    """A model's folder, file by file, and the checkpoint of a training."""

    def whole(path: Path) -> object:
        return HybridModel.load(path.parent)

    def resume(path: Path) -> object:
        # It is complete: nothing is left to train, and nothing is written.
        data = training_data(arm)
        return fit_residual_net([data], [0.1 * data[-1]], options=OPTIONS, checkpoint=path.parent)

    def check_net(found: ResidualNet) -> None:
        finite("the net's torque", found.predict(*(part[:5] for part in training_data(arm))))

    place = folder / "model"
    names = ("model.toml", "robot.urdf", "residual.json", "residual.safetensors")
    found = [Kind(f"model/{name}", place / name, whole, check_model, 0.25) for name in names]
    checkpoint = Kind("checkpoint", folder / "model.training" / CHECKPOINT, resume, check_net, 0.02, writes=True)
    return [*found, checkpoint]


def settings(folder: Path, arm: ArmModel) -> list[Kind]:
    """Settings, robots, limits, worlds, catalogues, markers."""
    place = folder / "marked"
    rungs = ("analytic", "loss", "net")

    def own(path: Path) -> object:
        before = path.read_bytes() if path.is_file() and not path.is_symlink() else b"{}"
        require_own_folder(path.parent, "model")
        return before

    def applied(path: Path) -> TelemetryReport:
        session = load_session(path.parent)
        return TelemetryReport(session, (), arm) if _skipped(path) else inspect_sessions([session], arm)[0]

    def check_calibration(ranges: dict[str, float]) -> None:
        finite("a range", *ranges.values())
        must(all(value > 0.0 for value in ranges.values()), "a range of nothing")

    def include(path: Path) -> ArmModel:
        return ArmModel.load(str(path.with_name("arm.xacro")))

    def check_own(marker: bytes) -> None:
        record = json.loads(marker)
        must(record["kind"] == "model" and set(record["files"]) >= {"file"}, "a folder of the user's counts as ours")

    def histories(path: Path) -> tuple[ArmHistory, ...]:
        found = read_histories(Store(folder / "store"))
        for arm in found:
            render_page(arm.arm, [arm_verdict(arm, 0.05), arm_estimates(arm), arm_sessions(arm)])
        return found

    def check_histories(found: tuple[ArmHistory, ...]) -> None:
        for points in (one for arm in found for one in arm.figures.values()):
            finite("a figure", *((one.value, one.low, one.high, one.std) for one in points))

    stored = [
        Kind(f"store/{name}", folder / f"store/{name}/left/2026-05-10.parquet", histories, check_histories, 0.1)
        for name in ("figures", "effects", "sessions")
    ]
    return [
        *stored,
        Kind("session.toml", folder / "session.toml", load_session_file),
        Kind("urdf", folder / "robot.urdf", lambda path: ArmModel.load(str(path)), check_arm),
        # Expressions may take up to a second each before they are refused.
        Kind("xacro", folder / "arm.xacro", lambda path: ArmModel.load(str(path)), check_arm, 0.3),
        Kind("included xacro", folder / "links.xacro", include, check_arm, 0.5),
        Kind("applied session.toml", folder / "applied/session.toml", applied, check_loaded),
        Kind("calibration.json", folder / "calibration.json", read_calibration, check_calibration, 0.3),
        Kind("limits.toml", folder / "limits.toml", lambda path: load_limits(path, arm.joint_names, rungs)),
        Kind("world.toml", folder / "world.toml", find_world),
        Kind("catalogue", folder / "own_effect.py", load_catalogue, share=0.2),
        Kind("marker", place / ".armgap.json", own, check_own, 0.5, writes=True),
    ]


def scenes(folder: Path, arm: ArmModel) -> list[Kind]:
    """What the planner reads."""

    def mesh(path: Path) -> object:
        return read_mesh(path, np.ones(3), False)

    def cloud(path: Path) -> object:
        return read_cloud(path, 0.01, np.ones(3))

    def around(path: Path) -> object:
        return load_surroundings(path, np.zeros(3, dtype=bool))

    def shapes(path: Path) -> object:
        arm = ArmModel.load(str(path))
        return read_geometry(arm.model, arm.urdf, "collision", path, str(path))

    def check_mesh(found: Any) -> None:
        finite("the mesh", found[0].points, found[1])

    return [
        Kind("scene.toml", folder / "scene.toml", load_task, check_task),
        Kind("cycle.toml", folder / "cycle.toml", load_task, check_task, 0.5),
        Kind("shapes", folder / "shaped/arm.urdf", shapes, share=0.5),
        Kind("an arm's mesh", folder / "shaped/link.obj", lambda path: shapes(path.with_name("arm.urdf")), share=0.3),
        Kind("surroundings", folder / "scene.toml", around, check_boxes, 0.5),
        Kind("srdf", folder / "arm.srdf", lambda path: read_disabled(path, arm), share=0.5),
        Kind("stl", folder / "cube.stl", mesh, check_mesh, 0.5),
        Kind("obj", folder / "cube.obj", mesh, check_mesh, 0.5),
        Kind("ply", folder / "cube.ply", mesh, check_mesh, 0.5),
        Kind("dae", folder / "cube.dae", mesh, check_mesh, 0.5),
        *(Kind(f"scan{end}", folder / f"scan{end}", cloud, check_mesh, 0.3) for end in (".ply", ".pcd", ".npy")),
    ]


def records(folder: Path, arm: ArmModel) -> list[Kind]:
    """Results that other commands take."""
    catalogue = load_catalogue()

    def patch(path: Path) -> tuple[Diagnosed, ArmModel]:
        found = Diagnosed.load(path)
        return found, found.fit_to(arm)

    def question(path: Path) -> object:
        return ask(arm, None, None, path, catalogue)

    def check_question(found: Any) -> None:
        finite("its noise", found.noise)
        finite("a size", *(v for figures in found.reported.values() for v in figures.values()))

    def sealed(path: Path) -> object:
        return open_envelope(path, KEY)

    return [
        Kind("diagnosis.json", folder / "diagnosis.json", patch, check_diagnosed),
        Kind("question.json", folder / "question.json", question, check_question),
        Kind("commands.csv", folder / "commands.csv", lambda path: read_commands(path, arm), check_motions),
        Kind("plan.json", folder / "plan.json", lambda path: read_plan(path, arm), check_motions),
        Kind("envelope", folder / "sealed" / ENVELOPE_NAME, sealed),
    ]


def boards(folder: Path) -> list[Kind]:
    """A public board, what is kept of it, and an entry."""

    def score(path: Path) -> BoardReport:
        return score_board(folder / "board", folder / "entry", folder / "kept")

    def check_score(report: BoardReport) -> None:
        render_board(report.to_dict())
        report.summary()
        as_json(report.to_dict())

    names = ("board/board.json", "board/effects.json", "board/truths.json", "kept/answers.json")
    names += ("entry/s001.json", "entry/s001.parquet", "kept/unseen/s001.parquet")
    return [Kind(f"boards/{name}", folder / name, score, check_score, 0.3) for name in names]


def own_files(folder: Path, arm: ArmModel) -> list[Kind]:
    """A user's own URDF and MJCF, into which something is written."""
    identified = IdentifiedArm.as_urdf(arm)

    def write(path: Path) -> object:
        text, written = write_into(path, read_own_file(path), identified)
        require_loadable(path, text, written)
        return written

    names = ("own.xml", "own.urdf")
    return [Kind(f"own/{name}", folder / name, write, share=0.5, writes=True) for name in names]
