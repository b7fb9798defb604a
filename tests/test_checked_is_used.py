"""What was checked is what is used: a file that another one takes the place of, between two looks at it."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import StoragePlugin

from ident.errors import InputError
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.into import is_mjcf, save_into, write_into
from ident.export.own_file import read_own_file
from ident.export.write import write_patch
from ident.infer.guess import read_foreign
from ident.recordings.load import load_session
from ident.results import stamp_sessions
from ident.robot import meshes, pinocchio_model
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.safe_read import CHANGED, read_bytes, read_json, read_toml
from ident.trajectories.files import read_commands
from plan.geometry.clouds import read_points
from plan.geometry.obstacle_files import read_mesh
from tests.fuzz.corpus import JOINTS, ROWS
from tests.fuzz.samples import obj
from tests.ident.export.diagnoses import write_diagnosis
from tests.ident.foreign import write_bag
from tests.ident.recordings.test_bags import rows_of


class Swap:
    """Puts another file in a file's place before it is opened for the second time.

    An audit hook of Python's own, which stays for the life of the process: it is idle where nothing is watched.
    """

    def __init__(self) -> None:
        self.path: Path | None = None
        self.act: Callable[[], None] = lambda: None
        self.opened = 0
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.path is None or event != "open" or os.fspath(self.path) != str(arguments[0]):
            return
        self.opened += 1
        if self.opened == 2:
            self.act()

    @contextmanager
    def watching(self, path: Path, other: bytes) -> Iterator[None]:
        """Swaps while the block lasts."""

        def act() -> None:
            self.path = None
            replace_by(path, other)

        self.path, self.act, self.opened = path, act, 0
        try:
            yield
        finally:
            self.path = None


SWAP = Swap()


def replace_by(path: Path, other: bytes) -> None:
    beside = path.with_name("beside")
    beside.write_bytes(other)
    beside.replace(path)


def table(factor: float) -> pa.Table:
    """A recording, its torque times a factor."""
    run = pq.read_table(Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet").slice(0, ROWS)
    for name in run.column_names:
        if name.endswith("/effort"):
            column = pa.array(factor * run[name].to_numpy())
            run = run.set_column(run.column_names.index(name), name, column)
    return run


def parquet(factor: float, path: Path) -> None:
    pq.write_table(table(factor), path)


def text(factor: float, path: Path) -> None:
    pacsv.write_csv(table(factor), path)


def blanks(factor: float, path: Path) -> None:
    text(factor, path)
    path.write_text(path.read_text().replace(",", " "))


def archive(factor: float, path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, **{name: table(factor)[name].to_numpy() for name in table(factor).column_names})


RECORDINGS = {"run.parquet": parquet, "run.csv": text, "run.txt": blanks, "run.npz": archive}


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.parametrize("read", ["session", "foreign"])
def test_a_recording_is_one_or_the_other(name: str, read: str, tmp_path: Path) -> None:
    """Law: the torque of the file that was looked at comes in, or it is told that the file changed."""
    path, other = tmp_path / name, tmp_path / f"other_{name}"
    RECORDINGS[name](1.0, path)
    RECORDINGS[name](3.0, other)
    if read == "session":
        (tmp_path / "session.toml").write_text("")

    def efforts() -> np.ndarray:
        if read == "session":
            return np.abs(load_session(path).runs[0].effort).max(axis=0)
        columns = read_foreign(path).columns
        return np.array([np.abs(values).max() for values in columns.values()])

    sound = efforts()
    data = other.read_bytes()
    other.unlink()
    what = ""
    with SWAP.watching(path, data):
        try:
            found = efforts()
        except InputError as error:
            what = error.what
            found = sound
    assert what in ("", CHANGED)
    np.testing.assert_array_equal(found, sound)


def test_halves_of_two_recordings_are_told(tmp_path: Path) -> None:
    """Law: a column that one of the two files has and the other lacks is no fault of ours, but a file that changed."""
    path = tmp_path / "run.parquet"
    parquet(1.0, path)
    fewer = tmp_path / "fewer.parquet"
    pq.write_table(table(1.0).drop_columns(["joint_5/effort"]), fewer)
    data = fewer.read_bytes()
    fewer.unlink()
    with SWAP.watching(path, data), pytest.raises(InputError, match="changed while it was read"):
        load_session(path)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_bag_that_changes_while_it_is_read_is_told(
    storage: StoragePlugin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: files of a bag are read by their names, by libraries: another one in the place of one is told."""
    parquet(1.0, tmp_path / "run.parquet")
    recording = load_session(tmp_path / "run.parquet").runs[0]
    bag = tmp_path / "bag"
    write_bag(bag, rows_of(recording), storage)
    (file,) = (path for path in bag.iterdir() if path.suffix in (".db3", ".mcap"))
    from ident.recordings import bags

    taken = bags.merge

    def merge(*arguments: Any) -> Any:
        replace_by(file, file.read_bytes())
        return taken(*arguments)

    assert len(load_session(bag).runs[0]) == len(recording)
    monkeypatch.setattr(bags, "merge", merge)
    with pytest.raises(InputError, match="changed while it was read"):
        load_session(bag)


def test_a_result_names_no_other_file_than_was_read(tmp_path: Path) -> None:
    """Law: a file's hash in a result is of what was read, or nothing is said of it."""
    parquet(1.0, tmp_path / "run.parquet")
    session = load_session(tmp_path / "run.parquet")
    assert stamp_sessions([session])[0].sha256
    parquet(3.0, tmp_path / "run.parquet")
    with pytest.raises(InputError, match="changed since it was read"):
        stamp_sessions([session])


