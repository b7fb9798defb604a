"""The `ident` command in this process: what it prints, writes and returns; the user's mistakes in one line."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from ident.cli import app as cli
from ident.diagnosis.gap.ceiling import Ceiling
from ident.effects import catalogue
from ident.files import HOST
from ident.model.hybrid import HybridModel
from ident.model.residual_net import PRESETS
from ident.outputs import begin_folder
from ident.robot.names import data_path
from tests.ident.diagnosis.contract import check_diagnosis
from tests.schemas import check_file

E1 = Path(data_path("logs/tm5_900")) / "E1"
ROBOT = ("--robot", "tm5-900")
# A diagnosis that skips the search: too little is recorded.
OLD_RESULT = '{"schema": "ident.telemetry/1"}'
ONE_RUN = E1 / "01_trajectory_1.parquet"


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit status, standard output and error."""

    status: int
    out: str
    err: str


Run = Callable[..., Ended]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `ident` with some arguments; a result file that it writes holds to its published schema."""

    def call(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["ident", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            cli.main()
        told = capsys.readouterr()
        if "--json" in arguments and not end.value.code:
            check_file(arguments[arguments.index("--json") + 1])  # type: ignore[arg-type]
        return Ended(int(end.value.code or 0), told.out, told.err)

    return call


@pytest.fixture(scope="module")
def text_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """E1 as CSV files."""
    folder = tmp_path_factory.mktemp("text") / "session"
    folder.mkdir()
    shutil.copy(E1 / "session.toml", folder)
    for file in sorted(E1.glob("*.parquet")):
        pacsv.write_csv(pq.read_table(file), folder / f"{file.stem}.csv")
    return folder


@pytest.fixture
def spoilt(text_session: Path, tmp_path: Path) -> Path:
    """A copy of it to be spoilt."""
    return Path(shutil.copytree(text_session, tmp_path / "session"))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of E1 without a net."""
    out = tmp_path_factory.mktemp("model") / "m"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["ident", "fit", str(E1), *ROBOT, "--net", "none", "--out", str(out)])
        with pytest.raises(SystemExit) as end:
            cli.main()
    assert not end.value.code
    return out


def assert_told(ended: Ended, *words: str) -> None:
    """Exit status 2; one line on standard error: place, what is wrong; remedy. No traceback."""
    assert ended.status == 2, ended
    line = ended.err.rstrip("\n")
    assert line.startswith("ident: ")
    assert "\n" not in line
    assert "Traceback" not in ended.err + ended.out
    for word in words:
        assert word in line, line


def assert_untouched(folder: Path, *names: str) -> None:
    """Only these lie in a folder: no output, no temporary file."""
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(names)


def column_of(file: Path, name: str) -> int:
    return file.read_text().splitlines()[0].replace('"', "").split(",").index(name)


def set_cells(file: Path, column: str, text: str, rows: range) -> None:
    """Writes the same text into some cells of a column."""
    lines = file.read_text().splitlines()
    at = column_of(file, column)
    for row in rows:
        cells = lines[row].split(",")
        cells[at] = text
        lines[row] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n")


def drop_column(folder: Path) -> tuple[str, ...]:
    for file in folder.glob("*.csv"):
        at = column_of(file, "joint_3/effort")
        rows = [line.split(",") for line in file.read_text().splitlines()]
        file.write_text("\n".join(",".join(cells[:at] + cells[at + 1 :]) for cells in rows) + "\n")
    return "01_trajectory_1.csv", "joint_3/effort"


def many_nans(folder: Path) -> tuple[str, ...]:
    for file in folder.glob("*.csv"):
        set_cells(file, "joint_2/effort", "nan", range(20, 100))
    return "joint_2", "nan"


def text_in_numbers(folder: Path) -> tuple[str, ...]:
    for file in folder.glob("*.csv"):
        set_cells(file, "joint_2/position", "none", range(20, 100))
    return "01_trajectory_1.csv", "joint_2/position"


