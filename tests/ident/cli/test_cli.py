"""The `ident` command in this process: what it prints, writes and returns where all is well, and when it is stopped."""

import json
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from ident.diagnosis.gap.ceiling import Ceiling
from ident.effects import catalogue
from ident.files import HOST
from ident.model.hybrid import HybridModel
from ident.model.residual_net import PRESETS
from ident.outputs import begin_folder
from ident.process import NOT_PASSED
from ident.show.report.diagnosis_verdict import diagnosis_headline
from tests.ident.cli.conftest import E1, ONE_RUN, ROBOT, Run, assert_untouched
from tests.ident.cli.test_refusals import FLIPPED
from tests.ident.diagnosis.contract import check_diagnosis
from tests.schemas import check_record

OLD_RESULT = '{"schema": "ident.telemetry/1"}'


def test_inspect(run: Run, tmp_path: Path) -> None:
    """Law: healthy recordings are told fit for use, on the terminal and in the JSON."""
    ended = run("inspect", E1, *ROBOT, "--json", tmp_path / "i.json")
    record = json.loads((tmp_path / "i.json").read_text())
    assert ended.status == 0
    assert "fit for use" in ended.out
    assert record["schema"] == "ident.telemetry/1"
    assert record["sessions"][0]["fit"] is True
    assert record["sessions"][0]["runs"] == 5
    assert_untouched(tmp_path, "i.json")


def test_inspect_ends_well_whatever_it_finds(run: Run, spoilt: Path) -> None:
    """Law: a finding is a result, not a mistake of the command: exit 0, the joint and the remedy are reported."""
    FLIPPED(spoilt)
    ended = run("inspect", spoilt, *ROBOT)
    assert ended.status == 0
    assert "effort_sign_flipped" in ended.out
    assert "joint_2" in ended.out
    assert "not fit for use" in ended.out


def test_fit_with_a_net(run: Run, tmp_path: Path) -> None:
    """Law: a fit leaves a model that loads, its JSON, and no checkpoint; nothing of it is pickled."""
    ended = run("fit", E1, *ROBOT, "--out", tmp_path / "m", "--json", tmp_path / "f.json")
    assert ended.status == 0, ended.err
    assert json.loads((tmp_path / "f.json").read_text())["schema"] == "ident.fit/1"
    assert HybridModel.load(tmp_path / "m").joint_names[0] == "joint_1"
    assert not [file for file in (tmp_path / "m").rglob("*") if file.suffix in (".pkl", ".pt", ".pickle")]
    assert_untouched(tmp_path, "m", "f.json")


def test_evaluate(run: Run, model: Path, tmp_path: Path) -> None:
    """Law: the ladder is printed and written; the loss rung's torque error is less than the analytic one's."""
    ended = run("evaluate", E1, "--model", model, "--html", tmp_path / "e.html", "--json", tmp_path / "e.json")
    assert ended.status == 0, ended.err
    assert "rigid body" in ended.out
    assert "+ loss" in ended.out
    record = json.loads((tmp_path / "e.json").read_text())
    assert record["schema"] == "ident.evaluations/1"
    assert len(record["models"]) == 1
    fitted = {data["sha256"] for data in HybridModel.load(model).provenance["data"]}
    tried = {sha256(file.read_bytes()).hexdigest() for file in E1.glob("*.parquet")}
    assert record["models"][0]["fitted_files"] == len(fitted & tried)
    assert ("part of its fit" in ended.out.replace("\n", " ")) is bool(fitted & tried)
    assert (tmp_path / "e.html").read_text().lstrip().lower().startswith("<!doctype html>")
    assert_untouched(tmp_path, "e.html", "e.json")


def test_a_model_stands_before_the_sessions(run: Run, model: Path, tmp_path: Path) -> None:
    """Law: as in `verify` and `export`; an evaluation is the same wherever its model is given."""
    first = run("evaluate", model, E1, "--json", tmp_path / "first.json")
    option = run("evaluate", E1, "--model", model, "--json", tmp_path / "option.json")
    assert (first.status, option.status) == (0, 0), first.err + option.err
    one, other = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("first", "option"))
    assert one["models"][0]["pooled"] == other["models"][0]["pooled"]


