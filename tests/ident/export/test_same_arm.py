"""An arm is known by what it is, not by its name; ranges are written for trainers."""

import ast
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.export.controllers import DRAWN, write_ranges
from ident.export.identified import Diagnosed
from ident.export.write import write_export, write_patch
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.sessions import open_sessions
from tests.ident.export.diagnoses import write_diagnosis
from tests.ident.made_up import made_session

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))


@pytest.fixture(scope="module")
def other(arm: ArmModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The URDF of an arm of the same name and joints, whose third link is heavier."""
    path = tmp_path_factory.mktemp("other") / "robot.urdf"
    root = ET.fromstring(arm.urdf)
    next(one for one in root.findall("link") if one.get("name") == arm.links[2]).find("inertial/mass").set("value", "9")
    ET.ElementTree(root).write(path)
    return path


def test_a_patch_of_another_arm_of_the_same_name_is_refused(arm: ArmModel, other: Path, tmp_path: Path) -> None:
    path = write_diagnosis(tmp_path / "d.json", arm, "payload")
    record = json.loads(path.read_text())
    record["provenance"] = {"settings": {"arm_sha256": arm.content}, "sessions": [{"runs": ["0123456789ab"]}]}
    path.write_text(json.dumps(record))
    assert Diagnosed.load(path).runs == {"0123456789ab"}
    write_patch(Diagnosed.load(path), arm, tmp_path / "patch")
    with pytest.raises(InputError, match="another arm than"):
        write_patch(Diagnosed.load(path), ArmModel.load(str(other)), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_urdf_that_changed_since_the_fit_is_refused(arm: ArmModel, other: Path, tmp_path: Path) -> None:
    """Law: what was identified is not written into another arm; where the file is gone, the model has its own."""
    path = tmp_path / "robot.urdf"
    path.write_text(arm.urdf)
    HybridModel(*[ArmModel.load(str(path))] * 3, LOSS).save(tmp_path / "model")
    write_export(HybridModel.load(tmp_path / "model"), tmp_path / "same")
    path.write_text(other.read_text())
    with pytest.raises(InputError, match=r"robot\.urdf: its joints, lengths or inertias are no longer"):
        write_export(HybridModel.load(tmp_path / "model"), tmp_path / "none")
    assert not (tmp_path / "none").exists()
    path.unlink()
    write_export(HybridModel.load(tmp_path / "model"), tmp_path / "own")
    assert (tmp_path / "own").exists()


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
def test_an_arm_whose_file_has_joints_that_were_not_recorded_is_exported(
    arm: ArmModel, kind: str, tmp_path: Path
) -> None:
    """Law: a joint that the recordings lack is locked in the model as it was in the fit, and the file is the arm's."""
    root = ET.fromstring(arm.urdf)
    beyond = ET.SubElement(root, "link", name="beyond")
    inertial = ET.SubElement(beyond, "inertial")
    ET.SubElement(inertial, "origin", xyz="0.03 0 0.05")
    ET.SubElement(inertial, "mass", value="0.4")
    ET.SubElement(inertial, "inertia", ixx="1e-3", iyy="1e-3", izz="1e-3", ixy="0", ixz="0", iyz="0")
    joint = ET.SubElement(root, "joint", name="not_recorded", type=kind)
    ET.SubElement(joint, "origin", xyz="0 0 0.1", rpy="0.2 0 0")
    ET.SubElement(joint, "parent", link=arm.links[-1])
    ET.SubElement(joint, "child", link="beyond")
    ET.SubElement(joint, "axis", xyz="1 0 0")
    ET.SubElement(joint, "limit", lower="0.1", upper="0.5", effort="10", velocity="1")
    path = tmp_path / "robot.urdf"
    ET.ElementTree(root).write(path)
    recorded = ArmModel.load(str(path)).keeping(arm.joint_names)
    HybridModel(*[recorded] * 3, LOSS).save(tmp_path / "model")
    model = HybridModel.load(tmp_path / "model")
    assert model.robot.locked_joints == recorded.locked_joints
    write_export(model, tmp_path / "files")
    again = ArmModel.load(str(tmp_path / "files" / "robot.urdf"))
    assert again.keeping(arm.joint_names).content == recorded.content


def test_recordings_of_another_arm_are_not_evaluated(arm: ArmModel, other: Path, tmp_path: Path) -> None:
    """Law: where session.toml names a robot, it must be the model's."""
    model = HybridModel(arm, arm, arm, LOSS)
    folder = tmp_path / "session"
    folder.mkdir()
    write_session(made_session(arm, model.torque, [1], duration=3.0), folder)
    (folder / "session.toml").write_text('robot = "tm5-900"\n')
    assert open_sessions([folder], model, learning=False).motions
    (folder / "session.toml").write_text(f"robot = {json.dumps(str(other))}\n")
    with pytest.raises(InputError, match="lengths or inertias differ"):
        open_sessions([folder], model, learning=False)


def test_ranges_are_written_for_trainers(tmp_path: Path) -> None:
    """Law: both files are Python whose tables are the ranges, never below zero; joints without a range are named."""
    known = {"rotor": (0.1, 0.2), "viscous": (-0.5, 3.0), "coulomb": (1.0, 2.0), "gain": (0.9, 1.1)}
    left = write_ranges(tmp_path / "out", 'x"""y', {"a": known, "b": {"rotor": (0.1, 0.2)}})
    assert left == ["b"]
    for name in ("isaaclab_ranges.py", "playground_ranges.py"):
        tree = ast.parse((tmp_path / "out" / name).read_text(encoding="utf-8"))
        values = {ast.unparse(one.targets[0]): one.value for one in tree.body if isinstance(one, ast.Assign)}
        found = ast.literal_eval(values["RANGES"])
        assert ast.literal_eval(values["JOINTS"]) == ("a",)
        assert set(found) == set(DRAWN)
        assert found["damping"] == [(0.0, 3.0)]


def test_isaac_lab_draws_each_joint_within_its_range(tmp_path: Path) -> None:
    """Law: what is written to an articulation lies within the tables, one value a joint and environment."""
    torch = pytest.importorskip("torch")
    table = {"rotor": (0.1, 0.2), "viscous": (2.0, 3.0), "coulomb": (5.0, 5.0)}
    write_ranges(tmp_path / "out", "arm", {"a": table, "b": table})
    space: dict[str, object] = {}
    exec((tmp_path / "out" / "isaaclab_ranges.py").read_text(encoding="utf-8"), space)
    written: dict[str, object] = {}

    class Asset:
        device = "cpu"

        def find_joints(self, names: list[str], preserve_order: bool) -> tuple[list[int], list[str]]:
            return [3, 1], names

        def write_joint_armature_to_sim(self, values: object, joint_ids: object, env_ids: object) -> None:
            written["armature"] = values

        def write_joint_friction_coefficient_to_sim(self, *values: object, joint_ids: object, env_ids: object) -> None:
            written.update(zip(("static", "friction", "damping"), values, strict=True))

    scene = type("Scene", (dict,), {"num_envs": 4})(robot=Asset())
    env, asset = type("Env", (), {"scene": scene})(), type("Cfg", (), {"name": "robot"})()
    space["randomize_joints"](env, None, asset)  # type: ignore[operator]
    for name, (low, high) in (("armature", table["rotor"]), ("damping", table["viscous"]), ("static", (5.0, 5.0))):
        values = torch.as_tensor(written[name])
        assert values.shape == (4, 2)
        assert bool(((values >= low) & (values <= high)).all())
