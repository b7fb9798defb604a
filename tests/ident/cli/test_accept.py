"""Refusals that the user overrules."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ident.checks.report import TOLD_BY_A_FIT, TelemetryReport, overrule
from ident.cli.app import main
from ident.model.hybrid import HybridModel
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.names import data_path

E1 = Path(data_path("logs/tm5_900")) / "E1"


@pytest.fixture
def flipped(tmp_path: Path) -> Path:
    """E1 with the torque of joint 2 turned round."""
    folder = Path(shutil.copytree(E1, tmp_path / "session"))
    with (folder / "session.toml").open("a") as file:
        file.write("\n[effort_sign]\njoint_2 = -1\n")
    return folder


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["ident", *map(str, arguments), "--robot", "tm5-900"])
        with pytest.raises(SystemExit) as end:
            main()
        told = capsys.readouterr()
        return int(end.value.code or 0), told.out + told.err

    return call


def test_a_refusal_is_overruled_and_recorded(
    run: Callable[..., tuple[int, str]], flipped: Path, tmp_path: Path
) -> None:
    """Refused without; fitted with; the model says what was accepted, and the user is told."""
    out = tmp_path / "model"
    status, told = run("fit", flipped, "--net", "none", "--out", out)
    assert (status, "effort_sign_flipped" in told, out.exists()) == (2, True, False)
    status, told = run("fit", flipped, "--net", "none", "--out", out, "--accept", "effort_sign_flipped")
    assert status == 0
    assert "effort_sign_flipped" in told
    provenance = HybridModel.load(out).provenance
    assert list(provenance["options"]["accept"]) == ["effort_sign_flipped"]
    assert [one["issue"] for one in provenance["accepted"]] == ["effort_sign_flipped"]


def test_a_diagnosis_overrules_too(run: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    """One short run is too little to be sure; accepted, something is computed, and the record says so."""
    record = tmp_path / "why.json"
    one = E1 / "01_trajectory_1.parquet"
    run("diagnose", one, "--json", record)
    assert json.loads(record.read_text())["verdict"] == "not_testable"
    status, _ = run("diagnose", one, "--json", record, "--accept", "too_few_runs")
    found = json.loads(record.read_text())
    (issue,) = (issue for issue in found["telemetry"] if issue["issue"] == "too_few_runs")
    assert status == 0
    assert found["gap"]
    assert issue["severity"] == "warning"
    assert issue["remedy"].startswith("accepted by --accept too_few_runs")
    assert found["provenance"]["settings"]["accepted"] == ["too_few_runs"]


def test_an_unknown_issue_is_told_with_those_that_can_be_accepted(
    run: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
    status, told = run("fit", E1, "--net", "none", "--out", tmp_path / "model", "--accept", "bad_weather")
    assert status == 2
    assert "'bad_weather' can't be accepted" in told
    assert "effort_is_model" in told


def test_a_torque_that_a_model_made_is_told_by_a_fit() -> None:
    """Without being accepted; what else is refused stays refused."""
    issues = tuple(
        TelemetryIssue(name, (), "fatal", "seen", "mend it") for name in ("effort_is_model", "wrong_time_base")
    )
    report = overrule(TelemetryReport(Session("made", ()), issues), (), TOLD_BY_A_FIT)
    assert [issue.issue for issue in report.fatal] == ["wrong_time_base"]
