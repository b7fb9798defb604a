"""Files of a board and of what its maker keeps: written with nothing in them that tells a truth.

BOARD/README.md              what the board is and how to enter
BOARD/board.json             sessions, their arms and tiers
BOARD/effects.json           the published list of effects, with their parameters
BOARD/truths.json            SHA-256 of each salted answer
BOARD/sessions/s001/         runs, robot.urdf, session.toml
BOARD/before/s001/           runs of the same arm before, of sessions on real recordings
BOARD/unseen/s001.parquet    a motion whose torque is to be foretold, without it
KEPT/answers.json            seed, salts and answers
KEPT/unseen/s001.parquet     the torque of that motion
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.benchmark.board.sealing import check_seals
from ident.errors import InputError
from ident.files import atomic_write
from ident.recordings.parquet import column_numbers, load_columns
from ident.recordings.recording import Recording
from ident.records import JsonRecord, JsonTable
from ident.safe_read import read_record
from ident.schemas.check import require_record

SCHEMA = "ident.board/1"
KEPT_SCHEMA = "ident.board_kept/1"
EFFECTS_SCHEMA = "ident.board_effects/1"
TRUTHS_SCHEMA = "ident.board_truths/1"
BOARD_FILE = "board.json"
EFFECTS_FILE = "effects.json"
TRUTHS_FILE = "truths.json"
ANSWERS_FILE = "answers.json"
SESSIONS = "sessions"
BEFORE = "before"
UNSEEN = "unseen"
URDF_FILE = "robot.urdf"
SESSION_FILE = "session.toml"
SESSION_TEXT = 'robot = "robot.urdf"\n'
SENT = ("position", "velocity", "effort", "temperature")
"""Channels of a session."""
# Bits of a number's fraction that are kept of what is no position: noise is far above the rest.
KEPT_BITS = 11
MAKE = "make a board: ident board make DIR --seed S"
# A session's name becomes the name of files: it leads nowhere else.
NAME = re.compile(r"s[0-9]{1,9}")


def packed(values: Array, bits: int = 23) -> Array:
    """Numbers of single precision, of whose fraction so many bits are kept: the rest are zero.

    Args:
        values: Any numbers.
        bits: Of the 23 of the fraction.
    """
    single = np.ascontiguousarray(values, dtype=np.float32)
    mask = np.uint32(0xFFFFFFFF << (23 - bits) & 0xFFFFFFFF)
    return (single.view(np.uint32) & mask).view(np.float32)


def write_runs(runs: Sequence[Recording], folder: Path) -> None:
    """Writes runs as `run_01.parquet`, `run_02.parquet` and so on into a folder."""
    for number, run in enumerate(runs, start=1):
        write_run(run, folder / f"run_{number:02d}.parquet")


def write_run(run: Recording, path: Path, without: tuple[str, ...] = ()) -> None:
    """Writes a run's channels in native columns.

    Args:
        run: The run.
        path: The .parquet file.
        without: Channels that are left out.
    """
    columns: dict[str, Array] = {"time": packed(run.time)}
    for channel, values in run.channels().items():
        if channel not in SENT or channel in without:
            continue
        bits = 23 if channel == "position" else KEPT_BITS
        for index, joint in enumerate(run.joints):
            columns[f"{joint}/{channel}"] = packed(values[:, index], bits)
    write_columns(columns, path)


def write_columns(columns: Mapping[str, Array], path: Path) -> None:
    """Writes a table whose bytes hang on its numbers alone."""
    table = pa.table(dict(columns))
    with atomic_write(path) as temporary:
        pq.write_table(
            table,
            temporary,
            compression="zstd",
            compression_level=9,
            use_dictionary=False,
            use_byte_stream_split=True,
            write_statistics=False,
            store_schema=False,
        )


def read_columns(path: Path, remedy: str) -> dict[str, Float[Array, " T"]]:
    """Columns of a table by name.

    Raises:
        InputError: No such file, or no table.
    """
    try:
        columns = load_columns(path)
        return {name: column_numbers(cells, name, path) for name, cells in columns.items()}
    except InputError as error:
        raise InputError(path, error.what, remedy) from None


def joint_columns(
    columns: Mapping[str, Array],
    joints: list[str],
    channel: str,
    where: Path,
) -> Float[Array, "T n"]:
    """One channel of all joints.

    Raises:
        InputError: A joint is not there.
    """
    names = [f"{joint}/{channel}" for joint in joints]
    for name in names:
        if name not in columns:
            raise InputError(where, f"it has no column {name!r}", f"give: {', '.join(names)}")
    return np.column_stack([columns[name] for name in names])


@dataclass(frozen=True)
class Board:
    """A board as anybody has it."""

    folder: Path
    sessions: dict[str, JsonRecord]  # by name: tier, arm, joints, before, unseen
    effects: dict[str, JsonRecord]  # the published list by id
    sealed: dict[str, str]  # by session

    @classmethod
    def load(cls, folder: Path) -> Board:
        """Reads a board's folder.

        Raises:
            InputError: It is none, or a session has a name that is none.
        """
        sessions = _read(folder / BOARD_FILE, SCHEMA, "BoardFileRecord")["sessions"]
        effects = _read(folder / EFFECTS_FILE, EFFECTS_SCHEMA, "BoardEffectsRecord")["effects"]
        sealed = _read(folder / TRUTHS_FILE, TRUTHS_SCHEMA, "BoardTruthsRecord")["sealed"]
        _require_sessions(sessions, folder / BOARD_FILE)
        if not effects:
            raise InputError(folder / EFFECTS_FILE, "it lists no effect", MAKE)
        if sealed.keys() != sessions.keys():
            what = f"it seals other sessions than {BOARD_FILE} lists"
            raise InputError(folder / TRUTHS_FILE, what, MAKE)
        return cls(folder, sessions, effects, sealed)

    def arms(self) -> list[dict[str, object]]:
        """Its arms, as a board's results have them: rows of "robot", "joints" and "sessions"."""
        groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
        for name, facts in self.sessions.items():
            groups.setdefault((facts["arm"], tuple(facts["joints"])), []).append(name)
        return [
            {"robot": arm, "joints": list(joints), "sessions": names}
            for (arm, joints), names in groups.items()
        ]

    def session_folder(self, name: str) -> Path:
        """Folder of a session by its name; it need not be there."""
        return self.folder / SESSIONS / name

    def before_folder(self, name: str) -> Path | None:
        """Runs of the same arm before; None where the URDF alone says how it should move."""
        return self.folder / BEFORE / name if self.sessions[name]["before"] else None

    def unseen_file(self, name: str) -> Path:
        """File of the motion that is to be foretold, by the session's name."""
        return self.folder / UNSEEN / f"{name}.parquet"


