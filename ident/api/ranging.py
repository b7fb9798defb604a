"""Ranges for domain randomisation: what `ident ranges` does."""

from __future__ import annotations

from pathlib import Path

from ident.api.fitting import Model, load_model
from ident.errors import RecordingError
from ident.export.randomised import RANGES_KIND, write_ranges
from ident.monitor.ranges import Ranges, find_ranges
from ident.provenance import Provenance
from ident.recordings.load import TOPIC
from ident.sessions import Robot, Sources, open_sessions

__all__ = ["RANGES_KIND", "ranges"]


def ranges(
    sessions: Sources,
    robot: Robot | None = None,
    *,
    model: Model | None = None,
    out: str | Path | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
) -> Ranges:
    """How far each joint's figures are uncertain, or change from day to day; checked on days left out.

    Args:
        sessions: One for each day, as folders or files of runs.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        model: A fitted model whose inertias are the reference of all days; those of the URDF if None.
        out: Folder for randomisation files of Isaac Lab and MuJoCo Playground.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the filter for torques and columns [Hz].

    Raises:
        InputError: Recordings, robot or model can't be used.
    """
    loaded = None if model is None else load_model(model)
    opened = open_sessions(sessions, robot, topic, session_file, cutoff)
    reference = opened.arm
    if loaded is not None:
        loaded.require_robot(opened.arm, "--model")
        reference = loaded.arm
    days = dict(opened.groups)
    if len(days) < len(opened.groups):
        names = [name for name, _ in opened.groups]
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(twice, "two sessions have this name", "give folders of different names")
    found = find_ranges(days, reference)
    if out is not None:
        tables: dict[str, dict[str, tuple[float, float]]] = {joint: {} for joint in found.noise}
        for (joint, name), one in found.ranges.items():
            tables[joint][name] = one.low, one.high
        write_ranges(Path(out), found.robot, tables)
    settings = {"robot": opened.arm.name, "model": None if loaded is None else loaded.robot.name, "cutoff_hz": cutoff}
    return found.with_provenance(Provenance("ident ranges", settings=settings, sessions=opened.stamps))
