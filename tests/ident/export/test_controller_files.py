"""Laws of files for Newton and for controllers: another reader finds the arm's own torque in them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.export.friction_files import check_feed_forward, write_feed_forward, write_ur
from ident.export.identified import IdentifiedArm
from ident.export.newton import check_newton, prim_names, write_newton
from ident.laws.motion import Losses
from ident.robot.arm import ArmModel
from tests.ident.made_up import sliding_arm


def _losses(n: int) -> Losses:
    rising = np.arange(1.0, n + 1.0)
    return Losses(0.1 * rising, 8.0 / rising, 6.0 + rising, 0.02 * rising, np.zeros(n))


@pytest.fixture(scope="module", params=["tm5-900", "sliding"])
def identified(request: pytest.FixtureRequest) -> IdentifiedArm:
    arm = ArmModel.load("tm5-900") if request.param == "tm5-900" else sliding_arm()
    return IdentifiedArm.with_losses(arm, _losses(arm.n))


def test_openusd_finds_the_arm_in_newtons_layer(identified: IdentifiedArm, tmp_path: Path) -> None:
    """Bodies, axes, rotors and friction by Newton's own schemas, to single precision, in which USD has them."""
    pytest.importorskip("pxr")
    pytest.importorskip("newton_usd_schemas")
    path = tmp_path / "robot.usda"
    path.write_text(write_newton(identified), encoding="utf-8")
    found = check_newton(path, identified)
    assert found["loads"]
    q = np.zeros((1, identified.nominal.n))
    size = float(np.abs(identified.nominal.inverse_dynamics(q, q + 3.0, q + 5.0)).max())
    assert found["torque_difference_Nm"] < 1e-5 * size


def test_newtons_bodies_stand_where_their_joints_hold_them(identified: IdentifiedArm, tmp_path: Path) -> None:
    """At rest both frames of a joint are one: else a simulator would begin with a jump."""
    pytest.importorskip("pxr")
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    path = tmp_path / "robot.usda"
    path.write_text(write_newton(identified), encoding="utf-8")
    stage = Usd.Stage.Open(str(path))
    poses = UsdGeom.XformCache()
    joints = [UsdPhysics.Joint(prim) for prim in stage.Traverse() if prim.GetTypeName().endswith("ticJoint")]
    joints += [UsdPhysics.Joint(prim) for prim in stage.Traverse() if prim.GetTypeName() == "PhysicsRevoluteJoint"]
    assert len(joints) == identified.nominal.n
    for joint in joints:
        ends = []
        for k in (0, 1):
            body = joint.GetPrim().GetRelationship(f"physics:body{k}").GetTargets()[0]
            place = joint.GetPrim().GetAttribute(f"physics:localPos{k}").Get()
            turn = joint.GetPrim().GetAttribute(f"physics:localRot{k}").Get()
            frame = Gf.Matrix4d(Gf.Rotation(turn), Gf.Vec3d(place))
            ends.append(np.array(frame * poses.GetLocalToWorldTransform(stage.GetPrimAtPath(body))))
        np.testing.assert_allclose(*ends, atol=1e-5)


def test_any_names_become_prims_that_differ() -> None:
    """What USD takes for no name is replaced, and two never become one."""
    assert prim_names(["joint-1", "joint 1", "1st", "", "é"]) == ["joint_1", "joint_1_", "_1st", "_", "__"]


def test_a_yaml_reader_finds_the_friction_of_the_feed_forward(identified: IdentifiedArm, tmp_path: Path) -> None:
    """Both tables to rounding: the tanh all of it, the sigmoid its dry part."""
    pytest.importorskip("yaml")
    path = tmp_path / "feed_forward.yaml"
    path.write_text(write_feed_forward(identified), encoding="utf-8")
    found = check_feed_forward(path, identified)
    assert found["torque_difference_Nm"] < 1e-12
    assert found["crisp_difference_Nm"] < 1e-12


def test_tiny_numbers_stay_numbers_for_a_yaml_reader(tmp_path: Path) -> None:
    """1e-07 without a point would be a text."""
    yaml = pytest.importorskip("yaml")
    arm = sliding_arm()
    tiny = replace(_losses(arm.n), viscous=np.full(arm.n, 1e-7), coulomb=np.full(arm.n, 2e22))
    record = yaml.safe_load(write_feed_forward(IdentifiedArm.with_losses(arm, tiny)))
    row = record["joints"][arm.joint_names[0]]
    assert (row["viscous_Nms_rad"], row["coulomb_Nm"]) == (1e-7, 2e22)


def test_names_of_any_alphabet_stay_what_they_are() -> None:
    """Law: readers of USD and of YAML find each joint under its own name."""
    yaml = pytest.importorskip("yaml")
    sdf = pytest.importorskip("pxr.Sdf")
    arm = ArmModel.load("tm5-900")
    names = ("Gelenk é", "関節", "😀", *arm.joint_names[3:])
    arm = replace(arm, joint_names=names)
    identified = IdentifiedArm.with_losses(arm, _losses(arm.n))
    record = yaml.safe_load(write_feed_forward(identified))
    assert tuple(record["joints"]) == names
    assert tuple(record["crisp_controllers"]["joints"]) == names
    layer = sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(write_newton(identified))
    prims = layer.GetPrimAtPath("/robot").nameChildren
    shown = {prim.GetInfo("displayName") for prim in prims}
    assert set(names) <= shown


def _stated(arm: ArmModel, damping: float, friction: float) -> ArmModel:
    """The arm with friction in its `<dynamics>`."""
    import xml.etree.ElementTree as ET

    root = ET.fromstring(arm.urdf)
    for joint in root.findall("joint"):
        if joint.get("type") == "fixed":
            continue
        for old in joint.findall("dynamics"):
            joint.remove(old)
        ET.SubElement(joint, "dynamics", damping=str(damping), friction=str(friction))
    return ArmModel.from_urdf(ET.tostring(root, encoding="unicode"))


def test_shares_of_a_ur_are_of_what_the_urdf_states() -> None:
    """Half of the stated friction is a share of one half; what is unknown or more than all is refused by joint."""
    yaml = pytest.importorskip("yaml")
    arm = _stated(ArmModel.load("tm5-900"), 8.0, 20.0)
    half = Losses(*(np.full(6, value) for value in (0.1, 4.0, 10.0, 0.02, 0.0)))
    record = yaml.safe_load(write_ur(IdentifiedArm.with_losses(arm, half)))["parameters"]
    assert record == {"viscous_scale": [0.5] * 6, "coulomb_scale": [0.5] * 6}
    with pytest.raises(InputError, match="state no damping of joint_1, joint_2"):
        write_ur(IdentifiedArm.with_losses(_stated(arm, 0.0, 0.0), half))
    with pytest.raises(InputError, match=r"more damping than the controller.s whole model: joint_1 4\.00"):
        write_ur(IdentifiedArm.with_losses(_stated(arm, 1.0, 20.0), half))
    with pytest.raises(InputError, match="has 4 recorded joints, a UR six"):
        write_ur(IdentifiedArm.with_losses(sliding_arm(), _losses(4)))
