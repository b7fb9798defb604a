"""Boards and entries of strangers: what is no board is told in a line, and no name leads out of a folder."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from jsonschema import Draft202012Validator
from made_up_board import JOINTS, write_board

from ident.benchmark.board import jobs
from ident.benchmark.board.case import DRAWN
from ident.benchmark.board.files import Board
from ident.benchmark.board.jobs import run_job
from ident.benchmark.board.make import MadeBoard
from ident.benchmark.board.report import score_board
from ident.command_options import BoardOptions
from ident.errors import InputError
from ident.safe_read import read_json
from ident.schemas.check import require_record
from ident.schemas.publish import make_schema
from tests.fuzz.spoil import change_json

Record = dict[str, Any]
Change = Callable[[Record], object]
CHANGES: dict[str, tuple[str, Change, str]] = {
    "no sessions": ("board", lambda record: record.pop("sessions"), "it lacks sessions"),
    "an empty list": ("board", lambda record: record["sessions"].clear(), "lists no session"),
    "a list": ("board", lambda record: record.update(sessions=[]), "sessions is"),
    "no facts": ("board", lambda record: record["sessions"].update(s001=1), "sessions.s001 is 1"),
    "no joints": ("board", lambda record: record["sessions"]["s001"].update(joints=[]), "no joints"),
    "a joint twice": (
        "board",
        lambda record: record["sessions"]["s001"].update(joints=["a", "a"]),
        "one twice",
    ),
    "another tier": (
        "board",
        lambda record: record["sessions"]["s001"].update(tier="x"),
        "sessions.s001.tier is 'x'",
    ),
    "a truth value": (
        "board",
        lambda record: record["sessions"]["s001"].update(before=0),
        "sessions.s001.before is 0",
    ),
    "no effects": ("effects", lambda record: record["effects"].clear(), "lists no effect"),
    "no scope": (
        "effects",
        lambda record: record["effects"]["payload"].pop("scope"),
        "it lacks effects.payload.scope",
    ),
    "no seal": ("truths", lambda record: record["sealed"].pop("s001"), "seals other sessions"),
    "no text": ("truths", lambda record: record["sealed"].update(s001=1), "sealed.s001 is 1"),
    "no seed": ("answers", lambda record: record.pop("seed"), "it lacks seed"),
    "a seed that is true": ("answers", lambda record: record.update(seed=True), "seed is True"),
    "an oracle": ("answers", lambda record: record.update(oracle={"s001": "x"}), "oracle.s001"),
    "a cause": (
        "answers",
        lambda record: record["answers"]["s001"].update(effects=[{"effect": "payload"}]),
        "it lacks answers.s001.effects.1.in_catalogue",
    ),
    "a size": (
        "answers",
        lambda record: record["answers"]["s001"]["effects"][0]["parameters"].update(mass_kg=[]),
        r"parameters.mass_kg is \[\]",
    ),
}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a board, what is kept of it, and an entry."""
    write_board(tmp_path)
    return tmp_path


def change(place: Path, name: str, act: Change) -> None:
    """Changes a file of the board or of what is kept."""
    path = place / ("kept" if name == "answers" else "board") / f"{name}.json"
    record = json.loads(path.read_text())
    act(record)
    path.write_text(json.dumps(record))


def score(place: Path) -> None:
    score_board(place / "board", place / "entry", place / "kept")


def test_a_made_up_board_is_one(place: Path) -> None:
    report = score_board(place / "board", place / "entry", place / "kept")
    (entry,) = report.record["entries"]
    assert entry["attribution"]["coverage"]["value"] == 1.0
    assert entry["prediction"]["median_Nm"] == 0.0


