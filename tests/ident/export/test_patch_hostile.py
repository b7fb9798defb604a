"""Text from files stays text: whatever a robot, a joint, a session or a diagnosis is called, nothing of it is run."""

import json
import math
import shlex
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from ident.diagnosis.next_experiment import _advise
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.loaded import load_module
from ident.export.write import write_patch
from ident.robot.arm import ArmModel
from ident.safe_read import toml_key
from ident.show.report.diagnosis_pages import write_diagnosis_report
from tests.ident.export.diagnoses import write_diagnosis

CODE = "__import__('pathlib').Path('RUN').touch()"
HOSTILE = [
    f'"""\n{CODE}\n"""',
    f"'''\n{CODE}\n'''",
    f"{{{CODE}}}",
    f"\\\n{CODE}\n#",
    "$(touch RUN) `touch RUN`; touch RUN #",
    "[bold red]x[/] {robot} %s {{ 7 * 7 }}",
    "</title><script>fetch('RUN')</script>",
    "]]> --> <x y='\"'>&amp;&#10;",
    "ü 関節 \u202e ../../RUN",
    "a$x^{$b",
]


def hostile_arm(folder: Path, text: str) -> ArmModel:
    """The shipped arm; it, its joints and its links are called after a hostile text."""
    root = ET.fromstring(ArmModel.load("tm5-900").urdf)
    root.set("name", text)
    for kind in ("link", "joint"):
        for element in root.findall(kind):
            element.set("name", f"{element.get('name')} {text}")
    for tag in ("parent", "child"):
        for element in root.findall(f"joint/{tag}"):
            element.set("link", f"{element.get('link')} {text}")
    path = folder / "robot.urdf"
    ET.ElementTree(root).write(path, encoding="utf-8")
    return ArmModel.load(str(path))


@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_of_a_name_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """Law: every format gives back the names as they were, and no file appears that nobody asked for."""
    monkeypatch.chdir(tmp_path)
    arm = hostile_arm(tmp_path, text)
    path = write_diagnosis(tmp_path / "d.json", arm, "stribeck_friction", "payload", "torque_delay")
    write_patch(Diagnosed.load(path), arm, tmp_path / "patch")
    module = load_module(tmp_path / "patch/extra_torque.py")
    parameters = tomllib.loads((tmp_path / "patch/parameters.toml").read_text(encoding="utf-8"))
    record = json.loads((tmp_path / "patch/patch.json").read_text(encoding="utf-8"))
    urdf = ET.parse(tmp_path / "patch/robot.urdf").getroot()
    for name, joints in (
        (module.ROBOT, module.JOINTS),
        (parameters["robot"], parameters["joints"]),
        (record["robot"], record["joints"]),
        (urdf.get("name"), [joint.get("name") for joint in urdf.findall("joint") if joint.get("type") == "revolute"]),
    ):
        assert name == arm.name
        assert tuple(joints) == arm.joint_names
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["d.json", "patch", "robot.urdf"]


@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_of_a_name_is_a_tag_or_a_word_of_a_shell(tmp_path: Path, text: str) -> None:
    record: dict[str, Any] = {
        "schema": "ident.diagnosis/1",
        "robot": text,
        "joints": [text],
        "session": {"runs": 1, "samples": 1, "duration_s": 1.0},
        "telemetry": [{"issue": text, "joints": [text], "severity": "fatal", "evidence": text, "remedy": text}],
        "verdict": "refused",
        "gap": {},
        "where": [],
        "findings": [],
        "heldout": {"rms_before_Nm": {}, "rms_after_Nm": {}, "shrink": None},
        "not_testable": [{"effect": text, "joints": [text], "reason": text}],
        "next_experiment": None,
        "provenance": {},
    }
    write_diagnosis_report(tmp_path / "page.html", record)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<script>fetch" not in page
    assert "49" not in page.partition("<body")[2].partition("<footer")[0] or "7 * 7" not in text
    motion = str(_advise(["backlash"], "poses", text, text)["motion"])
    command = motion.split("`plan excite", 1)[1].rsplit("` works", 1)[0]
    assert shlex.split(command) == ["--robot", text, "--separate", "backlash", "--joint", text, "--out", "next_motion"]
    assert tomllib.loads(f"{toml_key(text)} = 1") == {text: 1} or "\n" in text


def spoil(name: str, value: object, **figures: object) -> Any:
    return lambda record: record["findings"][0]["parameters"].update({name: figures or value})


@pytest.mark.parametrize(
    "change",
    [
        spoil("amplitude_Nm", {"value": math.nan, "low": 0.0, "high": 1.0}),
        spoil("amplitude_Nm", {"value": math.inf, "low": 0.0, "high": 1.0}),
        spoil("amplitude_Nm", {"value": CODE, "low": 0.0, "high": 1.0}),
        spoil("amplitude_Nm", {"value": 1.0, "low": 0.0, "high": 1.0, CODE: 1.0}),
        spoil("amplitude_Nm", [1.0]),
        spoil("amplitude_Nm", {"value": 10**30, "low": 0.0, "high": 1.0}),
        spoil("stribeck_velocity_rad_s", {"value": -0.5, "low": -0.6, "high": -0.4}),
        lambda record: record.update(joints=[]),
        lambda record: record.update(joints=[3, {}]),
        lambda record: record["baseline"]["joint_2"].update(viscous_Nms_rad=-3.0),
        lambda record: record["baseline"]["joint_2"].update(coulomb_Nm=math.inf),
        lambda record: record["baseline"].update(joint_2=[]),
        lambda record: record["baseline"]["joint_2"]["link_change"].update(mass_kg=CODE),
        lambda record: record["findings"][0].update(joints=[]),
        lambda record: record["findings"][0].update(effect={}),
    ],
)
def test_figures_that_no_arm_has_are_refused(tmp_path: Path, arm: ArmModel, change: Any) -> None:
    """Law: a diagnosis that was tampered with is told to be so; nothing is written."""
    path = write_diagnosis(tmp_path / "d.json", arm, "stribeck_friction")
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"d\.json"):
        write_patch(Diagnosed.load(path), arm, tmp_path / "patch")
    assert [entry.name for entry in tmp_path.iterdir()] == ["d.json"]