def empty_file(folder: Path) -> tuple[str, ...]:
    (folder / "02_trajectory_2.csv").write_text("")
    return "02_trajectory_2.csv", "empty"


def header_only(folder: Path) -> tuple[str, ...]:
    file = folder / "02_trajectory_2.csv"
    file.write_text(file.read_text().splitlines()[0] + "\n")
    return ("02_trajectory_2.csv",)


def empty_bag(folder: Path) -> tuple[str, ...]:
    (folder / "06_bag.mcap").write_bytes(b"")
    return ("06_bag.mcap",)


def empty_database(folder: Path) -> tuple[str, ...]:
    (folder / "06_bag.db3").write_bytes(b"")
    return ("06_bag.db3",)


def other_joints_in_one_run(folder: Path) -> tuple[str, ...]:
    file = folder / "03_trajectory_3.csv"
    file.write_text(file.read_text().replace("joint_6/", "gripper/"))
    return "03_trajectory_3.csv", "gripper"


def joints_of_another_robot(folder: Path) -> tuple[str, ...]:
    for file in folder.glob("*.csv"):
        text = file.read_text()
        for number, name in enumerate(("waist", "shoulder", "elbow", "roll", "pitch", "yaw"), 1):
            text = text.replace(f"joint_{number}/", f"{name}/")
        file.write_text(text)
    return "elbow", "joint_1", "--robot"


def broken_toml(folder: Path) -> tuple[str, ...]:
    (folder / "session.toml").write_text("[payload\n")
    return "session.toml", "not TOML"


def flipped_sign(folder: Path) -> tuple[str, ...]:
    (folder / "session.toml").write_text("[effort_sign]\njoint_2 = -1\n")
    return "effort_sign_flipped", "joint_2", "[effort_sign]"


