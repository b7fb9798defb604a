"""Files and folders appear whole or not at all."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.files import atomic_folder, atomic_write, sha256_of


def write_half_a_file(target: Path) -> None:
    with atomic_write(target) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt


def write_half_a_folder(target: Path) -> None:
    with atomic_folder(target) as temporary:
        (temporary / "half").write_text("half")
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
        with atomic_folder(target) as temporary:
            (temporary / content).write_text(content)
    assert [entry.name for entry in target.iterdir()] == ["second"]
    with pytest.raises(KeyboardInterrupt):
        write_half_a_folder(target)
    assert [entry.name for entry in target.iterdir()] == ["second"]
    assert list(tmp_path.iterdir()) == [target]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"), atomic_write(tmp_path / "file/below"):
        pass
    with pytest.raises(InputError, match="not a folder"), atomic_folder(tmp_path / "file"):
        pass


def test_the_hash_is_that_of_the_bytes(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"abc")
    assert sha256_of(tmp_path / "file") == hashlib.sha256(b"abc").hexdigest()
