"""Laws of edits to a user's own MJCF: the torque is the identified arm's, and all that was not identified stays."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ident.errors import InputError
from ident.export.bodies import Links, moved
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.mjcf import write_mjcf
from ident.export.mjcf_merge import match_joints, merge_mjcf
from ident.export.write import write_export, write_patch
from ident.laws.motion import Losses
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from tests.ident.export.diagnoses import write_diagnosis

NONE = Losses(np.zeros(6), np.zeros(6), np.zeros(6), np.full(6, 0.01), np.zeros(6))
SOME = Losses(np.full(6, 0.3), np.full(6, 5.0), np.full(6, 2.0), np.full(6, 0.01), np.zeros(6))
# A mesh of the user's: a tetrahedron, as an ASCII file.
MESH = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def changed(arm: ArmModel, other: ArmModel) -> IdentifiedArm:
    """An arm that was identified as another, with losses."""
    links = (other.inertial_parameters - arm.inertial_parameters).reshape(-1, 10)
    return IdentifiedArm(arm, SOME, Links(links, 0.0 * links, 0.0))


def foreign_file(arm: ArmModel, folder: Path, hand_kg: float = 0.0) -> Path:
    """The arm as somebody else wrote it: other names, turned base, shifted frame, mesh, servo, comment, a hand."""
    root = ET.fromstring(write_mjcf(IdentifiedArm.with_losses(arm, NONE)))
    for tag in ("actuator", "sensor"):
        root.remove(root.find(tag))
    world = root.find("worldbody")
    base = ET.Element("body", name="pedestal", pos="0.3 -0.2 0.7", quat="0.5 0.5 0.5 0.5")
    for child in list(world):
        world.remove(child)
        base.append(child)
    world.append(base)
    for joint in root.iter("joint"):
        joint.set("name", joint.get("name").replace("joint_", "servo/joint_"))
    *_, last = root.iter("body")
    shift = np.array([0.02, -0.03, 0.05])
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.fromstring(last.get("quat"), sep=" "))
    place = np.fromstring(last.get("pos"), sep=" ") + rotation.reshape(3, 3) @ shift
    last.set("pos", " ".join(map(str, place)))
    last.find("joint").set("pos", " ".join(map(str, -shift)))
    for one in (last.find("inertial"), *last.findall("geom")):
        one.set("pos", " ".join(map(str, np.fromstring(one.get("pos"), sep=" ") - shift)))
    if hand_kg:
        hand = ET.SubElement(last, "body", name="hand", pos="0 0 0.1")
        ET.SubElement(hand, "geom", type="sphere", size="0.03", mass=str(hand_kg))
        finger = ET.SubElement(hand, "body", name="finger")
        ET.SubElement(finger, "joint", name="finger", type="slide")
        ET.SubElement(finger, "geom", type="box", size="0.01 0.01 0.02", mass="0.05")
    (folder / "assets").mkdir(parents=True)
    (folder / "assets/mine.obj").write_text(MESH)
    root.find("compiler").set("meshdir", "assets")
    ET.SubElement(
        root.find("asset") if root.find("asset") is not None else ET.SubElement(root, "asset"), "mesh", file="mine.obj"
    )
    ET.SubElement(base, "geom", type="mesh", mesh="mine", name="picture", contype="0", conaffinity="0")
    ET.SubElement(ET.SubElement(root, "actuator"), "position", name="servo_2", joint="servo/joint_2", kp="900")
    root.insert(0, ET.Comment("what I know of this arm"))
    path = folder / "mine.xml"
    path.write_text(ET.tostring(root, encoding="unicode"))
    return path


def heavier(arm: ArmModel) -> ArmModel:
    """Every link by a tenth heavier, the third by half."""
    links = 1.1 * np.array(arm.inertial_parameters).reshape(-1, 10)
    links[2] *= 1.5
    return arm.with_inertial_parameters(links.ravel())


def test_the_torque_is_the_identified_arms_and_the_rest_is_the_users(arm: ArmModel, tmp_path: Path) -> None:
    source = foreign_file(arm, tmp_path / "mine")
    before = source.read_text()
    (tmp_path / "out").mkdir()
    merged = merge_mjcf(source, tmp_path / "out/robot.xml", changed(arm, heavier(arm)))
    assert merged["torque_difference_Nm"] < 1e-6
    assert merged["joints"]["joint_2"] == "servo/joint_2"
    assert source.read_text() == before
    old, new = (mujoco.MjModel.from_xml_path(str(one)) for one in (source, tmp_path / "out/robot.xml"))
    assert (new.ngeom, new.nmesh, new.nu, new.nbody) == (old.ngeom, old.nmesh, old.nu, old.nbody)
    np.testing.assert_array_equal(new.geom_pos, old.geom_pos)
    np.testing.assert_array_equal(new.actuator_gainprm, old.actuator_gainprm)
    np.testing.assert_array_equal(new.jnt_range, old.jnt_range)
    np.testing.assert_allclose(new.dof_armature, 0.3)
    np.testing.assert_allclose(new.dof_frictionloss, 2.0)
    assert "what I know of this arm" in (tmp_path / "out/robot.xml").read_text()


def test_what_hangs_on_a_link_keeps_its_own_inertia(arm: ArmModel, tmp_path: Path) -> None:
    """The arm with its hand weighs what was identified of both; a hand heavier than that is refused."""
    source = foreign_file(arm, tmp_path / "mine", hand_kg=0.2)
    links = np.array(heavier(arm).inertial_parameters).reshape(-1, 10)
    links[5] += moved(np.array([0.6, 0, 0, 0, 2e-3, 0, 2e-3, 0, 0, 2e-3]), np.eye(3), np.array([0.0, 0.0, 0.1]))
    identified = arm.with_inertial_parameters(links.ravel())
    merged = merge_mjcf(source, tmp_path / "robot.xml", changed(arm, identified))
    assert merged["torque_difference_Nm"] < 1e-6
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert model.body("hand").mass[0] == pytest.approx(0.2)
    heavy = foreign_file(arm, tmp_path / "heavy", hand_kg=9.0)
    with pytest.raises(InputError, match="what hangs on body 'link_6'"):
        merge_mjcf(heavy, tmp_path / "none.xml", changed(arm, identified))
    assert not (tmp_path / "none.xml").exists()


def test_a_file_of_something_else_is_refused(arm: ArmModel, tmp_path: Path) -> None:
    source = foreign_file(arm, tmp_path / "mine")
    text = source.read_text()
    for old, new, what in (
        ("servo/joint_3", "elbow", "has no joint 'joint_3'"),
        ("mujoco", "urdf", "can't be read as MJCF"),
        ("<asset>", '<include file="other.xml"/><asset>', "it includes other files"),
    ):
        source.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=what):
            merge_mjcf(source, tmp_path / "robot.xml", changed(arm, arm))


def test_another_sign_and_another_length_are_refused_with_the_joint(arm: ArmModel, tmp_path: Path) -> None:
    source = foreign_file(arm, tmp_path / "mine")
    tree = ET.parse(source)
    joint = next(one for one in tree.iter("joint") if one.get("name") == "servo/joint_4")
    joint.set("axis", " ".join(str(-float(part)) for part in joint.get("axis").split()))
    tree.write(source)
    with pytest.raises(InputError, match="joint_4 it moves otherwise"):
        merge_mjcf(source, tmp_path / "robot.xml", changed(arm, arm))
    other = foreign_file(arm, tmp_path / "longer")
    tree = ET.parse(other)
    body = next(one for one in tree.iter("body") if one.get("name") == "link_4")
    body.set("pos", " ".join(str(1.1 * float(part)) for part in body.get("pos").split()))
    tree.write(other)
    with pytest.raises(InputError, match="moves otherwise"):
        merge_mjcf(other, tmp_path / "robot.xml", changed(arm, arm))


def test_names_match_by_their_ends_or_not_at_all() -> None:
    assert match_joints(["panda_joint1", "panda_joint2"], ["joint1", "joint2"], Path("f")) == ("joint1", "joint2")
    with pytest.raises(InputError, match="may be any of"):
        match_joints(["joint1"], ["left_joint1", "right_joint1"], Path("f"))


def test_an_export_and_a_patch_take_the_users_file(arm: ArmModel, tmp_path: Path) -> None:
    """The copy in the result's folder loads from there, meshes and all; a tilt turns its gravity in its own world."""
    source = foreign_file(arm, tmp_path / "mine")
    loss = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))
    model = HybridModel(arm, arm, heavier(arm), loss, inertia="consistent")
    record = write_export(model, tmp_path / "export", ("toml",), into=source)
    assert record["merged"]["torque_difference_Nm"] < 1e-6
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "export/merged.xml")).dof_damping[0] == 8.0
    diagnosed = Diagnosed.load(write_diagnosis(tmp_path / "why.json", arm, "gravity_misalignment"))
    record = write_patch(diagnosed, arm, tmp_path / "patch", into=source)
    assert record["merged"]["torque_difference_Nm"] < 1e-6
    gravity = mujoco.MjModel.from_xml_path(str(tmp_path / "patch/merged.xml")).opt.gravity
    assert np.linalg.norm(gravity) == pytest.approx(9.81, abs=0.01)
