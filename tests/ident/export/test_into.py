"""What was found stands in the user's own file, and nothing else of it changed; MuJoCo alone reads it back."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from ident import InputError, diagnose, patch
from ident.export.identified import Diagnosed
from ident.export.printing import print_patch
from ident.export.write import write_patch
from ident.robot.arm import ArmModel
from ident.show.console import PlainConsole
from tests.ident import wrong_friction as arm
from tests.ident.export.diagnoses import write_diagnosis

FACTOR = 1.5
MESH = '<mesh name="lost" file="nowhere.stl"/>'


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], mujoco.MjModel]:
    """URDF, diagnosis and true model of an arm whose friction is 1.5 times what its URDF says."""
    folder = tmp_path_factory.mktemp("into")
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.state_friction())
    more = [tuple(FACTOR * one for one in row) for row in (arm.DAMPING, arm.FRICTION)]
    true = arm.load(arm.state_friction(*more))
    arm.record(true, folder / "session")
    return urdf, diagnose(folder / "session", urdf).to_dict(), true


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A user's MJCF of the same arm: position servos, a sensor, a keyframe, a comment."""
    spec = mujoco.MjSpec.from_string(arm.state_friction())
    for joint in spec.joints:
        servo = spec.add_actuator(name=f"servo_{joint.name}", target=joint.name)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        servo.gainprm[0], servo.biasprm[1] = 400.0, -400.0
    body = mujoco.mjtObj.mjOBJ_BODY
    spec.add_sensor(name="tool", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=body, objname="link_6")
    spec.add_key(name="home", qpos=[0.0, 0.0, 1.2, 0.0, 1.2, 0.0])
    spec.compile()
    path = tmp_path / "mine.xml"
    path.write_text(f"<!-- by hand -->\n{spec.to_xml()}")
    return path


def torques(model: mujoco.MjModel, wanted: np.ndarray) -> np.ndarray:
    """MuJoCo's inverse dynamics along a motion, where every joint slides [N m]."""
    speed = np.gradient(wanted, arm.STEP, axis=0)
    acceleration = np.gradient(speed, arm.STEP, axis=0)
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT)
    found = []
    for row in np.flatnonzero((np.abs(speed) > 0.05).all(axis=1))[::20]:
        data.qpos[:], data.qvel[:], data.qacc[:] = wanted[row], speed[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found)


def off(model: mujoco.MjModel, true: mujoco.MjModel) -> np.ndarray:
    """How far its torques are from the true model's on unseen motion, as a share, joint by joint."""
    wanted = arm.reference(40, 8.0)
    truth = torques(true, wanted)
    return np.linalg.norm(torques(model, wanted) - truth, axis=0) / np.linalg.norm(truth, axis=0)


@pytest.mark.parametrize("form", ["xml", "urdf"])
def test_a_patch_without_a_name_tells_the_torque_of_unseen_motion(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path, form: str
) -> None:
    urdf, record, true = planted
    file = own
    if form == "urdf":
        file = tmp_path / "mine.urdf"
        file.write_text(urdf.read_text())
    rotors = () if form == "xml" else arm.ROTORS
    before = arm.load(file.read_text(), rotors)
    written = patch(record, urdf, tmp_path / "patch", into=file).to_dict()
    after = arm.load(file.read_text(), rotors)
    assert (off(before, true) > 0.1).all()
    assert (off(after, true) < 0.03).all()
    assert (tmp_path / "patch" / f"before_{file.name}").read_text() != file.read_text()
    assert after.dof_damping == pytest.approx(FACTOR * np.array(arm.DAMPING), rel=0.03)
    assert after.dof_frictionloss == pytest.approx(FACTOR * np.array(arm.FRICTION), rel=0.03)
    assert written["identified"] == record["identified"]
    for name in ("robot.xml", "robot.urdf"):
        loaded = arm.load((tmp_path / "patch" / name).read_text(), rotors)
        assert loaded.dof_frictionloss == pytest.approx(FACTOR * np.array(arm.FRICTION), rel=0.03)


def test_nothing_but_joints_and_inertias_changes(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path
) -> None:
    urdf, record, _ = planted
    old_text, old = own.read_text(), mujoco.MjModel.from_xml_path(str(own))
    patch(record, urdf, tmp_path / "patch", into=own)
    new_text, new = own.read_text(), mujoco.MjModel.from_xml_path(str(own))
    changed = re.compile(r"<(joint|inertial) [^>]*>")
    assert changed.sub("", old_text) == changed.sub("", new_text)
    assert old_text != new_text
    kept = "actuator_gainprm actuator_biasprm sensor_type key_qpos geom_size geom_pos jnt_range body_pos body_quat"
    for name in kept.split():
        assert np.array_equal(getattr(old, name), getattr(new, name)), name


def test_what_is_written_already_is_not_added_again(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path
) -> None:
    """Law: a second patch of the same file changes nothing, and says of each link that it is as identified."""
    urdf, record, _ = planted
    first = patch(record, urdf, tmp_path / "first", into=own).to_dict()["into"]
    once = own.read_text()
    again = patch(record, urdf, tmp_path / "second", into=own).to_dict()["into"]
    assert own.read_text() == once
    assert first["links"]
    assert not again["links"]
    assert sum("already" in left for left in again["left"]) == len(first["links"])