FAULTS = [
    drop_column,
    many_nans,
    text_in_numbers,
    empty_file,
    header_only,
    empty_bag,
    empty_database,
    other_joints_in_one_run,
    joints_of_another_robot,
    broken_toml,
    flipped_sign,
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_bad_recordings(run: Run, spoilt: Path, tmp_path: Path, fault: Callable[[Path], tuple[str, ...]]) -> None:
    """Law: a session at fault ends a fit with one line that names the place; nothing is written."""
    words = fault(spoilt)
    ended = run("fit", spoilt, *ROBOT, "--net", "none", "--out", tmp_path / "m", "--json", tmp_path / "f.json")
    assert_told(ended, str(tmp_path), *words)
    assert ";" in ended.err
    assert_untouched(tmp_path, "session")


def test_a_urdf_without_inertia(run: Run, tmp_path: Path) -> None:
    """Law: a robot without masses is refused by the name of its file."""
    bare = tmp_path / "bare.urdf"
    bare.write_text(
        '<robot name="bare"><link name="base"/><link name="arm"/><joint name="joint_1" type="revolute">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint></robot>'
    )
    ended = run("fit", E1, "--robot", bare, "--net", "none", "--out", tmp_path / "m")
    assert_told(ended, "bare.urdf", "joint_1", "mass", "<inertial>")
    assert_untouched(tmp_path, "bare.urdf")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("fit", E1, "--robot", "tm9", "--out", "m"), ("tm9", "tm5-900")),
        (("fit", E1, *ROBOT, "--out", "m", "--net", "foo"), ("--net", "'foo'", "default, paper, none")),
        (("fit", E1, *ROBOT, "--out", "m", "--links", "4"), ("--links", "4", "3, 6")),
        (("fit", E1, *ROBOT, "--out", "m", "--links", "x"), ("--links",)),
        (("fit", E1, *ROBOT, "--out", "m", "--inertia", "x"), ("--inertia", "nominal, base, consistent")),
        (("fit", E1, *ROBOT, "--out", "m", "--bogus"), ("--bogus",)),
        (("fit", "nowhere", *ROBOT, "--out", "m"), ("nowhere", "no such file")),
        (("fit", E1, *ROBOT), ("--out",)),
        (("fitt",), ("fitt",)),
        (("evaluate", E1, "--model", "nowhere"), ("nowhere", "ident fit")),
        (("diagnose", E1, *ROBOT, "--catalogue", "nowhere.py"), ("nowhere.py",)),
        (("diagnose", E1, *ROBOT, "--until", "2"), ("--until", "2", "between 0.5 and")),
        (("simulate", "--out", "s", "--effect", "stribek:joint_1:1"), ("--effect", "stribek", "stribeck_friction")),
        (("simulate", "--out", "s", "--effect", "stribeck_friction"), ("--effect", "joint")),
        (("simulate", "--out", "s", "--effect", "stribeck_friction:joint_9:1"), ("joint_9",)),
        (("simulate", "--out", "s", "--effect", "stribeck_friction:joint_1:much"), ("much",)),
        (("simulate", "--out", "s", "--payload", "heavy"), ("heavy",)),
        (("simulate", "--out", "s", "--decoy", "luck"), ("luck",)),
        (("simulate", "--out", "s", "--motion", "dance"), ("dance",)),
        (("simulate", "--out", "s", "--runs", "0"), ("0",)),
        (("simulate", "--out", "s", "--commands", "nowhere.csv"), ("nowhere.csv",)),
    ],
)
def test_bad_options(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[object, ...], words: tuple[str, ...]
) -> None:
    """Law: an option's bad value ends in one line that names it and what would do; nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert_told(run(*arguments), *words)
    assert_untouched(tmp_path)


def test_no_robot_is_named(run: Run, spoilt: Path) -> None:
    """Law: neither --robot nor session.toml: the line says how to name one."""
    (spoilt / "session.toml").unlink()
    assert_told(run("inspect", spoilt), "--robot", "session.toml")


def test_a_model_of_another_robot(run: Run, tmp_path: Path) -> None:
    """Law: a diagnosis compares with a model of the same robot only, known by its links and not by its name."""
    cousin, fitted = tmp_path / "cousin.urdf", tmp_path / "m"
    own = Path(data_path("urdf/tm5_900.urdf")).read_text()
    cousin.write_text(own.replace('<robot name="tm5_900"', '<robot name="c"').replace('"8.897"', '"9.897"'))
    assert run("fit", E1, "--robot", cousin, "--net", "none", "--out", fitted).status == 0
    ended = run("diagnose", E1, *ROBOT, "--model", fitted, "--json", tmp_path / "d.json")
    assert_told(ended, str(fitted), "'c'", "'tm5_900'")
    assert_untouched(tmp_path, "cousin.urdf", "m")


def test_where_nothing_can_be_written(run: Run, tmp_path: Path) -> None:
    """Law: an output folder that is a file is the user's mistake, told before or after the work, never a traceback."""
    (tmp_path / "file").write_text("mine")
    ended = run("fit", E1, *ROBOT, "--net", "none", "--out", tmp_path / "file")
    assert_told(ended, str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"
    assert_untouched(tmp_path, "file")


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
    """Law: a finding is a result, not a mistake of the command: exit 0, the joint and the remedy are told."""
    flipped_sign(spoilt)
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
    assert "analytic" in ended.out
    assert "+ loss" in ended.out
    record = json.loads((tmp_path / "e.json").read_text())
    assert record["schema"] == "ident.evaluations/1"
    assert len(record["models"]) == 1
    assert (tmp_path / "e.html").read_text().lstrip().lower().startswith("<!doctype html>")
    assert_untouched(tmp_path, "e.html", "e.json")


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
    flipped_sign(spoilt)
    outputs = ("--html", tmp_path / "d.html", "--json", tmp_path / "d.json", "--rrd", tmp_path / "d.rrd")
    ended = run("diagnose", spoilt, *ROBOT, *outputs)
    assert ended.status == 0, ended.err
    record = check_diagnosis(json.loads((tmp_path / "d.json").read_text()))
    assert record["verdict"] == "refused"
    assert "refused" in ended.out
    assert "joint_2" in (tmp_path / "d.html").read_text()
    assert_untouched(tmp_path, "session", "d.html", "d.json")


def test_diagnose_of_too_little(run: Run, tmp_path: Path) -> None:
    """Law: `not_testable` is a verdict too."""
    ended = run("diagnose", ONE_RUN, *ROBOT, "--json", tmp_path / "d.json")
    assert ended.status == 0, ended.err
    assert check_diagnosis(json.loads((tmp_path / "d.json").read_text()))["verdict"] == "not_testable"


def test_diagnose_in_full(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: with a gap or without, page, timeline and JSON are written, the JSON as promised."""
    monkeypatch.setattr(catalogue, "CATALOGUE", (catalogue.find_effect("load_dependent_friction"),))
    monkeypatch.setattr("ident.diagnosis.diagnose.measure_ceiling", lambda *_, **__: Ceiling(0.1, 0.1, None, False))
    outputs = ("--html", tmp_path / "d.html", "--json", tmp_path / "d.json", "--rrd", tmp_path / "d.rrd")
    ended = run("diagnose", E1, *ROBOT, *outputs)
    assert ended.status == 0, ended.err
    record = check_diagnosis(json.loads((tmp_path / "d.json").read_text()))
    assert set(record["gap"]) == set(record["joints"])
    assert record["verdict"] in ended.out
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
    monkeypatch.setattr("ident.model.hybrid.fit_hybrid", stop)
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


def test_no_command_takes_the_users_files(run: Run, text_session: Path, tmp_path: Path) -> None:
    """Law: whatever stands at a place where a command would write stays, and the command says so before it works."""
    (tmp_path / "work").mkdir()
    (tmp_path / "work/thesis.tex").write_text("years")
    before = {path: path.read_bytes() for path in text_session.iterdir()}
    work, mine = tmp_path / "work", tmp_path / "work/thesis.tex"
    assert_told(run("fit", E1, *ROBOT, "--out", work), "thesis.tex", "did not write")
    assert_told(run("simulate", "--out", work), "thesis.tex", "did not write")
    assert_told(run("inspect", E1, *ROBOT, "--mend", work), "thesis.tex", "did not write")
    assert_told(run("demo", "--out", work, "--json", mine), "did not write")
    assert_told(run("blind", "--out", work), "something else")
    assert_told(run("inspect", text_session, *ROBOT, "--mend", text_session), "read by the same command")
    assert_told(run("inspect", E1, E1, *ROBOT, "--mend", tmp_path / "m"), "two sessions are called 'E1'")
    assert_told(run("inspect", E1, *ROBOT, "--json", next(text_session.glob("*.csv"))), "did not write")
    assert_told(run("diagnose", E1, *ROBOT, "--html", mine), "did not write")
    assert_told(run("diagnose", E1, *ROBOT, "--rrd", mine), "did not write")
    assert_told(run("inspect", E1, *ROBOT, "--json", "/dev/null"), "a device")
    assert {path: path.read_bytes() for path in text_session.iterdir()} == before
    assert mine.read_text() == "years"
    assert_untouched(tmp_path, "work")


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


def test_a_record_on_standard_output_stands_there_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["ident", "inspect", str(ONE_RUN), *ROBOT, "--json", "-"])
    with pytest.raises(SystemExit):
        cli.main()
    told = capsys.readouterr()
    assert json.loads(told.out)["schema"] == "ident.telemetry/1"
    assert "1 run," in told.err
    assert not Path("-").exists()


def test_a_view_without_a_screen_is_told_before_anything_is_read(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    ended = run("view", ONE_RUN, *ROBOT)
    assert (ended.status, ended.err.count("\n")) == (2, 1)
    assert "--rrd" in ended.err
