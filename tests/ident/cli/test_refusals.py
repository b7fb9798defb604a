"""What the `ident` command refuses: the user's mistakes end in one line that names the place and the remedy."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ident.checks.report import REPORTED_BY_A_FIT, TelemetryReport, overrule
from ident.model.hybrid import HybridModel
from ident.process import USER
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.names import data_path
from tests.ident.cli.conftest import E1, ONE_RUN, ROBOT, Run, assert_refused, assert_untouched

Fault = Callable[[Path], object]


def rewrite(pattern: str, edit: Callable[[str], str]) -> Fault:
    """Other text in some files of a session, or a new file."""

    def spoil(folder: Path) -> None:
        for file in list(folder.glob(pattern)) or [folder / pattern]:
            file.write_text(edit(file.read_text() if file.exists() else ""))

    return spoil


def cells(column: str, text: str | None) -> Fault:
    """The same text in some cells of a column; None takes the column out."""

    def edit(table: str) -> str:
        rows = [line.split(",") for line in table.splitlines()]
        at = rows[0].index(f'"{column}"')
        if text is None:
            rows = [row[:at] + row[at + 1 :] for row in rows]
        else:
            for row in rows[20:100]:
                row[at] = text
        return "\n".join(map(",".join, rows)) + "\n"

    return rewrite("*.csv", edit)


def another_robot(table: str) -> str:
    for number, name in enumerate(("waist", "shoulder", "elbow", "roll", "pitch", "yaw"), 1):
        table = table.replace(f"joint_{number}/", f"{name}/")
    return table


FLIPPED = rewrite("session.toml", lambda _: "[effort_sign]\njoint_2 = -1\n")
SECOND, THIRD = "02_trajectory_2.csv", "03_trajectory_3.csv"
# What is done to a session, and what the line must say.
FAULTS: dict[str, tuple[Fault, tuple[str, ...]]] = {
    "no column": (cells("joint_3/effort", None), ("01_trajectory_1.csv", "joint_3/effort")),
    "many NaN": (cells("joint_2/effort", "nan"), ("joint_2", "nan")),
    "text": (cells("joint_2/position", "none"), ("01_trajectory_1.csv", "joint_2/position")),
    "empty file": (rewrite(SECOND, lambda _: ""), (SECOND, "empty")),
    "header only": (rewrite(SECOND, lambda table: table.splitlines()[0] + "\n"), (SECOND,)),
    "empty bag": (rewrite("06_bag.mcap", lambda _: ""), ("06_bag.mcap",)),
    "empty database": (rewrite("06_bag.db3", lambda _: ""), ("06_bag.db3",)),
    "other joints": (rewrite(THIRD, lambda table: table.replace("joint_6/", "gripper/")), (THIRD, "gripper")),
    "another robot": (rewrite("*.csv", another_robot), ("elbow", "joint_1", "--robot")),
    "broken TOML": (rewrite("session.toml", lambda _: "[payload\n"), ("session.toml", "not TOML")),
    "flipped sign": (FLIPPED, ("effort_sign_flipped", "joint_2", "effort_sign = {joint_2 = -1}")),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_recordings(run: Run, spoilt: Path, tmp_path: Path, fault: str) -> None:
    """Law: a session at fault ends a fit with one line that names the place; nothing is written."""
    spoil, words = FAULTS[fault]
    spoil(spoilt)
    ended = run("fit", spoilt, *ROBOT, "--net", "none", "--out", tmp_path / "m", "--json", tmp_path / "f.json")
    assert_refused(ended, str(tmp_path), *words)
    assert ";" in ended.err
    assert_untouched(tmp_path, "session")


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
        (("evaluate", E1), ("no folder of a fitted model", "give MODEL SESSION")),
        (("diagnose", E1, *ROBOT, "--catalogue", "nowhere.py"), ("nowhere.py",)),
        (("diagnose", E1, *ROBOT, "--until", "2"), ("--until", "2", "from 0.5 to below 1")),
        (("simulate", "--out", "s", "--effect", "stribek:joint_1:1"), ("--effect", "stribek", "stribeck_friction")),
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
    assert_refused(run(*arguments), *words)
    assert_untouched(tmp_path)


def test_no_robot_is_named(run: Run, spoilt: Path) -> None:
    """Law: neither --robot nor session.toml: the line says how to name one."""
    (spoilt / "session.toml").unlink()
    assert_refused(run("inspect", spoilt), "--robot", "session.toml")


def test_a_model_of_another_robot(run: Run, tmp_path: Path) -> None:
    """Law: a diagnosis compares with a model of the same robot only, known by its links and not by its name."""
    cousin, fitted = tmp_path / "cousin.urdf", tmp_path / "m"
    own = Path(data_path("urdf/tm5_900.urdf")).read_text()
    cousin.write_text(own.replace('<robot name="tm5_900"', '<robot name="c"').replace('"8.897"', '"9.897"'))
    assert run("fit", E1, "--robot", cousin, "--net", "none", "--out", fitted).status == 0
    ended = run("diagnose", E1, *ROBOT, "--model", fitted, "--json", tmp_path / "d.json")
    assert_refused(ended, str(fitted), "'c'", "'tm5_900'")
    assert_untouched(tmp_path, "cousin.urdf", "m")


def test_where_nothing_can_be_written(run: Run, tmp_path: Path) -> None:
    """Law: an output folder that is a file is the user's mistake, told before or after the work, never a traceback."""
    (tmp_path / "file").write_text("mine")
    ended = run("fit", E1, *ROBOT, "--net", "none", "--out", tmp_path / "file")
    assert_refused(ended, str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"
    assert_untouched(tmp_path, "file")


def test_no_command_takes_the_users_files(run: Run, text_session: Path, tmp_path: Path) -> None:
    """Law: whatever stands at a place where a command would write stays, and the command says so before it works."""
    (tmp_path / "work").mkdir()
    (tmp_path / "work/thesis.tex").write_text("years")
    before = {path: path.read_bytes() for path in text_session.iterdir()}
    work, mine = tmp_path / "work", tmp_path / "work/thesis.tex"
    assert_refused(run("fit", E1, *ROBOT, "--out", work), "thesis.tex", "did not write")
    assert_refused(run("simulate", "--out", work), "thesis.tex", "did not write")
    assert_refused(run("inspect", E1, *ROBOT, "--mend", work), "thesis.tex", "did not write")
    assert_refused(run("demo", "--out", work, "--json", mine), "did not write")
    assert_refused(run("blind", "--out", work), "something else")
    assert_refused(run("inspect", text_session, *ROBOT, "--mend", text_session), "read by the same command")
    assert_refused(run("inspect", E1, E1, *ROBOT, "--mend", tmp_path / "m"), "two sessions are called 'E1'")
    assert_refused(run("inspect", E1, *ROBOT, "--json", next(text_session.glob("*.csv"))), "did not write")
    assert_refused(run("diagnose", E1, *ROBOT, "--html", mine), "did not write")
    assert_refused(run("diagnose", E1, *ROBOT, "--rrd", mine), "did not write")
    assert_refused(run("inspect", E1, *ROBOT, "--json", "/dev/null"), "a device")
    assert {path: path.read_bytes() for path in text_session.iterdir()} == before
    assert mine.read_text() == "years"
    assert_untouched(tmp_path, "work")


@pytest.mark.parametrize("count", [1, 3])
def test_it_must_be_clear_which_sessions_are_the_later_ones(run: Run, count: int) -> None:
    assert_refused(run("compare", *[E1] * count, *ROBOT), "--after")


def test_a_refusal_is_overruled_and_recorded(run: Run, spoilt: Path, tmp_path: Path) -> None:
    """Refused without; fitted with; the model and the command say what was accepted."""
    FLIPPED(spoilt)
    out = tmp_path / "model"
    fit = ("fit", spoilt, *ROBOT, "--net", "none", "--out", out)
    assert_refused(run(*fit), "effort_sign_flipped")
    assert not out.exists()
    ended = run(*fit, "--accept", "effort_sign_flipped")
    assert ended.status == 0
    assert "effort_sign_flipped" in ended.out
    provenance = HybridModel.load(out).provenance
    assert list(provenance["options"]["accept"]) == ["effort_sign_flipped"]
    assert [one["issue"] for one in provenance["accepted"]] == ["effort_sign_flipped"]


def test_a_diagnosis_overrules_too(run: Run, tmp_path: Path) -> None:
    """One short run is too little to be sure; accepted, something is computed, and the record says so."""
    record = tmp_path / "why.json"
    run("diagnose", ONE_RUN, *ROBOT, "--json", record)
    assert json.loads(record.read_text())["verdict"] == "not_testable"
    ended = run("diagnose", ONE_RUN, *ROBOT, "--json", record, "--accept", "too_few_runs")
    found = json.loads(record.read_text())
    (issue,) = (issue for issue in found["telemetry"] if issue["issue"] == "too_few_runs")
    assert ended.status == 0
    assert found["gap"]
    assert issue["severity"] == "warning"
    assert issue["remedy"].startswith("accepted by --accept too_few_runs")
    assert found["provenance"]["settings"]["accepted"] == ["too_few_runs"]


def test_an_unknown_issue_is_refused_with_those_that_can_be_accepted(run: Run, tmp_path: Path) -> None:
    fit = ("fit", E1, *ROBOT, "--net", "none", "--out", tmp_path / "model", "--accept", "bad_weather")
    assert_refused(run(*fit), "'bad_weather' can't be accepted", "effort_is_model")


def test_a_torque_that_a_model_made_is_told_by_a_fit() -> None:
    """Without being accepted; what else is refused stays refused."""
    issues = tuple(
        TelemetryIssue(name, (), "fatal", "seen", "mend it") for name in ("effort_is_model", "wrong_time_base")
    )
    report = overrule(TelemetryReport(Session("made", ()), issues), (), REPORTED_BY_A_FIT)
    assert [issue.issue for issue in report.fatal] == ["wrong_time_base"]


# Nobody knows the user, as in a container that was started with a number of its own.
NAMELESS = """
import os, pwd, sys
def unknown(number):
    raise KeyError(f"getpwuid(): uid not found: {number}")
pwd.getpwuid = unknown
os.getuid = lambda: 54321
"""
TRAINING = """
import numpy as np
from ident.model.residual_net import fit_residual_net
states = np.random.default_rng(0).normal(size=(4, 60, 2))
fit_residual_net([tuple(states)], [0.1 * states[3]])
"""
COMMAND = "from ident.cli.start import main\nmain()\n"
RUN = "logs/tm5_900/E1/01_trajectory_1.parquet"


@pytest.mark.parametrize("code", [TRAINING, COMMAND])
def test_who_has_no_home_and_no_name_is_served(code: str, tmp_path: Path) -> None:
    """Reading, compiling, a page and the training of a net: exit 0, no traceback, no word of the home."""
    gone = {"HOME", "USER", "LOGNAME", "LNAME", "USERNAME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"}
    kept = {name: value for name, value in os.environ.items() if name not in gone}
    paths = {"PYTHONPATH": str(Path(__file__).parents[3])}
    arguments = ["view", str(data_path(RUN)), "--robot", "tm5-900", "--rrd", str(tmp_path / "view.rrd")]
    done = subprocess.run(
        [sys.executable, "-c", NAMELESS + code, *arguments],
        cwd=tmp_path,
        env={**kept, **paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "Traceback" in done.stderr, "HOME" in done.stderr) == (0, False, False), done.stderr


# Where a link that turns in a circle stands in for a folder or a file that a command takes.
CIRCLES = {
    "watched folder": "watch {loop} --robot tm5-900 --store {new} --once",
    "store": "watch {cell} --robot tm5-900 --store {loop} --once",
    "robot": "watch {cell} --robot {loop} --store {new} --once",
    "board": "board make {loop} --cases 1 --seed 1",
    "kept answers": "board make {new} --kept {loop} --cases 1 --seed 1",
    "check": "blind --cases 1 --out {loop}",
    "session's settings": "inspect {cell}/monday --robot tm5-900",
}


@pytest.mark.parametrize("place", CIRCLES)
def test_links_that_turn_in_a_circle_are_told(place: str, run: Run, tmp_path: Path) -> None:
    """Law: wherever such a link stands it is told in a line: it is no file, no folder, and nothing to pass over."""
    loop, monday = tmp_path / "loop", tmp_path / "cell/monday"
    loop.symlink_to(loop)
    monday.mkdir(parents=True)
    shutil.copy(ONE_RUN, monday / "run.parquet")
    (monday / "session.toml").symlink_to("session.toml")
    line = CIRCLES[place].format(loop=loop, cell=tmp_path / "cell", new=tmp_path / "new")
    ended = run(*line.split())
    assert ended.status == USER
    assert len(ended.err.strip().splitlines()) == 1
    assert ("session.toml" if place == "session's settings" else "loop") in ended.err
    assert loop.is_symlink()
