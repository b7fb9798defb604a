"""Which files and folders armgap wrote itself: only those are ever replaced.

A folder of results holds a marker that lists its files with their hashes; a file of results names
armgap in its first bytes. Whatever else stands at a place where a result is to go belongs to the
user and stays.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.records import as_json

MARKER = ".armgap.json"
SCHEMA = "armgap.folder/1"
FILE_SCHEMA = "armgap.file/1"
# The place of a record that is printed instead.
STANDARD_OUTPUT = Path("-")
# Kind of the folders of recordings that armgap writes; other kinds stand where they are written.
SESSION_KIND = "session"
# A marker lists some thousand files at most; a larger one is not ours [bytes].
LARGEST_MARKER = 1 << 24
# How far into a file its mark is looked for [bytes]: Rerun's recordings name their application
# after the header, Parquet files their writer before the end.
HEAD_BYTES = 1 << 12
TAIL_BYTES = 1 << 14
# How the files of results begin, and what they have near there: JSON, HTML, pictures, timelines,
# texts.
MARKS = (
    (b"{", b'"schema": "ident.'),
    (b"{", b'"schema": "plan.'),
    (b"<", b'name="generator" content="armgap'),
    (b"<?xml", b"<dc:title>armgap</dc:title>"),
    (b"\x89PNG", b"Software\x00armgap"),
    (b"RR", b"armgap"),
    (b"# written by armgap", b"armgap"),
    (b"<!-- written by armgap", b"armgap"),
)
# Text that is put into a Parquet file's own notes.
WRITER = {b"writer": b"armgap"}
ELSEWHERE = "choose another place, or remove it yourself"


def write_marker(folder: Path, kind: str) -> None:
    """Lists a finished folder's files in its marker, which makes the folder replaceable by the same
    kind of result.
    """
    below = [path for path in sorted(folder.rglob("*")) if path.name != MARKER]
    names = [path for path in below if path.is_file()]
    files = {
        os.fsencode(path.relative_to(folder)).decode("latin-1"): sha256_of(path) for path in names
    }
    record = {"schema": SCHEMA, "kind": kind, "files": files}
    (folder / MARKER).write_text(as_json(record) + "\n", encoding="utf-8")


def begin_folder(folder: Path, kind: str) -> None:
    """Makes a folder that fills step by step (a check, a checkpoint), or takes up one of the same
    kind.

    Raises:
        InputError: It holds something that armgap did not write, or can't be made.
    """
    try:
        if not _exists(folder) or (
            folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir())
        ):
            folder.mkdir(parents=True, exist_ok=True)
            record = {"schema": SCHEMA, "kind": kind, "files": None}
            (folder / MARKER).write_text(as_json(record, None) + "\n", encoding="utf-8")
            return
        if folder.is_symlink() or not folder.is_dir():
            raise InputError(folder, f"is {_kind_of(folder)}, not a folder", ELSEWHERE)
        if _read_marker(folder).get("kind") != kind:
            raise InputError(
                folder, f"the folder holds something else than a {kind} of armgap", ELSEWHERE
            )
    except OSError as error:
        raise unwritable(folder, error) from None


def end_if_empty(folder: Path) -> None:
    """Takes away a folder that `begin_folder` made, where nothing was written into it."""
    if [entry.name for entry in folder.iterdir()] == [MARKER]:
        (folder / MARKER).unlink()
        folder.rmdir()


def is_begun(folder: Path, kind: str) -> bool:
    """Whether `begin_folder` made this folder."""
    return folder.is_dir() and not folder.is_symlink() and _read_marker(folder).get("kind") == kind


def require_own_folder(folder: Path, kind: str) -> None:
    """Passes if a folder may be written as a whole: nothing is there, or an earlier result of the
    same kind alone.

    Args:
        folder: Where the result is to go.
        kind: Kind of result, such as `model`.

    Raises:
        InputError: Something is there that armgap did not write, or that was changed since.
    """
    try:
        if not _exists(folder):
            return
        if folder.is_symlink() or not folder.is_dir():
            raise InputError(
                folder, f"is {_kind_of(folder)}, not a folder", "choose another name for the folder"
            )
        if os.path.ismount(folder) or Path.cwd().is_relative_to(real_path(folder)):
            raise InputError(
                folder,
                "is a folder that can't be replaced as a whole",
                "name a new folder inside it",
            )
        if not any(folder.iterdir()):
            return
        record = _read_marker(folder)
        if not isinstance(record.get("files"), dict):
            first = min(path.name for path in folder.iterdir())
            raise InputError(folder, f"holds {first!r}, which armgap did not write", ELSEWHERE)
        if record.get("kind") != kind:
            raise InputError(folder, f"holds a {record.get('kind')}, not a {kind}", ELSEWHERE)
        _require_unchanged(folder, record["files"])
    except OSError as error:
        raise unwritable(folder, error) from None


def _require_unchanged(folder: Path, files: Mapping[str, Any]) -> None:
    for path in sorted(folder.rglob("*")):
        name = os.fsencode(path.relative_to(folder)).decode("latin-1")
        if path.is_symlink():
            raise InputError(
                folder, f"holds the link {name!r}, which armgap did not write", ELSEWHERE
            )
        if path.is_dir() or path == folder / MARKER:
            continue
        if name not in files:
            raise InputError(folder, f"holds {name!r}, which armgap did not write", ELSEWHERE)
        if not path.is_file() or sha256_of(path) != files[name]:
            raise InputError(folder, f"its {name!r} was changed since armgap wrote it", ELSEWHERE)


def require_own_file(path: Path) -> None:
    """Passes if a file may be written: nothing is there, or an empty file, or a result of armgap.

    Raises:
        InputError: A device, a link, a folder, or a file of the user's.
    """
    require_plain(path)
    try:
        if path.exists() and path.stat().st_size and not is_own_file(path):
            raise InputError(path, "is a file that armgap did not write", ELSEWHERE)
    except OSError as error:
        raise unwritable(path, error) from None


def require_plain(path: Path) -> None:
    """Passes if nothing or a plain file is at a path.

    Raises:
        InputError: A device, a link or a folder.
    """
    try:
        if _exists(path) and not stat.S_ISREG(path.lstat().st_mode):
            raise InputError(
                path, f"is {_kind_of(path)}, not a plain file", "choose another name for the file"
            )
    except OSError as error:
        raise unwritable(path, error) from None


def mark_file(path: Path) -> None:
    """Writes down beside a file that has no room for a mark, a CSV table, that it is ours as it
    stands now.
    """
    record = {"schema": FILE_SCHEMA, "sha256": sha256_of(path)}
    _mark_of(path).write_text(as_json(record, None) + "\n", encoding="utf-8")


def remove_own_file(path: Path) -> bool:
    """Removes a result of an earlier run, so that none stands as if new; whether there was one of
    ours.
    """
    if not path.is_file() or path.is_symlink() or not is_own_file(path):
        return False
    path.unlink()
    _mark_of(path).unlink(missing_ok=True)
    return True


def _mark_of(path: Path) -> Path:
    return path.with_name(f".{path.name}{MARKER}")


def is_own_file(path: Path) -> bool:
    """Whether a plain file shows the mark of armgap's results, or has an unbroken one beside it."""
    if _read_record(_mark_of(path), FILE_SCHEMA).get("sha256") == sha256_of(path):
        return True
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
        if head.startswith(b"PAR1"):
            stream.seek(-min(TAIL_BYTES, path.stat().st_size), os.SEEK_END)
            tail = stream.read()
            return all(word in tail for pair in WRITER.items() for word in pair)
    return any(head.startswith(begin) and mark in head for begin, mark in MARKS)