@pytest.mark.parametrize("name", ["a.toml", "a.json", "a.npy", "a.csv"])
def test_small_files_are_opened_once(name: str, tmp_path: Path) -> None:
    """Law: what is checked and what is used are the same bytes, as there is no second look."""
    arm = ArmModel.load("tm5-900")
    stamps = np.arange(0.0, 1.0, 0.01)
    columns = {"time": stamps} | {f"{joint}/position_command": 0.1 * np.sin(stamps) for joint in JOINTS}
    good = {"a.toml": b"a = 1\n", "a.json": b'{"a": 1}'}
    path = tmp_path / name
    path.write_bytes(good.get(name, b""))
    if name == "a.npy":
        np.save(path, np.eye(3))
    if name == "a.csv":
        pacsv.write_csv(pa.table(columns), path)
    readers: dict[str, Callable[[], object]] = {
        "a.toml": lambda: read_toml(path, ""),
        "a.json": lambda: read_json(path, ""),
        "a.npy": lambda: read_points(path),
        "a.csv": lambda: read_commands(path, arm),
    }
    with SWAP.watching(path, b"other"):
        readers[name]()
        assert SWAP.opened == 1


def test_a_file_that_grows_while_it_is_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: a file is read as long as it was when it was opened, and no longer."""
    path = tmp_path / "a.toml"
    path.write_text("a = 1\n")
    measured = os.fstat

    def fstat(descriptor: int) -> os.stat_result:
        status = measured(descriptor)
        with path.open("a") as file:
            file.write("b = 2\n")
        return status

    monkeypatch.setattr(os, "fstat", fstat)
    with pytest.raises(InputError, match="changed while it was read"):
        read_bytes(path, "")


def test_a_pipe_in_a_files_place_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what was a plain file when it was looked at, and is a pipe when it is opened, is told."""
    path = tmp_path / "a.toml"
    path.write_text("a = 1\n")
    opened = os.open

    def put_pipe(name: Path, *arguments: Any) -> int:
        path.unlink()
        os.mkfifo(path)
        return opened(name, *arguments)

    monkeypatch.setattr(os, "open", put_pipe)
    with pytest.raises(InputError, match="a device or a pipe"):
        read_bytes(path, "")


def change_after_the_look(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on a mesh becomes another one as soon as it was looked through."""
    looked = meshes.require_mesh

    def look(*arguments: Any) -> bytes:
        data = looked(*arguments)
        replace_by(path, obj().encode())
        return data

    monkeypatch.setattr(meshes, "require_mesh", look)


def test_a_mesh_that_changes_while_it_is_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: Coal reads a mesh by its name: the mesh that was looked through, or it is told."""
    path = tmp_path / "a.obj"
    path.write_text(obj())
    read_mesh(path, np.ones(3), False)
    change_after_the_look(path, monkeypatch)
    with pytest.raises(InputError, match="changed while it was read"):
        read_mesh(path, np.ones(3), False)


def test_an_arms_mesh_that_changes_while_it_is_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: the same of the meshes that a URDF names, which Pinocchio reads."""
    path = tmp_path / "a.obj"
    path.write_text(obj())
    shape = '<collision><geometry><mesh filename="a.obj"/></geometry></collision>'
    source = tmp_path / "arm.urdf"
    text = Path(data_path("urdf/tm5_900.urdf")).read_text().replace("</link>", f"{shape}</link>", 1)
    arm = ArmModel.from_urdf(text, source)

    def read() -> object:
        return pinocchio_model.read_geometry(arm.model, text, "collision", source, "arm")

    read()
    change_after_the_look(path, monkeypatch)
    with pytest.raises(InputError, match="changed while it was read"):
        read()


def test_the_users_own_file_is_read_once(tmp_path: Path) -> None:
    """Law: what is patched into is what was looked through; nothing written into it since is lost."""
    arm = ArmModel.load("tm5-900")
    path = tmp_path / "own.urdf"
    shutil.copy(data_path("urdf/tm5_900.urdf"), path)
    before = path.read_bytes()
    with SWAP.watching(path, b"<robot/>"):
        data = read_own_file(path)
        assert not is_mjcf(path, data)
        patched, _ = write_into(path, data, IdentifiedArm.as_urdf(arm))
        assert SWAP.opened == 1
    assert data == before
    path.write_bytes(before + b"<!-- of the user's -->")
    with pytest.raises(InputError, match="nothing is written into it"):
        save_into(path, data, patched)
    assert path.read_bytes() == before + b"<!-- of the user's -->"


def test_a_patch_into_a_file_that_changes_meanwhile_leaves_nothing(tmp_path: Path) -> None:
    """Law: the file is what the user made of it, and no folder says that it was patched."""
    arm = ArmModel.load("tm5-900")
    path = tmp_path / "own.urdf"
    shutil.copy(data_path("urdf/tm5_900.urdf"), path)
    write_diagnosis(tmp_path / "diagnosis.json", arm, "payload")
    with SWAP.watching(path, b"<robot/>"), pytest.raises(InputError, match="nothing is written into it"):
        write_patch(Diagnosed.load(tmp_path / "diagnosis.json"), arm, tmp_path / "patch", into=path)
    assert path.read_bytes() == b"<robot/>"
    assert not (tmp_path / "patch").exists()
