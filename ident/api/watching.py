"""Follows arms through time: what `ident watch` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ident.errors import InputError
from ident.monitor.pages import write_pages
from ident.monitor.session_work import WatchOptions
from ident.monitor.watch import Watch, look
from ident.provenance import Provenance


def watch(
    folder: str | Path,
    store: str | Path,
    robot: str | None = None,
    *,
    model: str | Path | None = None,
    diagnosed: bool = True,
    level: float = WatchOptions.level,
    settle: float = WatchOptions.settle,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Watch:
    """Examines the sessions of a folder that are new, and tells what has changed in any arm since the first.

    Args:
        folder: Folders of sessions, or folders of arms that hold such.
        store: Folder of the results: Parquet tables, diagnoses, `index.html` for all arms and a page for each.
        robot: URDF path or name; None takes the one named in session.toml.
        model: A fitted model whose inertias are the reference of all figures.
        diagnosed: Whether each session is diagnosed too.
        level: Chance of any false alarm in an arm's life, however often one looks.
        settle: A session is looked at when nothing was written to it for so long [s].
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler instead.
        progress: Told how many of the new sessions are done.

    Raises:
        InputError: No session there, or a store that armgap did not begin.
    """
    if not 0.0 < level < 1.0:
        raise InputError("--level", f"{level:g} is no chance", "give a number between 0 and 1, such as 0.05")
    if not settle >= 0.0:
        raise InputError("--settle", f"{settle:g} is no time", "give seconds")
    if workers < 1:
        raise InputError("--workers", f"{workers} processes can do nothing", "give 1 or more")
    chosen = None if model is None else str(Path(model).resolve())
    if robot is not None and Path(robot).is_file():
        robot = str(Path(robot).resolve())  # other processes may stand in another folder
    options = WatchOptions(robot, chosen, diagnosed, level, settle, workers, scheduler)
    found = look(Path(folder), Path(store), options, progress)
    settings = {"folder": str(folder), "robot": robot, "model": chosen, "diagnosed": diagnosed, "level": level}
    found = found.with_provenance(Provenance("ident watch", settings=settings))
    write_pages(Path(store), found)
    found.save(Path(store) / "watch.json")
    return found