def check_outputs(
    inputs: Iterable[str | Path | None] = (),
    files: Mapping[str, Path | None] | None = None,
    folders: Mapping[str, tuple[Path | None, str]] | None = None,
) -> None:
    """Looks at every place where a command will write, before it works: nothing of the user's may
    stand there.

    Args:
        inputs: What the command reads; names that are no paths are passed over.
        files: Option -> file to be written, or None.
        folders: Option -> (folder to be written as a whole, kind of result).

    Raises:
        InputError: A place is not free, can't be written to, is read by the same command, or is
            asked for twice.
    """
    whole = {
        option: (path, kind) for option, (path, kind) in (folders or {}).items() if path is not None
    }
    single = {
        option: path
        for option, path in (files or {}).items()
        if path is not None and path != STANDARD_OUTPUT
    }
    places = {**{option: path for option, (path, _) in whole.items()}, **single}
    # A folder that is filled step by step need not be there yet; a name of a robot is no path.
    named = [entry for entry in inputs if entry is not None]
    read = [Path(entry) for entry in named if isinstance(entry, Path) or _exists(Path(entry))]
    for option, path in places.items():
        place = real_path(path)
        for entry in read:
            source = real_path(entry)
            if place == source or (option in whole and source.is_relative_to(place)):
                raise InputError(
                    f"{option} {path}", "is read by the same command", "choose another place"
                )
        for other, second in places.items():
            another = real_path(second)
            lies_within = other in whole and place.is_relative_to(another)
            if other != option and (place == another or lies_within):
                raise InputError(
                    f"{option} {path}", f"is also what {other} writes", "choose another place"
                )
    for path in single.values():
        require_own_file(path)
    for path, kind in whole.values():
        require_own_folder(absolute(path), kind)
    for path in places.values():
        require_writable(path)