def test_a_number_that_is_the_same_keeps_its_text(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], tmp_path: Path
) -> None:
    """Law: of what a file says, text changes only where its number does."""
    urdf, record, _ = planted
    file = tmp_path / "mine.urdf"
    file.write_text(re.sub(r'value="(\d+)\.(\d+)"', r'value="\1.\g<2>000"', urdf.read_text()))
    values = re.compile(r'"([^"]*)"')
    before = values.findall(file.read_text())
    patch(record, urdf, tmp_path / "patch", into=file)
    after = values.findall(file.read_text())
    assert len(before) == len(after)
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert changed
    for old, new in changed:
        numbers = [np.array(text.split(), dtype=float) for text in (old, new)]
        assert not np.allclose(*numbers, rtol=1e-8, atol=0.0)


def test_links_of_other_frames_are_left_and_it_is_told(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path
) -> None:
    urdf, record, _ = planted
    text = own.read_text().replace('name="link_3" pos="0.429 0 0"', 'name="link_3" pos="0.44 0 0"')
    own.write_text(text)
    into = patch(record, urdf, tmp_path / "patch", into=own).to_dict()["into"]
    assert into["links"] == []
    assert any("axes are not where" in line for line in into["left"])
    assert len(into["joints"]) == 6
    inertial = re.compile(r"<inertial [^>]*>")
    assert inertial.findall(own.read_text()) == inertial.findall(text)


def test_a_heavier_link_of_the_users_is_left_and_the_others_are_written(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path
) -> None:
    urdf, record, _ = planted
    own.write_text(own.read_text().replace('mass="0.65"', 'mass="1.65"'))
    into = patch(record, urdf, tmp_path / "patch", into=own).to_dict()["into"]
    assert "link_6" not in into["links"]
    assert "link_5" in into["links"]
    assert any(line.startswith("link_6: ") for line in into["left"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace('name="joint_2"', 'name="elbow"'), "no joint 'joint_2'"),
        (lambda text: text.replace("</worldbody>", f"</worldbody><asset>{MESH}</asset>"), "does not load"),
        (lambda text: text.replace("<mujoco", "<sdf").replace("</mujoco", "</sdf"), "not <robot> or <mujoco>"),
        (lambda text: text[:-40], "not XML"),
    ],
)
def test_a_file_that_can_not_take_it_stays_as_it_was(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel],
    own: Path,
    tmp_path: Path,
    change: Any,
    said: str,
) -> None:
    urdf, record, _ = planted
    text = change(own.read_text())
    own.write_text(text)
    with pytest.raises(InputError, match=said):
        patch(record, urdf, tmp_path / "patch", into=own)
    assert own.read_text() == text


def test_names_that_end_alike_are_one(
    planted: tuple[Path, dict[str, Any], mujoco.MjModel], own: Path, tmp_path: Path
) -> None:
    """A menagerie's `left/joint_1` is the URDF's `joint_1`."""
    urdf, record, _ = planted
    own.write_text(re.sub(r'(name|joint)="(joint_\d)"', r'\1="left/\2"', own.read_text()))
    into = patch(record, urdf, tmp_path / "patch", into=own).to_dict()["into"]
    assert list(into["joints"]) == [f"left/joint_{k}" for k in range(1, 7)]


@pytest.mark.parametrize("name", ["scara", "tiago"])
def test_what_slides_has_its_own_units_in_what_is_printed(name: str, tmp_path: Path) -> None:
    """Law: damping of a slide is N s/m and its rotor a mass, in the table and in what is not written."""
    robot = ArmModel.load(name)
    slides = [joint for joint, is_slide in zip(robot.joint_names, robot.sliding_joints, strict=True) if is_slide]
    figure = {"nominal": 0.0, "value": 3.0, "low": 2.9, "high": 3.1, "low_with_urdf": 2.9, "high_with_urdf": 3.1}
    keys = ("viscous_Nms_rad", "coulomb_Nm", "armature_kgm2")
    figures = {joint: dict.fromkeys(keys, figure) for joint in robot.joint_names}
    path = write_diagnosis(tmp_path / "why.json", robot, "payload", identified=figures)
    own = tmp_path / "own.urdf"
    own.write_text(robot.urdf)
    record = write_patch(Diagnosed.load(path), robot, tmp_path / "patch", into=own)
    assert record["slides"] == slides
    shown = io.StringIO()
    print_patch(PlainConsole(file=shown, width=200), record, tmp_path / "patch")
    text = " ".join(shown.getvalue().split())
    assert "N s/m" in text
    # What a replay in MuJoCo needs beside the file, as the MJCF written beside it has it.
    mjcf = (tmp_path / "patch" / "robot.xml").read_text()
    for setting in re.findall(r'sol(?:ref|imp)friction="[^"]*"', text):
        assert setting in mjcf
    assert text.count('friction="0.') >= 2
    for joint, is_slide in zip(robot.joint_names, robot.sliding_joints, strict=True):
        unit = re.search(rf"{joint} [0-9.e+-]+ (kg m²|kg)\b", text.split("for which a URDF has no place:")[1])
        assert unit is not None
        assert unit[1] == ("kg" if is_slide else "kg m²")
