"""The command `ident compare`: which sessions are before and after, what is refused, what is written."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from ident.cli import app as cli
from ident.robot.names import data_path
from tests.schemas import check_record

E1 = Path(data_path("logs/tm5_900")) / "E1"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["ident", "compare", *map(str, arguments), "--robot", "tm5-900"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


@pytest.mark.parametrize("count", [1, 3])
def test_it_must_be_clear_which_sessions_are_the_later_ones(
    count: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, *[E1] * count) == 2
    assert "--after" in capsys.readouterr().err


def test_a_session_is_not_compared_with_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same recording on both sides is refused, with a result file and a page that say so."""
    out = tmp_path / "compared"
    assert run(monkeypatch, E1, "--after", E1, "--out", out) == 0
    assert "refused" in capsys.readouterr().out
    record = check_record(json.loads((out / "comparison.json").read_text(encoding="utf-8")))
    assert record["verdict"] == "refused"
    assert record["before"]["runs"] == record["after"]["runs"] == 5
    page = (out / "comparison.html").read_text(encoding="utf-8")
    assert "Refused" in page
    assert "give every recording once" in page