def require_writable(path: Path) -> None:
    """Tries the nearest folder that exists: what can't be written at the end should be told at the
    beginning.

    Raises:
        InputError: It is no folder, or nothing can be made in it.
    """
    folder = absolute(path).parent
    try:
        while not _exists(folder):
            folder = folder.parent
        if not folder.is_dir():
            raise InputError(
                path, f"can't be written ({folder} is not a folder)", "choose a folder"
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, "no permission to write, or a read-only disk")
        longest = os.pathconf(folder, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255
        if len(os.fsencode(path.name)) > longest - 40:
            raise InputError(path, "its name is too long", "choose a shorter one")
    except (OSError, ValueError) as error:
        raise unwritable(path, error) from None


def absolute(path: str | Path) -> Path:
    """A path that has a name and a parent, `.` and `..` too; links stay."""
    return Path(os.path.abspath(path))


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _read_marker(folder: Path) -> dict[str, Any]:
    """The marker of a folder; empty where there is none that can be read."""
    return _read_record(folder / MARKER, SCHEMA)


def _read_record(path: Path, schema: str) -> dict[str, Any]:
    try:
        state = path.lstat()
        if not stat.S_ISREG(state.st_mode) or state.st_size > LARGEST_MARKER:
            return {}
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) and record.get("schema") == schema else {}


def _exists(path: Path) -> bool:
    """Whether there is anything, a broken link too."""
    try:
        return os.path.lexists(path)
    except ValueError:  # a zero byte in the name
        return False


def real_path(path: str | Path) -> Path:
    """Where a path leads; without an error for links that turn in a circle, as `resolve` has it."""
    return Path(os.path.realpath(path))


def _kind_of(path: Path) -> str:
    mode = path.lstat().st_mode
    kinds = ((stat.S_ISLNK, "a link"), (stat.S_ISDIR, "a folder"), (stat.S_ISREG, "a file"))
    return next((name for test, name in kinds if test(mode)), "a device")


def unwritable(path: Path, error: Exception) -> InputError:
    """What tells the user that the system lets nothing be written: for the caller to raise."""
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    return InputError(path, f"can't be written ({reason})", "choose a folder that you may write to")