@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_no_board_is_told_in_a_line(place: Path, kind: str) -> None:
    name, act, words = CHANGES[kind]
    change(place, name, act)
    with pytest.raises(InputError, match=words) as told:
        score(place)
    assert len(str(told.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["../s001", "/tmp/s001", "s001/../../s001", "", "s", "S001", "s001\n", "."])
def test_no_name_of_a_session_leads_out_of_the_folder(place: Path, name: str) -> None:
    """Law: a session is called as its maker calls it; nothing is written or read by another name."""
    change(place, "board", lambda record: record["sessions"].update({name: record["sessions"]["s001"]}))
    before = sorted(place.rglob("*"))
    with pytest.raises(InputError, match="a session is called"):
        run_job("answer", place / "board", place / "mine/here", BoardOptions())
    assert sorted(place.rglob("*")) == before


def test_answers_take_no_folder_of_the_users(place: Path) -> None:
    """Law: entries of others that stand in a folder stay as they are."""
    users = place / "entries/lasso/s001.json"
    users.parent.mkdir(parents=True)
    users.write_text("mine")
    with pytest.raises(InputError, match="holds something else"):
        run_job("answer", place / "board", place / "entries", BoardOptions())
    assert users.read_text() == "mine"


def text_column(path: Path) -> None:
    pq.write_table(pa.table({f"{joint}/effort": ["x"] * 20 for joint in JOINTS}), path)


def nested_column(path: Path) -> None:
    pq.write_table(pa.table({f"{joint}/effort": [[1.0], []] * 10 for joint in JOINTS}), path)


def bomb(path: Path) -> None:
    nothing = pa.nulls(1_000_000, pa.float64())
    pq.write_table(pa.table({f"{joint}/effort": nothing for joint in JOINTS}), path)


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "part.parquet").write_bytes(b"")


@pytest.mark.parametrize("spoil", [text_column, nested_column, bomb, Path.unlink, folder])
def test_a_torque_that_is_none_is_told_in_a_line(
    place: Path, spoil: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: a file that lacks is no torque at all, as for a session that was left out."""
    monkeypatch.setenv("ARMGAP_MOST_UNPACKED_MB", "1")
    path = place / "entry/s001.parquet"
    spoil(path)
    if not path.is_file():
        score(place)
        return
    with pytest.raises(InputError) as told:
        score(place)
    assert len(str(told.value).splitlines()) == 1


TABLES = {
    "board/board": "BoardFileRecord",
    "board/effects": "BoardEffectsRecord",
    "board/truths": "BoardTruthsRecord",
    "kept/answers": "BoardKeptRecord",
}


@pytest.mark.parametrize("name", TABLES)
def test_what_is_read_is_what_its_schema_says(place: Path, name: str) -> None:
    """Law: a file is refused by its table where its JSON Schema refuses it, and only there."""
    good = (place / f"{name}.json").read_bytes()
    schema = make_schema(json.loads(good)["schema"])
    rng = np.random.default_rng(len(name))
    outcomes = set()
    for _ in range(150):
        (place / "spoilt.json").write_bytes(change_json(good, rng))
        try:
            record = read_json(place / "spoilt.json", "")
        except InputError:
            continue
        is_of_schema = Draft202012Validator(schema).is_valid(record)
        try:
            require_record(record, TABLES[name], name, "")
        except InputError:
            assert not is_of_schema, record
        else:
            assert is_of_schema, record
        outcomes.add(is_of_schema)
    assert outcomes == {True, False}


def test_names_are_those_of_the_board_alone(place: Path) -> None:
    assert list(Board.load(place / "board").sessions) == ["s001", "s002"]


@pytest.mark.parametrize("largest_mb", [30.0, 0.0])
def test_a_board_too_large_for_the_mail_is_told(
    place: Path, largest_mb: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: who makes a board of more than what can be sent reads so, and nobody else does."""
    made = MadeBoard(place / "board", place / "kept", 0, {DRAWN: 2}, 0)
    monkeypatch.setattr(jobs, "make_board", lambda *given: made)
    monkeypatch.setattr(jobs, "LARGEST_MB", largest_mb)
    report = run_job("make", place / "board", None, BoardOptions())
    assert ("more than" in report.summary()) == (largest_mb == 0.0)
