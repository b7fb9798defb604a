"""Gaps before and after: on motions whose torque is known, a right patch leaves nothing, in torque and in motion."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from ident.arrays import Array
from ident.cli.app import app
from ident.export.identified import Diagnosed
from ident.export.write import write_patch
from ident.recordings.recording import Payload
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.export.diagnoses import COULOMB, FIGURES, ROTOR, VISCOUS, write_diagnosis
from tests.ident.made_up import made_motions, made_session

Law = Callable[[Array, Array, Array], Array]


@pytest.fixture(autouse=True)
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six windows say enough where the law is known."""
    monkeypatch.setattr("ident.export.choose.MOST_WINDOWS", 6)


def healthy(arm: ArmModel) -> Law:
    """Torque of the arm with the losses of the hand-written diagnoses."""
    return lambda q, dq, ddq: (
        arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + VISCOUS * dq + COULOMB * np.tanh(dq / 0.01)
    )


def measure(folder: Path, arm: ArmModel, effect: str, law: Law) -> dict[str, Any]:
    """Gaps of the patch of an effect on a run with a law."""
    diagnosed = Diagnosed.load(write_diagnosis(folder / "diagnosis.json", arm, effect))
    motions = made_motions(arm, law, [3], duration=6.0)
    return dict(write_patch(diagnosed, arm, folder / "patch", motions)["heldout"]["gaps"])


def torque(gap: dict[str, Any]) -> float:
    return float(np.max(list(gap["torque_rms_Nm"].values())))


def miss(gap: dict[str, Any]) -> float:
    return float(np.max(list(gap["position_rms_rad"].values())))


def loaded(arm: ArmModel) -> Law:
    """The same arm with the payload of `FIGURES`, as the identification carries payloads."""
    figures = FIGURES["payload"]
    x, y, z = (figures[f"com_{axis}_m"] for axis in "xyz")
    return healthy(arm.with_payload(Payload(figures["mass_kg"], (x, y, z))))


def sprung(arm: ArmModel) -> Law:
    spring = FIGURES["spring_torque"]
    pull = np.eye(6)[1] * spring["stiffness_Nm_rad"]
    return lambda q, dq, ddq: healthy(arm)(q, dq, ddq) + pull * (q - spring["rest_rad"])


def misread(arm: ArmModel) -> Law:
    gain = np.ones(6) + np.eye(6)[1] * FIGURES["torque_gain_error"]["gain"]
    return lambda q, dq, ddq: gain * healthy(arm)(q, dq, ddq)


def rough(arm: ArmModel) -> Law:
    """Stribeck friction of joint 2."""
    return lambda q, dq, ddq: (
        healthy(arm)(q, dq, ddq) + 4.0 * np.eye(6)[1] * np.tanh(dq / 0.01) * np.exp(-((dq / 0.5) ** 2))
    )


@pytest.mark.parametrize(
    ("effect", "law"), [("payload", loaded), ("spring_torque", sprung), ("torque_gain_error", misread)]
)
def test_a_patch_explains_what_its_effect_does(
    tmp_path: Path, arm: ArmModel, effect: str, law: Callable[[ArmModel], Law]
) -> None:
    """In MuJoCo the patch closes the gap of torque and of motion; with the module, in Pinocchio too."""
    gaps = measure(tmp_path, arm, effect, law(arm))
    for form, when in (("mjcf", "after"), ("mjcf", "after_with_module"), ("urdf", "after_with_module")):
        assert torque(gaps[form]["before"]) > 0.5
        assert torque(gaps[form][when]) < 0.1 * torque(gaps[form]["before"])
        assert miss(gaps[form][when]) < 0.5 * miss(gaps[form]["before"])


def test_what_a_file_can_not_say_its_module_adds(tmp_path: Path, arm: ArmModel) -> None:
    """Stribeck friction is in neither file: what is written is no worse than without it, and the module closes it."""
    gaps = measure(tmp_path, arm, "stribeck_friction", rough(arm))
    for found in gaps.values():
        assert torque(found["after"]) <= 1.01 * torque(found["before"])
        assert miss(found["after"]) <= 1.01 * miss(found["before"])
        assert torque(found["after_with_module"]) < 0.1 * torque(found["before"])


def test_the_command_writes_measures_and_tells(tmp_path: Path, arm: ArmModel) -> None:
    """`ident patch … --on SESSION` prints what each format says, and writes the gaps."""
    diagnosis = write_diagnosis(tmp_path / "diagnosis.json", arm, "payload", "stribeck_friction")
    session = tmp_path / "session"
    session.mkdir()
    write_session(made_session(arm, loaded(arm), [1], duration=6.0), session)
    out, record = tmp_path / "patch", tmp_path / "record.json"
    words = [str(diagnosis), "--robot", "tm5-900", "--out", str(out), "--on", str(session), "--json", str(record)]
    result = CliRunner().invoke(app, ["patch", *words])
    assert result.exit_code == 0, result.output
    assert "payload: urdf yes, mjcf yes, parameters yes, module yes" in result.output
    assert "stribeck_friction: urdf no, mjcf no, parameters yes, module yes" in result.output
    written = json.loads((out / "patch.json").read_text())
    assert written == json.loads(record.read_text())
    assert written["schema"] == "ident.patch/1"
    assert set(written["heldout"]["gaps"]["mjcf"]) == {"before", "tuned", "after", "after_with_module"}
