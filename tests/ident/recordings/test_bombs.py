"""Laws of packed files: none is unpacked out of proportion to its size, and no pipe is waited for."""

import json
import os
import sqlite3
from collections.abc import Callable
from functools import partial
from pathlib import Path

import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from backports import zstd
from rosbags.rosbag2 import StoragePlugin

from ident.errors import InputError
from ident.recordings import ros_messages
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.trajectories.files import read_commands
from plan.geometry.clouds import read_points
from tests.ident.foreign import write_bag
from tests.ident.recordings.test_bags import rows_of
from tests.ident.recordings.test_foreign_files import write_old_bag

ROWS = 2_000_000


def parquet(path: Path) -> Path:
    names = ("time", "a/position", "a/effort")
    pq.write_table(pa.table({name: pa.array(np.zeros(ROWS)) for name in names}), path / "run.parquet")
    return path / "run.parquet"


def lying_parquet(path: Path) -> Path:
    """A page of two million values, of which the footer says that they are ten."""
    file = path / "run.parquet"
    names = ("time", "a/position", "a/effort")
    columns = pa.table({name: pa.array(np.zeros(ROWS)) for name in names})
    page = {"use_dictionary": False, "data_page_size": 1 << 30, "max_rows_per_page": ROWS, "row_group_size": ROWS}
    pq.write_table(columns, file, write_statistics=False, store_schema=False, compression="zstd", **page)
    data = file.read_bytes()
    length = int.from_bytes(data[-8:-4], "little")
    begin = len(data) - 8 - length
    said = data[begin:-8].replace(varint(ROWS, 4), varint(10, 4))
    file.write_bytes(data[:begin] + said + data[-8:])
    assert pq.ParquetFile(file).metadata.num_rows == 10
    return file


def varint(number: int, length: int) -> bytes:
    """A whole number as Thrift's compact protocol writes it, in so many bytes."""
    number <<= 1
    digits = [number >> 7 * place & 127 for place in range(length)]
    return bytes([*(digit | 128 for digit in digits[:-1]), digits[-1]])


def commands(path: Path) -> Path:
    return parquet(path).rename(path / "commands.parquet")


def data_set(path: Path) -> Path:
    (path / "meta").mkdir()
    (path / "data").mkdir()
    (path / "meta/info.json").write_text(json.dumps({"features": {"timestamp": {"dtype": "float32"}}}))
    parquet(path / "data")
    return path


def archive(path: Path) -> Path:
    np.savez_compressed(path / "run.npz", time=np.zeros(ROWS))
    return path / "run.npz"


def ply(path: Path) -> Path:
    head = "ply\nformat ascii 1.0\nelement vertex 900000000\nproperty float x\nproperty float y\nproperty float z\n"
    (path / "scan.ply").write_text(f"{head}end_header\n0 0 0\n")
    return path / "scan.ply"


def pcd(path: Path) -> Path:
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
    packed = np.array([10, 4_000_000_000], dtype="<u4").tobytes()
    (path / "scan.pcd").write_bytes(f"{head}DATA binary_compressed\n".encode() + packed + bytes(10))
    return path / "scan.pcd"


def columns(path: Path) -> Path:
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 9999999\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
    (path / "scan.pcd").write_text(f"{head}DATA ascii\n0 0 0\n")
    return path / "scan.pcd"


@pytest.mark.parametrize("write", [parquet, lying_parquet, commands, data_set, archive, ply, pcd, columns])
def test_what_unpacks_out_of_proportion_is_refused(
    write: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: more than a hundred times the file and more than the limit is refused; the user's variable allows it."""
    monkeypatch.setenv("ARMGAP_MOST_UNPACKED_MB", "1")
    path = write(tmp_path)
    read: Callable[[Path], object] = read_points if path.suffix in (".ply", ".pcd") else load_session
    if path.stem == "commands":
        read = partial(read_commands, arm=ArmModel.load("tm5-900"))
    with pytest.raises(InputError, match=r"unpack to .* or more; ARMGAP_MOST_UNPACKED_MB allows it"):
        read(path)
    if path.suffix == ".npz":
        monkeypatch.setenv("ARMGAP_MOST_UNPACKED_MB", "1000")
        with pytest.raises(InputError, match="position"):
            load_session(path)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, None])
def test_a_chunk_of_a_bag_unpacks_no_further_than_any_writers(
    storage: StoragePlugin | None, run: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: whatever its header says of its size."""
    monkeypatch.setattr(ros_messages, "LARGEST_CHUNK", 1000)
    pack = {"zstd": zstd.compress, "lz4": lz4.frame.compress}
    for name, compress in pack.items():
        with pytest.raises(ValueError, match="unpacks to more"):
            ros_messages.storage_mcap.DECOMPRESSORS[name](compress(bytes(5000)), 100)
    if storage:
        assert len(load_session(write_bag(tmp_path / "bag", rows_of(run), storage)).runs[0]) == len(run)
    else:
        write_old_bag(tmp_path / "run.bag", run)
        assert len(load_session(tmp_path / "run.bag").runs[0]) == len(run)


@pytest.mark.parametrize(
    "sql",
    ["CREATE VIEW more AS SELECT 1", "CREATE TABLE more(a, b BLOB GENERATED ALWAYS AS (zeroblob(1000000000)))"],
)
def test_a_database_that_computes_is_no_bag(sql: str, run: Recording, tmp_path: Path) -> None:
    (path,) = write_bag(tmp_path / "bag", rows_of(run)).glob("*.db3")
    with sqlite3.connect(path) as database:
        database.execute(sql)
    database.close()
    with pytest.raises(InputError, match="more than tables"):
        load_session(tmp_path / "bag")


def test_a_pipe_below_a_data_sets_folder_is_not_waited_for(tmp_path: Path) -> None:
    data_set(tmp_path)
    (tmp_path / "data/run.parquet").unlink()
    os.mkfifo(tmp_path / "data/run.parquet")
    with pytest.raises(InputError, match="a device or a pipe"):
        load_session(tmp_path)
