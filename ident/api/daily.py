"""A lab's daily work: what the commands new, servo, watch and ranges do."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.checks.inspection import inspect_sessions
from ident.command_options import RangesOptions, WatchOptions
from ident.errors import InputError, RecordingError
from ident.export.controllers import write_ranges
from ident.infer.new_session import NewSession, guess_session, place_of, require_own_guess
from ident.model.hybrid import HybridModel
from ident.monitor.bodies import estimate_bodies
from ident.monitor.pages import write_pages
from ident.monitor.ranges import Ranges, find_ranges
from ident.monitor.watch import Watch, look
from ident.outputs import real_path
from ident.recordings.joint_names import match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.recordings.session_toml import NAME
from ident.results import Provenance, stamp_sessions
from ident.robot.arm import ArmModel
from ident.servos.goal_checks import check_log, require_own_goals
from ident.servos.goal_runs import load_goals, runs_of
from ident.servos.servo_fit import ServoArm, fit_servos
from ident.servos.told_runs import told_runs
from ident.sessions import Robot, Sources, load_robot, open_sessions

if TYPE_CHECKING:
    from ident.servos.rolled_out import RolledOut


def new(
    session: str | Path, robot: str | Path | ArmModel | None = None, *, rate: float | None = None
) -> NewSession:
    """Looks at foreign tables and writes the session.toml that makes a session of them, for a
    person to correct.

    Args:
        session: Folder of tables, a single table, a bag or a data set.
        robot: URDF path, name or arm; without it signs, gains and columns without names can't be
            found.
        rate: Samples a second of tables without a time column, where nothing in them tells it [Hz].

    Raises:
        InputError: The tables can't be read or recognised, or something of the user's stands where
            the file is to go.
    """
    path = Path(session)
    require_own_guess(place_of(path))
    arm = None if robot is None else load_robot(robot, ())
    named = None if robot is None or isinstance(robot, ArmModel) else str(robot)
    if rate is not None and not 0.0 < rate < float("inf"):
        raise InputError("--rate", f"{rate:g} is no rate", "give samples a second, such as 100")
    guessed = guess_session(path, arm, named, rate)
    # The guess, tried: the session is read under it, and its telemetry checked.
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / NAME
        draft.write_text(guessed.text, encoding="utf-8")
        read = load_session(path, session_file=draft, with_effort=guessed.has_effort)
    report = inspect_sessions([read], arm)[0] if arm is not None and guessed.has_effort else None
    settings = {"robot": named or (arm.name if arm is not None else None)}
    origin = Provenance("ident new", settings=settings, sessions=stamp_sessions([read]))
    guessed = replace(guessed, report=report, provenance=origin)
    guessed.write()
    return guessed


Goals = str | Path | Session


def servo(
    sessions: Goals | Sequence[Goals],
    robot: Robot | None = None,
    *,
    cutoff: float | None = None,
    out: str | Path | None = None,
) -> ServoArm:
    """Lag, delay, dead band, droop and gain of servos, from goal and position alone; and what these
    can't tell.

    Args:
        sessions: Folders or files of runs with `<joint>/position` and `<joint>/position_command`;
            no effort is needed.
        robot: URDF path, name or arm, for what the joints carry; without it droop and gain are not
            reported.
        cutoff: Corner of the filter for all signals [Hz].
        out: Folder for a model of each joint that rolls out, as files of simulators.

    Raises:
        InputError: Recordings or robot can't be used, or no goal is logged.
    """
    given: Sequence[Goals] = [sessions] if isinstance(sessions, str | Path | Session) else sessions
    checked = [check_log(load_goals(path)) for path in given]
    loaded = [session for session, _ in checked]
    issues = tuple(issue for _, told in checked for issue in told)
    arm = None if robot is None else load_robot(robot, ())
    if arm is not None:
        matched = [match_joints(session, arm.joint_names)[0] for session in loaded]
        arm = arm.keeping(matched[0].joints)
        loaded = []
        for session in matched:
            runs = [run.select(arm.joint_names) for run in session.runs]
            loaded.append(session.replace(runs=runs))
    joints = loaded[0].joints
    for session in loaded[1:]:
        if session.joints != joints:
            what = f"its joints are not those of {loaded[0].name}"
            raise RecordingError(
                str(session.path or session.name), what, "give sessions of one arm together"
            )
    goals = runs_of(loaded, cutoff)
    require_own_goals(goals, str(loaded[0].path or loaded[0].name))
    servos = fit_servos(goals, arm)
    name = arm.name if arm is not None else loaded[0].name
    settings = {"robot": None if arm is None else arm.name, "cutoff_hz": cutoff}
    origin = Provenance("ident servo", settings=settings, sessions=stamp_sessions(loaded))
    rolled: tuple[RolledOut, ...] = ()
    if out is not None:
        from ident.servos.rolled_out import roll_out_servos
        from ident.servos.servo_files import write_servos

        rolled = roll_out_servos(loaded, arm)
        write_servos(Path(out), rolled, [session.name for session in loaded])
    hold = max(run.hold for run in goals)
    curves = told_runs(goals, arm, servos)
    fitted = ServoArm(name, servos, rolled, issues, curves, hold)
    return fitted.with_provenance(origin)


def watch(
    folder: str | Path,
    store: str | Path,
    robot: str | None = None,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
    **options: Any,
) -> Watch:
    """Examines the sessions of a folder that are new, and tells what has changed in any arm since
    the first.

    Args:
        folder: Folders of sessions, or folders of arms that hold such.
        store: Folder of the results: Parquet tables, diagnoses, `index.html` for all arms and a
            page for each.
        robot: URDF path or name; None takes the one named in session.toml.
        progress: Called with how many of the new sessions are done, and of how many.
        options: Fields of `ident.command_options.WatchOptions`: `model`, `diagnosed`, `level`,
            `settle`, `workers` …

    Raises:
        InputError: No session there, a robot or model that can't be used, or a store that armgap
            did not begin.
    """
    chosen = WatchOptions.of("watch", {"robot": robot, **options})
    if robot is not None and load_robot(robot, ()) and Path(robot).is_file():
        robot = str(real_path(robot))  # other processes may stand in another folder
    model = chosen.model and str(real_path(chosen.model))
    if model is not None:
        HybridModel.given(model)
    chosen = replace(chosen, robot=robot, model=model)
    watched = look(Path(folder), Path(store), chosen, progress)
    reading = {"diagnosed": chosen.diagnosed, "level": chosen.level}
    settings = {"folder": str(folder), "robot": robot, "model": model, **reading}
    watched = watched.with_provenance(Provenance("ident watch", settings=settings))
    write_pages(Path(store), watched)
    watched.save(Path(store) / "watch.json")
    return watched


def ranges(sessions: Sources, robot: Robot | None = None, **options: Any) -> Ranges:
    """How far each joint's estimates are uncertain, or change from day to day; checked on days left
    out.

    Args:
        sessions: One for each day, as folders or files of runs.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: Fields of `ident.command_options.RangesOptions`: `model`, `out`, `topic`,
            `session_file`, `cutoff`, `accept`.

    Raises:
        InputError: Recordings, robot or model can't be used.
    """
    chosen = RangesOptions.of("ranges", options)
    loaded = None if chosen.model is None else HybridModel.given(chosen.model)
    opened = open_sessions(
        sessions, robot, chosen.topic, chosen.session_file, chosen.cutoff, accept=chosen.accept
    )
    reference = opened.arm
    if loaded is not None:
        loaded.require_robot(opened.arm, "--model")
        reference = loaded.arm
    days = dict(opened.groups)
    if len(days) < len(opened.groups):
        names = [name for name, _ in opened.groups]
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(
            twice, "two sessions have this name", "give folders of different names"
        )
    measured = find_ranges(days, reference, estimate_bodies)
    if chosen.out is not None:
        tables: dict[str, dict[str, tuple[float, float]]] = {joint: {} for joint in measured.noise}
        for (joint, name), measured_range in measured.ranges.items():
            if joint in tables:
                tables[joint][name] = measured_range.low, measured_range.high
        write_ranges(Path(chosen.out), measured.robot, tables)
    named = None if loaded is None else loaded.robot.name
    settings = {"robot": opened.arm.name, "model": named, "cutoff_hz": chosen.cutoff}
    return measured.with_provenance(
        Provenance("ident ranges", settings=settings, sessions=opened.stamps)
    )
