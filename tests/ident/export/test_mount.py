"""What was found of an arm's mount is written: every file of a patch feels gravity as the recordings did."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.api.exporting import patch
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.mjcf import write_mjcf
from ident.export.urdf import write_urdf
from ident.robot.arm import ArmModel
from tests.ident.export.diagnoses import write_diagnosis

WALL, CEILING = (9.81, 0.0, 0.0), (0.0, 0.0, 9.81)
POSES = np.random.default_rng(3).uniform(-1.5, 1.5, (20, 6))


def diagnosed(folder: Path, arm: ArmModel, gravity: tuple[float, ...], *effects: str) -> Path:
    origin = {"command": "ident diagnose", "settings": {"gravity_mps2": list(gravity)}, "sessions": []}
    return write_diagnosis(folder / "why.json", arm, *effects, provenance=origin)


@pytest.mark.parametrize("gravity", [WALL, CEILING, (1.0, -2.0, -9.0)])
@pytest.mark.parametrize("effects", [("torque_offset",), ("gravity_misalignment",)])
def test_the_urdf_stands_as_the_arm_was_mounted(
    gravity: tuple[float, ...], effects: tuple[str, ...], tmp_path: Path, arm: ArmModel
) -> None:
    found = Diagnosed.load(diagnosed(tmp_path, arm, gravity, *effects)).candidates(arm)["after"]
    (tmp_path / "robot.urdf").write_text(write_urdf(found), encoding="utf-8")
    written = ArmModel.load(tmp_path / "robot.urdf").keeping(arm.joint_names)
    wanted = arm.with_gravity(found.gravity * 9.81 / np.linalg.norm(found.gravity)).gravity(POSES)
    assert np.abs(written.gravity(POSES) - wanted).max() < 1e-6
    assert f'gravity="{" ".join(map(repr, map(float, found.gravity)))}"' in write_mjcf(found)


def test_a_level_base_stays_as_it_is(arm: ArmModel) -> None:
    level = IdentifiedArm.as_urdf(arm)
    turned = IdentifiedArm.as_urdf(arm.with_gravity(Rotation.from_euler("y", 90, degrees=True).apply([0, 0, -9.81])))
    assert level.is_level
    assert 'name="level"' not in write_urdf(level)
    assert not turned.is_level


def test_a_patch_says_how_its_base_hangs(tmp_path: Path, arm: ArmModel) -> None:
    written = patch(diagnosed(tmp_path, arm, WALL, "torque_offset"), arm, tmp_path / "patch")
    record = json.loads((tmp_path / "patch" / "patch.json").read_text(encoding="utf-8"))
    assert any("(9.81 0.00 0.00)" in line for line in record["told"])
    for form in written.record["structure"].values():
        assert "worst" not in form or form["worst"] < 1.0
