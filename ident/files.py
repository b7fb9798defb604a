"""Files and folders that appear whole or not at all, and never in the place of the user's own."""

from __future__ import annotations

import ctypes
import errno
import os
import secrets
import shutil
import socket
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from ident.errors import InputError
from ident.outputs import (
    STANDARD_OUTPUT,
    absolute,
    require_own_folder,
    require_plain,
    unwritable,
    write_marker,
)
from ident.records import as_json

# Of Linux's renameat2: paths are as the process sees them; both names change places in one step.
AT_FDCWD = -100
RENAME_EXCHANGE = 2
# How formulas of spreadsheets begin.
FORMULAS = ("=", "+", "-", "@", "\t", "\r")
# Ending of what was there before, while a new folder takes its place without an exchange.
RETIRED = ".old"
# The system's own faults: full disks and quotas, broken devices, no handles or memory left. No
# other name helps.
FAULTS = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EFBIG,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
)
HOST = f"{zlib.crc32(socket.gethostname().encode()):08x}"


class WithoutBytecode(SourceFileLoader):
    """Loads a Python file and leaves nothing beside it."""

    def set_data(self, path: str, data: Any, *, _mode: int = 0o666) -> None:
        """Where Python would write its bytecode."""


def run_python(path: Path, name: str) -> ModuleType:
    """Runs a Python file as a module of a name, and leaves nothing beside it.

    The module does not stay in `sys.modules`, whether the file ran to its end or not.

    Raises:
        Exception: Whatever the file raises.
    """
    loader = WithoutBytecode(name, str(path))
    spec = spec_from_loader(name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    # Dataclasses look their module up while it is being made; a second file must not find the first
    # one's.
    sys.modules[name] = module
    try:
        loader.exec_module(module)
    finally:
        del sys.modules[name]
    return module


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Lends a temporary path in the target's folder; renames it to the target if the block
    succeeds.

    The temporary file keeps the target's suffix, as some writers choose the format by it. What
    processes that were killed left behind for the same target is cleared.

    Args:
        path: The file to be written; its folder is made if need be.

    Yields:
        The path to write to.

    Raises:
        InputError: The folder can't be written to, or the target is a device, a link or a folder.
    """
    target = absolute(path)
    require_plain(target)
    with _parents(target):
        temporary = _make_temporary(target, folder=False)
        try:
            yield temporary
            temporary.chmod(0o666 & ~_umask())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path, kind: str) -> Iterator[Path]:
    """Lends a temporary folder beside the target; puts it in the target's place if the block
    succeeds.

    The folder gets a marker that lists its files. Only an earlier folder of the same kind that
    holds nothing else is replaced, as a whole and in one step where the system can exchange two
    names.

    Args:
        path: The folder to be written.
        kind: Kind of result, such as `model`.

    Yields:
        The folder to write into.

    Raises:
        InputError: The parent folder can't be written to, or the target holds what armgap did not
            write.
    """
    target = absolute(path)
    require_own_folder(target, kind)
    with _parents(target):
        temporary = _make_temporary(target, folder=True)
        try:
            yield temporary
            write_marker(temporary, kind)
            temporary.chmod(0o777 & ~_umask())
            _put_in_place(temporary, target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def require_plain_header(names: Iterable[str], where: str | Path) -> None:
    """Passes if no name would be a formula where a text table is opened by a spreadsheet.

    Raises:
        InputError: One begins as formulas do.
    """
    formula = next((name for name in names if name.startswith(FORMULAS)), None)
    if formula is not None:
        what = f"a column would be called {formula!r}, which a spreadsheet runs as a formula"
        raise InputError(where, what, "rename the joint, or write .parquet")


def write_record(path: str | Path | None, record: Mapping[str, Any]) -> None:
    """Writes a record as JSON, whole or not at all; `-` prints it, and None writes nothing.

    Args:
        path: The file; "-" prints it, None writes nothing.
        record: What JSON knows; a number that is not finite becomes null.
    """
    if path is None:
        return
    text = as_json(record)
    if Path(path) == STANDARD_OUTPUT:
        print(text)
        return
    with atomic_write(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def deliver(show: Callable[[], object], *writes: Callable[[], object]) -> None:
    """Writes results, then shows them. One that can't be written takes neither the others nor the
    print with it.

    Raises:
        OSError, InputError: The first that a write raised, after everything else was done.
    """
    failed: list[Exception] = []
    for write in writes:
        try:
            write()
        except (OSError, InputError) as error:
            failed.append(error)
    show()
    if failed:
        raise failed[0]


def clear_temporaries(target: Path) -> None:
    """Removes what dead processes of this machine left behind while they wrote a target."""
    beginning = f".{_short(target)}.armgap-{HOST}-"
    try:
        left = [entry for entry in target.parent.iterdir() if entry.name.startswith(beginning)]
    except OSError:
        return
    for entry in left:
        process = entry.name.removeprefix(beginning).partition("-")[0]
        if process.isdecimal() and not _is_alive(int(process)):
            if entry.name.endswith(RETIRED) and not os.path.lexists(target):
                os.replace(entry, target)  # killed between two renames: this is the only copy
            elif entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                with suppress(OSError):
                    entry.unlink()


def _put_in_place(temporary: Path, target: Path) -> None:
    """Renames a folder to its target; what was there has the temporary name afterwards."""
    if not target.exists():
        os.replace(temporary, target)
    elif not _exchange(temporary, target):
        retired = temporary.with_name(temporary.name + RETIRED)
        os.replace(target, retired)
        try:
            os.replace(temporary, target)
        except OSError:
            os.replace(retired, target)
            raise
        shutil.rmtree(retired, ignore_errors=True)


def _exchange(first: Path, second: Path) -> bool:
    """Lets two names change places in one step; False where the system can't."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    return bool(
        rename(AT_FDCWD, os.fsencode(first), AT_FDCWD, os.fsencode(second), RENAME_EXCHANGE) == 0
    )


@contextmanager
def _parents(target: Path) -> Iterator[None]:
    """Makes the target's folder, and takes it away again if nothing came of it."""
    made: list[Path] = []
    folder = target.parent
    while not os.path.lexists(folder):
        made.append(folder)
        folder = folder.parent
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise (error if error.errno in FAULTS else unwritable(target, error)) from None
    try:
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise


def _make_temporary(target: Path, folder: bool) -> Path:
    """A fresh temporary file or folder next to the target: a rename is atomic only on one file
    system.
    """
    clear_temporaries(target)
    ending = ".part" + ("" if folder else target.suffix[:16])
    name = f".{_short(target)}.armgap-{HOST}-{os.getpid()}-{secrets.token_hex(4)}{ending}"
    temporary = target.with_name(name)
    try:
        if folder:
            temporary.mkdir(mode=0o700)
        else:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    except OSError as error:
        raise (error if error.errno in FAULTS else unwritable(target, error)) from None
    return temporary


def _short(target: Path) -> str:
    """The beginning of a target's name, so that the temporary's is not too long for the file
    system.
    """
    return os.fsdecode(os.fsencode(target.stem)[:100])


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _umask() -> int:
    """The process's umask; temporary files are private, the finished ones should not be."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
