"""Ranges for domain randomisation: what `ident ranges` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ident.api.fitting import load_model
from ident.errors import RecordingError
from ident.export.controllers import RANGES_KIND, write_ranges
from ident.monitor.ranges import Ranges, find_ranges
from ident.options import RangesOptions
from ident.provenance import Provenance
from ident.sessions import Robot, Sources, open_sessions

__all__ = ["RANGES_KIND", "ranges"]


def ranges(sessions: Sources, robot: Robot | None = None, **options: Any) -> Ranges:
    """How far each joint's figures are uncertain, or change from day to day; checked on days left out.

    Args:
        sessions: One for each day, as folders or files of runs.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: Fields of `ident.options.RangesOptions`: `model`, `out`, `topic`, `session_file`, `cutoff`.

    Raises:
        InputError: Recordings, robot or model can't be used.
    """
    chosen = RangesOptions.of("ranges", options)
    loaded = None if chosen.model is None else load_model(chosen.model)
    opened = open_sessions(sessions, robot, chosen.topic, chosen.session_file, chosen.cutoff)
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
    if chosen.out is not None:
        tables: dict[str, dict[str, tuple[float, float]]] = {joint: {} for joint in found.noise}
        for (joint, name), one in found.ranges.items():
            tables[joint][name] = one.low, one.high
        write_ranges(Path(chosen.out), found.robot, tables)
    named = None if loaded is None else loaded.robot.name
    settings = {"robot": opened.arm.name, "model": named, "cutoff_hz": chosen.cutoff}
    return found.with_provenance(Provenance("ident ranges", settings=settings, sessions=opened.stamps))
