"""Files and folders that appear whole or not at all, and the hashes that tell one from another."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ident.errors import InputError


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Lends a temporary path in the target's folder; renames it to the target if the block succeeds.

    The temporary file keeps the target's suffix, as some writers choose the format by it.

    Args:
        path: The file to be written; its folder is made if need be.

    Yields:
        The path to write to.

    Raises:
        InputError: The folder can't be written to.
    """
    target = Path(path)
    temporary = _make_temporary(target, folder=False)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Lends a temporary folder beside the target; renames it to the target if the block succeeds.

    A folder that is already there is replaced as a whole, and put back if the rename fails.

    Args:
        path: The folder to be written.

    Yields:
        The folder to write into.

    Raises:
        InputError: The parent folder can't be written to, or the target is a file.
    """
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise InputError(target, "is a file, not a folder", "choose another name for the output folder")
    temporary = _make_temporary(target, folder=True)
    retired = temporary.with_name(temporary.name + ".old")
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        if target.exists():
            os.replace(target, retired)
        try:
            os.replace(temporary, target)
        except OSError:
            if retired.exists():
                os.replace(retired, target)
            raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(retired, ignore_errors=True)


def _make_temporary(target: Path, folder: bool) -> Path:
    """A fresh temporary file or folder next to the target: a rename is atomic only on one file system."""
    prefix, suffix = f".{target.stem}-", f".part{target.suffix}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if folder:
            return Path(tempfile.mkdtemp(prefix=prefix, suffix=suffix, dir=target.parent))
        handle, name = tempfile.mkstemp(prefix=prefix, suffix=suffix, dir=target.parent)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(target, f"can't be written ({reason})", "choose a folder that you may write to") from None
    os.close(handle)
    return Path(name)


def _umask() -> int:
    """The process's umask; temporary files are private, the finished ones should not be."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
