"""Position-only arms: what `ident servo` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ident.errors import RecordingError
from ident.provenance import Provenance, stamp_sessions
from ident.recordings.joint_names import match_joints
from ident.recordings.recording import Session
from ident.servos.servo_fit import ServoArm, fit_servos, load_goals, runs_of
from ident.sessions import Robot, load_robot

Goals = str | Path | Session


def servo(
    sessions: Goals | Sequence[Goals],
    robot: Robot | None = None,
    *,
    cutoff: float | None = None,
) -> ServoArm:
    """Lag, delay, dead band, droop and gain of servos, from goal and position alone; and what these can't tell.

    Args:
        sessions: Folders or files of runs with `<joint>/position` and `<joint>/position_command`; no effort is needed.
        robot: URDF path, name or arm, for what the joints carry; without it droop and gain are not told.
        cutoff: Corner of the filter for all signals [Hz].

    Raises:
        InputError: Recordings or robot can't be used, or no goal is logged.
    """
    given: Sequence[Goals] = [sessions] if isinstance(sessions, str | Path | Session) else sessions
    loaded = [load_goals(path) for path in given]
    arm = None if robot is None else load_robot(robot, ())
    if arm is not None:
        matched = [match_joints(session, arm.joint_names)[0] for session in loaded]
        arm = arm.keeping(matched[0].joints)
        loaded = [session.replace(runs=[run.select(arm.joint_names) for run in session.runs]) for session in matched]
    joints = loaded[0].joints
    for session in loaded[1:]:
        if session.joints != joints:
            what = f"its joints are not those of {loaded[0].name}"
            raise RecordingError(str(session.path or session.name), what, "give sessions of one arm together")
    found = fit_servos(runs_of(loaded, cutoff), arm)
    name = arm.name if arm is not None else loaded[0].name
    settings = {"robot": None if arm is None else arm.name, "cutoff_hz": cutoff}
    origin = Provenance("ident servo", settings=settings, sessions=stamp_sessions(loaded))
    return ServoArm(name, found).with_provenance(origin)
