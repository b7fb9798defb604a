"""Guesses the settings of foreign recordings: what `ident new` does."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ident.checks.inspection import inspect_sessions
from ident.errors import InputError, RecordingError
from ident.files import atomic_folder
from ident.infer.new_session import NewSession, guess_session, place_of, require_own_guess
from ident.outputs import SESSION_KIND
from ident.provenance import Provenance, stamp_sessions
from ident.recordings.load import load_session
from ident.recordings.session_toml import NAME
from ident.robot.arm import ArmModel


def new(
    session: str | Path, robot: str | Path | ArmModel | None = None, *, tables: Sequence[str | Path] = ()
) -> NewSession:
    """Looks at foreign tables and writes the session.toml that makes a session of them, for a person to correct.

    Args:
        session: Folder of tables, a single table, a bag or a data set; with `tables` a new folder.
        robot: URDF path, name or arm; without it signs, gains and columns without names can't be told.
        tables: Files that are copied into the new folder.

    Raises:
        InputError: The tables can't be read or told, or something of the user's stands where the file is to go.
    """
    path = Path(session)
    if tables:
        with atomic_folder(path, SESSION_KIND) as folder:
            for table in tables:
                _copy(Path(table), folder)
            try:
                found = _guess(folder, robot, path.name)
            except InputError as error:
                raise _of_the_users(error, folder, tables) from None
            (folder / NAME).write_text(found.text, encoding="utf-8")
        return replace(found, file=path / NAME)
    require_own_guess(place_of(path))
    found = _guess(path, robot)
    found.write()
    return found


def _of_the_users(error: InputError, folder: Path, tables: Sequence[str | Path]) -> InputError:
    """An error about a copy that is gone by now, told of the table that was copied."""
    for table in map(Path, tables):
        copy = str(folder / table.name)
        if error.where.startswith(copy):
            return type(error)(f"{table}{error.where.removeprefix(copy)}", error.what, error.remedy)
    return error


def _copy(table: Path, folder: Path) -> None:
    if not table.is_file():
        raise RecordingError(table, "no such file", "give tables that are files")
    if (folder / table.name).exists():
        raise RecordingError(table, "two tables have this name", "rename one")
    shutil.copy2(table, folder / table.name)


def _guess(path: Path, robot: str | Path | ArmModel | None, name: str = "") -> NewSession:
    """The guess, tried: the session is read under it, by the name that it will have, and its telemetry checked."""
    arm = robot if isinstance(robot, ArmModel) or robot is None else ArmModel.load(robot)
    named = None if robot is None or isinstance(robot, ArmModel) else str(robot)
    found = guess_session(path, arm, named)
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / NAME
        draft.write_text(found.text, encoding="utf-8")
        read = load_session(path, session_file=draft)
    read = read.replace(name=name or read.name)
    report = inspect_sessions([read], arm)[0] if arm is not None else None
    settings = {"robot": named or (arm.name if arm is not None else None)}
    origin = Provenance("ident new", settings=settings, sessions=stamp_sessions([read]))
    return replace(found, report=report, provenance=origin)