def test_view_saves_a_timeline(run: Run, model: Path, tmp_path: Path) -> None:
    """Law: --rrd writes a Rerun file and opens no window."""
    ended = run("view", E1, "--model", model, "--rrd", tmp_path / "v.rrd", "--json", tmp_path / "v.json")
    assert ended.status == 0, ended.err
    assert (tmp_path / "v.rrd").read_bytes()[:3] == b"RRF"
    assert len(json.loads((tmp_path / "v.json").read_text())["runs"]) == 5
    assert_untouched(tmp_path, "v.rrd", "v.json")


def test_diagnose_of_a_flipped_sign(run: Run, spoilt: Path, tmp_path: Path) -> None:
    """Law: `refused` is a verdict: exit 0, page and JSON are written and name the joint; no timeline
    of what was not fitted.
    """
    FLIPPED(spoilt)
    outputs = ("--html", tmp_path / "d.html", "--json", tmp_path / "d.json", "--rrd", tmp_path / "d.rrd")
    ended = run("diagnose", spoilt, *ROBOT, *outputs)
    assert ended.status == 0, ended.err
    assert check_diagnosis(json.loads((tmp_path / "d.json").read_text()))["verdict"] == "refused"
    assert "Refused: the recordings are unfit" in ended.out
    assert "joint_2" in (tmp_path / "d.html").read_text()
    assert_untouched(tmp_path, "session", "d.html", "d.json")


