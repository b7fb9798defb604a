"""Files and folders appear whole or not at all; compiled loops' code is kept in a cache that is the user's alone."""

import os
from pathlib import Path

import numba
import numpy as np
import pytest

from ident import files
from ident.compiled import compiled
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write, deliver
from ident.outputs import MARKER, begin_folder, check_outputs
from ident.user_cache import user_cache


def write_half_a_file(target: Path, folder: bool = False) -> None:
    with atomic_folder(target, "model") if folder else atomic_write(target) as temporary:
        (temporary / "half" if folder else temporary).write_text("half")
        raise KeyboardInterrupt


def test_a_file_appears_when_the_block_succeeds(tmp_path: Path) -> None:
    target = tmp_path / "new/folder/file.json"
    with atomic_write(target) as temporary:
        assert temporary.suffix == ".json"
        assert temporary.parent == target.parent
        temporary.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_a_failed_block_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "file"
    target.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_half_a_file(target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_is_replaced_as_a_whole(tmp_path: Path) -> None:
    target = tmp_path / "model"
    for content in ("first", "second"):
        with atomic_folder(target, "model") as temporary:
            (temporary / content).write_text(content)
    assert sorted(entry.name for entry in target.iterdir()) == [MARKER, "second"]
    with pytest.raises(KeyboardInterrupt):
        write_half_a_file(target, folder=True)
    assert sorted(entry.name for entry in target.iterdir()) == [MARKER, "second"]
    assert list(tmp_path.iterdir()) == [target]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"), atomic_write(tmp_path / "file/below"):
        pass
    with pytest.raises(InputError, match="not a folder"), atomic_folder(tmp_path / "file", "model"):
        pass


def write(target: Path, kind: str = "model", content: str = "new") -> None:
    with atomic_folder(target, kind) as temporary:
        (temporary / "file").write_text(content)


def test_a_folder_with_anything_of_the_users_stays(tmp_path: Path) -> None:
    """Law: only a folder that armgap wrote, and nobody changed since, is replaced."""
    target = tmp_path / "model"
    target.mkdir()
    write(target)  # an empty one is nobody's
    write(target, content="again")
    (target / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"'notes\.txt', which armgap did not write"):
        write(target)
    (target / "notes.txt").unlink()
    (target / "file").write_text("edited")
    with pytest.raises(InputError, match="changed since"):
        write(target)
    assert (target / "file").read_text() == "edited"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["model"]


def test_another_kind_of_result_stays(tmp_path: Path) -> None:
    write(tmp_path / "there", "session")
    with pytest.raises(InputError, match="holds a session, not a model"):
        write(tmp_path / "there", "model")


@pytest.mark.parametrize("marker", ["", "[]", '{"schema": "armgap.folder/1"}', "[" * 100_000, '{"files": {}}'])
def test_a_marker_that_is_none_protects(tmp_path: Path, marker: str) -> None:
    """Law: a folder is the user's unless its marker says otherwise, whatever stands in the marker's place."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / MARKER).write_text(marker)
    with pytest.raises(InputError, match="did not write"):
        write(tmp_path / "own")


def test_links_and_the_folder_one_stands_in_are_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "model")
    (tmp_path / "link").symlink_to(tmp_path / "model")
    with pytest.raises(InputError, match="is a link"):
        write(tmp_path / "link")
    monkeypatch.chdir(tmp_path / "model")
    with pytest.raises(InputError, match="name a new folder"):
        write(Path("."))
    for place in (tmp_path / "link", Path(os.devnull), tmp_path):
        with pytest.raises(InputError, match="not a plain file"), atomic_write(place):
            pass
    assert not Path(os.devnull).is_file()


def test_between_two_versions_a_folder_is_never_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: whoever looks at any moment sees the old folder or the new one."""
    target = tmp_path / "model"
    write(target, content="old")
    seen = []

    def look(source: Path, destination: Path) -> None:
        rename(source, destination)
        seen.append(target.exists())

    rename = os.replace
    monkeypatch.setattr(files.os, "replace", look)
    write(target)
    assert all(seen)
    assert (target / "file").read_text() == "new"


def test_what_a_living_process_writes_stays(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "file") as first:
        first.write_text("one")
        with atomic_write(tmp_path / "file") as second:
            second.write_text("two")
        assert first.exists()
    assert (tmp_path / "file").read_text() == "one"


def test_a_failure_leaves_no_new_folders(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_half_a_file(tmp_path / "a/b/c")
    assert not list(tmp_path.iterdir())


def test_a_result_that_cannot_be_written_takes_nothing_with_it() -> None:
    """Law: results are written before anything is shown, and all of them are tried."""
    done: list[str] = []

    def fail() -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        deliver(lambda: done.append("shown"), fail, lambda: done.append("written"))
    assert done == ["written", "shown"]


def test_devices_links_folders_and_pipes_are_no_places_for_files(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe")
    for place in (Path("/dev/null"), Path("/dev/stdout"), tmp_path, tmp_path / "link", tmp_path / "pipe"):
        with pytest.raises(InputError, match="not a plain file"):
            check_outputs(files={"--json": place})


def test_what_is_read_is_not_written(tmp_path: Path) -> None:
    """Law: an output is no input of the same command, by whatever path, nor a folder around one."""
    session = tmp_path / "logs/session"
    with atomic_folder(session, "session") as part:
        (part / "run.csv").write_text("time")
    (tmp_path / "other").symlink_to(session)
    for place in (session, tmp_path / "other", tmp_path / "logs", tmp_path / "logs/../logs/session"):
        with pytest.raises(InputError, match="read by the same command"):
            check_outputs([tmp_path / "other"], folders={"--mend": (place, "session")})
    diagnosis = tmp_path / "d.json"
    diagnosis.write_text('{"schema": "ident.diagnosis/1"}')
    with pytest.raises(InputError, match="read by the same command"):
        check_outputs([diagnosis], {"--json": diagnosis})


def test_two_outputs_have_two_places(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="also what --html writes"):
        check_outputs(files={"--json": tmp_path / "x", "--html": tmp_path / "y/../x"})
    with pytest.raises(InputError, match="also what --out writes"):
        check_outputs(files={"--json": tmp_path / "m/x.json"}, folders={"--out": (tmp_path / "m", "model")})


def test_a_place_that_cannot_be_written_is_told_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file/x.json", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match=r"can't be written|too long"):
            check_outputs(files={"--json": place})


def test_a_folder_that_grows_is_taken_up_by_its_kind_alone(tmp_path: Path) -> None:
    begin_folder(tmp_path / "a", "training")
    begin_folder(tmp_path / "a", "training")
    with pytest.raises(InputError, match="something else"):
        begin_folder(tmp_path / "a", "check")
    (tmp_path / "b").mkdir()
    (tmp_path / "b/mine").write_text("")
    with pytest.raises(InputError, match="something else"):
        begin_folder(tmp_path / "b", "training")
    with pytest.raises(InputError, match="did not write"), atomic_folder(tmp_path / "a", "training"):
        pass


def test_nothing_is_kept_where_others_may_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: the cache is this user's alone: neither a folder of others, nor one open to them, nor a link."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path / "armgap"
    assert (tmp_path / "armgap").stat().st_mode & 0o777 == 0o700
    (tmp_path / "armgap").chmod(0o777)
    assert user_cache() is None
    monkeypatch.setattr("os.geteuid", lambda: 54321)
    (tmp_path / "armgap").chmod(0o700)
    assert user_cache() is None
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "links"))
    (tmp_path / "links").mkdir()
    (tmp_path / "links/armgap").symlink_to(tmp_path / "armgap")
    assert user_cache() is None


def total(values: np.ndarray) -> float:
    found = 0.0
    for value in values:
        found += value
    return found


@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_code_is_kept_in_a_private_cache_or_nowhere(mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: of a read-only installation it is kept in a cache that is the user's alone; where others may write, or no
    folder can be made, it runs all the same and nothing is kept. numba's own setting is as it was."""
    (tmp_path / "armgap").mkdir()
    (tmp_path / "armgap").chmod(mode)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda *_: False)
    before = numba.config.CACHE_DIR
    assert compiled()(total)(np.arange(4.0)) == 6.0
    assert before == numba.config.CACHE_DIR
    assert bool(list((tmp_path / "armgap").rglob("*.nbi"))) == (mode == 0o700)
