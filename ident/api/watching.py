"""Follows arms through time: what `ident watch` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ident.monitor.pages import write_pages
from ident.monitor.watch import Watch, look
from ident.options import WatchOptions
from ident.provenance import Provenance


def watch(
    folder: str | Path,
    store: str | Path,
    robot: str | None = None,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
    **options: Any,
) -> Watch:
    """Examines the sessions of a folder that are new, and tells what has changed in any arm since the first.

    Args:
        folder: Folders of sessions, or folders of arms that hold such.
        store: Folder of the results: Parquet tables, diagnoses, `index.html` for all arms and a page for each.
        robot: URDF path or name; None takes the one named in session.toml.
        progress: Called with how many of the new sessions are done, and of how many.
        options: Fields of `ident.options.WatchOptions`: `model`, `diagnosed`, `level`, `settle`, `workers` …

    Raises:
        InputError: No session there, or a store that armgap did not begin.
    """
    chosen = WatchOptions.of("watch", {"robot": robot, **options})
    # Other processes may stand in another folder.
    if robot is not None and Path(robot).is_file():
        robot = str(Path(robot).resolve())
    model = None if chosen.model is None else str(Path(chosen.model).resolve())
    chosen = replace(chosen, robot=robot, model=model)
    found = look(Path(folder), Path(store), chosen, progress)
    own = {"diagnosed": chosen.diagnosed, "level": chosen.level}
    settings = {"folder": str(folder), "robot": robot, "model": model, **own}
    found = found.with_provenance(Provenance("ident watch", settings=settings))
    write_pages(Path(store), found)
    found.save(Path(store) / "watch.json")
    return found