def test_diagnose_in_full(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: with a gap or without, page, timeline and JSON are written, the JSON as promised."""
    monkeypatch.setattr(catalogue, "CATALOGUE", (catalogue.find_effect("load_dependent_friction"),))
    monkeypatch.setattr("ident.diagnosis.remaining.measure_ceiling", lambda *_, **__: Ceiling(0.1, 0.1, None))
    outputs = ("--html", tmp_path / "d.html", "--json", tmp_path / "d.json", "--rrd", tmp_path / "d.rrd")
    ended = run("diagnose", E1, *ROBOT, *outputs)
    assert ended.status == 0, ended.err
    record = check_diagnosis(json.loads((tmp_path / "d.json").read_text()))
    assert set(record["gap"]) == set(record["joints"])
    assert diagnosis_headline(record) in " ".join(ended.out.split())
    assert_untouched(tmp_path, "d.html", "d.json", "d.rrd")


def test_simulate(run: Run, tmp_path: Path) -> None:
    """Law: a simulated session is read again by the same tool."""
    short = ("--runs", 1, "--duration", 2, "--motion", "spline", "--rate", 100)
    ended = run("simulate", "--out", tmp_path / "s", "--effect", "spring_torque:joint_3:20", *short)
    assert ended.status == 0, ended.err
    assert "1 run, " in ended.out
    assert run("inspect", tmp_path / "s").status == 0
    assert_untouched(tmp_path, "s")


def stop(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_interrupted_while_fitting(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: Ctrl-C ends with 130 and one line; no model, no JSON."""
    monkeypatch.setattr("ident.fitting.fit.fit_hybrid", stop)
    ended = run("fit", E1, *ROBOT, "--out", tmp_path / "m", "--json", tmp_path / "f.json")
    assert (ended.status, ended.err.strip()) == (130, "ident: stopped")
    assert_untouched(tmp_path)


def test_interrupted_while_writing(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: Ctrl-C amid an output leaves the old file as it was, and no part of the new one."""
    (tmp_path / "i.json").write_text(OLD_RESULT)
    monkeypatch.setattr(json, "dumps", stop)
    ended = run("inspect", E1, *ROBOT, "--json", tmp_path / "i.json")
    assert ended.status == 130
    assert (tmp_path / "i.json").read_text() == OLD_RESULT
    assert_untouched(tmp_path, "i.json")


def test_a_fit_goes_on_after_a_kill_amid_a_checkpoint(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: whatever a kill left of a checkpoint, the next fit succeeds and leaves nothing of it."""
    monkeypatch.setitem(PRESETS, "paper", replace(PRESETS["paper"], hidden=(4,), epochs=10))
    training, fit = tmp_path / "m.training", ("fit", E1, *ROBOT, "--net", "paper", "--out", tmp_path / "m")
    assert run(*fit).status == 0
    assert_untouched(tmp_path, "m")
    for content in (b"", b"half", b"\x08" + bytes(7) + b'{"a":{}}'):
        begin_folder(training, "training")
        (training / "checkpoint.safetensors").write_bytes(content)
        (training / f".checkpoint.armgap-{HOST}-999999999-ab.part.safetensors").write_bytes(b"half")
        assert run(*fit).status == 0
        assert_untouched(tmp_path, "m")


def test_without_a_command_the_help_is_shown_and_nothing_is_wrong(run: Run) -> None:
    ended = run()
    assert ended.status == 0
    assert "diagnose" in ended.out
    assert "..." not in ended.out.partition("Commands:")[2]
    assert max(map(len, ended.out.splitlines())) <= 80


def test_a_record_on_standard_output_stands_there_alone(run: Run) -> None:
    ended = run("inspect", ONE_RUN, *ROBOT, "--json", "-")
    assert json.loads(ended.out)["schema"] == "ident.telemetry/1"
    assert "1 run," in ended.err
    assert not Path("-").exists()


def test_a_view_without_a_screen_is_told_before_anything_is_read(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    ended = run("view", ONE_RUN, *ROBOT)
    assert (ended.status, ended.err.count("\n")) == (2, 1)
    assert "--rrd" in ended.err


def test_export_writes_the_formats_that_were_asked_for(run: Run, model: Path, tmp_path: Path) -> None:
    """Two formats, their files, and what was found when they were loaded back."""
    out, record = tmp_path / "out", tmp_path / "export.json"
    assert run("export", model, "--out", out, "--format", "urdf", "--format", "toml", "--json", record).status == 0
    assert (out / "robot.urdf").is_file()
    assert not (out / "robot.xml").exists()
    assert json.loads(record.read_text())["files"] == ["robot.urdf", "parameters.toml"]


@pytest.mark.parametrize(("bound", "status"), [(1000.0, 0), (0.001, NOT_PASSED)])
def test_verify_is_a_gate(bound: float, status: int, run: Run, model: Path, tmp_path: Path) -> None:
    """Exit 0 where the limit is kept, 3 where it is not; the record says which, either way."""
    limits, record = tmp_path / "limits.toml", tmp_path / "verify.json"
    limits.write_text(f"[torque_rmse_Nm]\ntotal = {bound}\n")
    assert run("verify", model, E1.parent / "E2", "--limits", limits, "--json", record).status == status
    assert json.loads(record.read_text())["passed"] is (status == 0)


def test_a_gate_on_the_data_of_the_fit_passes_by_request_alone(run: Run, model: Path, tmp_path: Path) -> None:
    """Law: one common file is enough for exit 3, whatever the limits; --in-sample accepts it; the record says so."""
    limits, record = tmp_path / "limits.toml", tmp_path / "verify.json"
    limits.write_text("[torque_rmse_Nm]\ntotal = 1000.0\n")
    assert run("verify", model, ONE_RUN, "--limits", limits, "--json", record).status == NOT_PASSED
    assert json.loads(record.read_text())["in_sample"]
    assert run("verify", model, ONE_RUN, "--limits", limits, "--in-sample").status == 0


def test_an_export_is_written_only_where_it_is_promoted(run: Run, model: Path, tmp_path: Path) -> None:
    """Law: on the data of the fit exit 3, no folder, a record that says why; by request it beats the URDF alone."""
    out = tmp_path / "out"
    record = tmp_path / "export.json"
    words = ("export", model, "--out", out, "--format", "toml", "--on", ONE_RUN)
    assert run(*words, "--json", record).status == NOT_PASSED
    told = json.loads(record.read_text())
    assert told["files"] == []
    assert told["promotion"]["in_sample"]
    assert told["promotion"]["forms"]["model"]["beats"]
    assert not out.exists()
    assert run(*words, "--in-sample").status == 0
    assert (out / "parameters.toml").is_file()


def test_a_session_is_not_compared_with_itself(run: Run, tmp_path: Path) -> None:
    """The same recording on both sides is refused, with a result file and a page that say so."""
    out = tmp_path / "compared"
    ended = run("compare", E1, *ROBOT, "--after", E1, "--out", out)
    assert ended.status == 0
    assert "Refused: the recordings are unfit" in ended.out
    record = check_record(json.loads((out / "comparison.json").read_text(encoding="utf-8")))
    assert record["verdict"] == "refused"
    assert record["before"]["runs"] == record["after"]["runs"] == 5
    page = (out / "comparison.html").read_text(encoding="utf-8")
    assert "Refused" in page
    assert "give every recording once" in page