@dataclass(frozen=True)
class Kept:
    """What a board's maker keeps until the board is opened."""

    folder: Path
    seed: int
    answers: dict[str, JsonRecord]  # by session
    oracle: dict[str, float]  # probability that an oracle names the cause, where worked out

    @classmethod
    def load(cls, folder: Path, board: Board) -> Kept:
        """Reads the answers of a board and checks every seal.

        Raises:
            InputError: No such folder, of another board, or an answer was changed.
        """
        path = folder / ANSWERS_FILE
        record = _read(path, KEPT_SCHEMA, "BoardKeptRecord")
        check_seals(board.sealed, record["salts"], record["answers"], path)
        return cls(folder, int(record["seed"]), record["answers"], record["oracle"])

    def unseen_file(self, name: str) -> Path:
        """File of the torque that was kept back, by the session's name."""
        return self.folder / UNSEEN / f"{name}.parquet"


def kept_folder(board: Path) -> Path:
    """Where a board's maker keeps the answers, if nothing else is said."""
    return board.parent / f"{board.name}.kept"


def _read(path: Path, schema: str, table: str) -> JsonRecord:
    """A file of a board, looked through by its table in the schemas."""
    record = read_record(path, schema, MAKE)
    require_record(record, table, path, MAKE)
    return record


def _require_sessions(sessions: Mapping[str, JsonTable], where: Path) -> None:
    """Passes if there are sessions whose names are those of files, each with joints of its own.

    Raises:
        InputError: There is none, or one that is otherwise.
    """
    if not sessions:
        raise InputError(where, "it lists no session", MAKE)
    for name, facts in sessions.items():
        if not NAME.fullmatch(name):
            raise InputError(where, f"a session is called {name!r}", "call it s001 or so")
        joints = facts["joints"]
        if not joints or len(set(joints)) < len(joints):
            raise InputError(where, f"{name} has no joints, or one twice", MAKE)
