"""Recordings and sessions -> files in the native form."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import tomli_w

from ident.errors import RecordingError
from ident.files import atomic_folder, atomic_write, require_plain_header
from ident.outputs import SESSION_KIND
from ident.recordings.columns import TIME
from ident.recordings.recording import Recording, Session
from ident.recordings.session_toml import NAME


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes a run in native columns, as Parquet or CSV by the path's suffix.

    The effort is written as it is held, drive gain and sign applied; both formats give back the
    same numbers.

    Raises:
        RecordingError: Another suffix.
    """
    path = Path(path)
    if path.suffix not in (".parquet", ".csv"):
        raise RecordingError(
            path, f"can't write {path.suffix!r}", "choose a name that ends in .parquet or .csv"
        )
    if path.suffix == ".csv":
        require_plain_header(recording.joints, path)
    columns = {TIME: recording.time}
    for channel, values in recording.channels().items():
        columns.update(
            {f"{joint}/{channel}": values[:, index] for index, joint in enumerate(recording.joints)}
        )
    table = pa.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    with atomic_write(path) as temporary:
        if path.suffix == ".parquet":
            import pyarrow.parquet as pq  # slow to load

            pq.write_table(table, temporary, compression="zstd")
        else:
            pacsv.write_csv(table, temporary)


def write_session(session: Session, folder: str | Path) -> None:
    """Writes a folder of Parquet runs and their session.toml, whole or not at all.

    Drive gains and effort signs are not written: they are in the effort already.

    Args:
        session: The recordings.
        folder: Where to write them; each run is `<name>.parquet`.
    """
    with atomic_folder(folder, SESSION_KIND) as temporary:
        fill_session(session, temporary)


def fill_session(session: Session, folder: Path) -> None:
    """Writes the files of a session into a folder that is there.

    Each run as `<name>.parquet`, and session.toml where there is anything to say in it.
    """
    for run in session.runs:
        write_recording(run, folder / f"{run.name}.parquet")
    settings: dict[str, Any] = dict(session.metadata)
    body = None if session.payload is None else asdict(session.payload)
    of_recording = {
        "robot": session.robot,
        "effort_kind": session.effort_kind,
        "payload": body,
        "gravity_mps2": session.gravity,
    }
    settings |= {key: value for key, value in of_recording.items() if value is not None}
    if settings:
        (folder / NAME).write_text(tomli_w.dumps(settings), encoding="utf-8")
