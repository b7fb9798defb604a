"""No command writes over what the user owns, or reads itself."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.files import atomic_folder
from ident.outputs import begin_folder, check_outputs, require_own_file


@pytest.mark.parametrize("content", ["mine", '{"name": "package"}', "# notes on ident", "\x00\x01"])
def test_a_file_of_the_users_stays(tmp_path: Path, content: str) -> None:
    (tmp_path / "file").write_text(content)
    with pytest.raises(InputError, match="armgap did not write"):
        require_own_file(tmp_path / "file")


@pytest.mark.parametrize("content", ["", '{\n "schema": "ident.fit/1",\n', '{\n "schema": "plan.result/1",\n'])
def test_a_result_of_ours_may_be_replaced(tmp_path: Path, content: str) -> None:
    (tmp_path / "file").write_text(content)
    require_own_file(tmp_path / "file")


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
