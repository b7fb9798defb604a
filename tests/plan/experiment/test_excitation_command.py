"""`plan excite` from its options to its files."""

import json
from pathlib import Path
from typing import Any

import pyarrow.csv as pacsv
import pytest
from typer.testing import CliRunner

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.trajectories.files import read_commands
from plan.cli.app import app
from plan.experiment.hypotheses import ask
from tests.schemas import check_file

JOINTS = [f"joint_{k}" for k in range(1, 7)]


def diagnosis(path: Path, **changes: Any) -> Path:
    """A diagnosis in which Stribeck friction of joint 3 is tied to hysteresis."""
    tied = {
        "effect": "stribeck_friction",
        "joints": ["joint_3"],
        "class": ["stribeck_friction", "presliding_hysteresis"],
        "parameters": {
            "amplitude_Nm": {"value": 4.0, "low": 3.0, "high": 5.0},
            "stribeck_velocity_rad_s": {"value": 0.03, "low": 0.02, "high": 0.04},
        },
    }
    record = {
        "schema": "ident.diagnosis/1",
        "joints": JOINTS,
        "gap": {name: {"noise_floor_Nm": 0.4} for name in JOINTS},
        "findings": [tied],
        "not_testable": [],
    }
    path.write_text(json.dumps({**record, **changes}))
    return path


@pytest.mark.slow
def test_writes_a_motion_that_the_simulated_arm_reads(tmp_path: Path, whole: ArmModel) -> None:
    """One command: a folder of command files and a record that agree with each other."""
    out, record_file = tmp_path / "motion", tmp_path / "excite.json"
    pair = "stribeck_friction,presliding_hysteresis"
    arguments = ["excite", "--separate", pair, "--joint", "2", "--minutes", "0.3"]
    outcome = CliRunner().invoke(app, [*arguments, "--evaluations", "8", "--out", str(out), "--json", str(record_file)])
    assert outcome.exit_code == 0, outcome.output
    assert "tells stribeck_friction and presliding_hysteresis apart" in outcome.output
    record = json.loads(record_file.read_text())
    assert record["schema"] == "plan.excite/1"
    assert record == json.loads((out / "excite.json").read_text())
    assert record["separates"] == ["stribeck_friction", "presliding_hysteresis"]
    assert record["joint"] == "joint_2"
    assert set(record["distance"]["proposed"]) == {
        "stribeck_friction against presliding_hysteresis",
        "presliding_hysteresis against stribeck_friction",
    }
    assert record["minutes_to_20_to_1"] > 0.0
    assert record["motion"]["clearance_m"] > 0.0
    motions = read_commands(out, whole)
    assert len(motions) == record["motion"]["runs"] == len(record["motion"]["files"])
    assert sum(motion.duration for motion in motions) == pytest.approx(60.0 * record["motion"]["minutes"], abs=0.1)
    table = pacsv.read_csv(out / record["motion"]["files"][0])
    assert table.column_names[:3] == ["time", "joint_1/position_command", "joint_1/velocity_command"]


def test_exact_twins_need_another_set_up(tmp_path: Path) -> None:
    """No search for what no motion can do: the advice, and motion to be recorded before and after."""
    arguments = ["excite", "--separate", "torque_gain_error,all_masses", "--minutes", "0.3"]
    outcome = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "excite.json")])
    assert outcome.exit_code == 0, outcome.output
    assert "no motion tells" in outcome.output
    assert "[payload] in session.toml" in outcome.output  # no brackets lost to the console's markup
    record = check_file(tmp_path / "excite.json")
    assert record["status"] == "needs_set_up"
    assert "known mass" in record["set_up"]
    assert record["motion"]["runs"] > 0


def test_the_diagnosis_asks_its_own_question(tmp_path: Path, whole: ArmModel) -> None:
    """Its first tied class, at its joint, with its sizes and its noise."""
    asked = ask(whole, None, None, diagnosis(tmp_path / "d.json"))
    assert (asked.aim, asked.ids, asked.joint) == ("separate", ("stribeck_friction", "presliding_hysteresis"), 2)
    assert asked.reported["stribeck_friction"]["amplitude_Nm"] == 4.0
    assert asked.noise.tolist() == [0.4] * 6


def test_what_could_not_be_tested_is_shown(tmp_path: Path, whole: ArmModel) -> None:
    """Without a tied class: the effects that one kind of motion shows, at the joint that lacks it."""
    unseen = [
        {"effect": name, "joints": ["joint_5"], "reason": "still"} for name in ("torque_delay", "joint_elasticity")
    ]
    asked = ask(whole, None, None, diagnosis(tmp_path / "d.json", findings=[], not_testable=unseen))
    assert (asked.aim, asked.ids, asked.joint) == ("show", ("torque_delay", "joint_elasticity"), 4)
    assert asked.family == "chirp"


def test_without_a_question_the_inertias_are_asked_for(whole: ArmModel) -> None:
    """The general motion: no effects, wide motion, the joint that carries most."""
    asked = ask(whole, None, None, None)
    assert (asked.aim, asked.ids, asked.family, asked.joint) == ("identify", (), "wide", 1)


@pytest.mark.parametrize(
    ("separate", "joint", "words"),
    [
        ("stribek_friction,torque_delay", None, "there is no effect 'stribek_friction'"),
        ("torque_delay,torque_offset", "joint_9", "no joint 'joint_9'"),
        ("torque_delay,torque_offset", "0", "no joint '0'"),
    ],
)
def test_wrong_options_are_refused(whole: ArmModel, separate: str, joint: str | None, words: str) -> None:
    """One line that names what is wrong and what there is."""
    with pytest.raises(InputError, match=words):
        ask(whole, separate, joint, None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "ident.fit/1"}, "is no ident.diagnosis/1"),
        ({"joints": ["elbow"]}, "elbow"),
        ({"robot": "other"}, "it is of 'other', the robot is"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, whole: ArmModel, changes: dict[str, Any], words: str) -> None:
    """A file of something else, or of another arm though its joints have the same names, is the user's mistake."""
    with pytest.raises(InputError, match=words):
        ask(whole, None, None, diagnosis(tmp_path / "d.json", **changes))


def test_a_foreign_folder_is_not_replaced(tmp_path: Path) -> None:
    """A folder that holds anything else stays."""
    (tmp_path / "thesis.tex").write_text("years")
    outcome = CliRunner().invoke(app, ["excite", "--out", str(tmp_path)])
    assert isinstance(outcome.exception, InputError)
    assert (tmp_path / "thesis.tex").read_text() == "years"
