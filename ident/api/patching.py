"""Writes what a diagnosis named for simulators: what `ident patch` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.api.diagnosing import Catalogue, gather_effects
from ident.diagnosis.result import Diagnosis
from ident.effects.base import Effect
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.write import open_heldout, write_patch
from ident.provenance import Provenance
from ident.recordings.load import TOPIC
from ident.results import Result
from ident.sessions import Robot, Sources, load_robot


@dataclass(frozen=True, eq=False)
class Written(Result):
    """Files of an identified arm.

    Attributes:
        folder: Where they lie.
        record: What `patch.json` or `export.json` holds.
    """

    SHOWN_BY = "ident.export.printing"

    folder: Path
    record: Mapping[str, Any]

    def to_dict(self) -> dict[str, Any]:
        return {**self.record, "provenance": self.provenance.to_dict()}


def patch(
    diagnosis: Diagnosis | Mapping[str, Any] | str | Path,
    robot: Robot,
    out: str | Path,
    *,
    on: Sources | None = None,
    into: str | Path | None = None,
    catalogue: Catalogue | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
) -> Written:
    """The named effects as URDF, MJCF, parameter file and Python module, each loaded back.

    Args:
        diagnosis: A diagnosis, its record, or the file of `ident diagnose --json`.
        robot: The robot that was diagnosed.
        out: Folder of the patch.
        on: Recordings to measure it on.
        into: Your own MJCF of this arm: a copy of it gets what was found.
        catalogue: Further effects that the diagnosis may name, or a Python file with them (which is run).
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.

    Raises:
        InputError: The diagnosis names nothing or is of another robot, or the folder holds something else.
    """
    diagnosed, arm = _diagnosed(diagnosis, gather_effects(catalogue)), load_robot(robot, ())
    opened = None if on is None else open_heldout(on, arm, diagnosed, topic, session_file)
    settings = {"diagnosis": diagnosed.path.name, "robot": arm.name}
    origin = Provenance("ident patch", settings=settings, sessions=() if opened is None else opened.stamps)
    motions = () if opened is None else opened.motions
    record = write_patch(diagnosed, arm, Path(out), motions, origin, None if into is None else Path(into))
    return Written(Path(out), record, provenance=origin)


def _diagnosed(diagnosis: Diagnosis | Mapping[str, Any] | str | Path, effects: Sequence[Effect]) -> Diagnosed:
    if isinstance(diagnosis, str | Path):
        return Diagnosed.load(Path(diagnosis), effects)
    if isinstance(diagnosis, Diagnosis):
        return Diagnosed.of_record(diagnosis.to_dict(), effects)
    if isinstance(diagnosis, Mapping):
        return Diagnosed.of_record(dict(diagnosis), effects)
    what = f"a {type(diagnosis).__name__} is no diagnosis"
    raise InputError("diagnosis", what, "give a Diagnosis, its record or its JSON file")
