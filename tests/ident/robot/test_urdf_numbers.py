"""Numbers of a URDF: what was checked is what the parsers use; and every link hangs from the base."""

import re
from pathlib import Path

import numpy as np
import pytest

from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from plan.api.planning import open_task

# A number, and how else it may be written.
SAME = ("{} ", " {}", "\n{}\n", "\t{}", "+{}", "{}0", "{}e0", "{}E+00", "&#160;{}", "&#8195;{}")
NO_NUMBERS = ("2_443", "٢.٤٤", "２.４", "0x2", "2,443", "1e999", "nan", "inf", "2.4d0", "", "2.4 2.4", "−2", "2.4f")
ARM = """<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0 0 {origin}"/><mass value="{mass}"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><box size="{size} 1 1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 {axis}"/>
<dynamics damping="{damping}" friction="0"/>
<limit lower="-{limit}" upper="{limit}" effort="1" velocity="{limit}"/></joint>{more}</robot>"""
GOOD = {"origin": "0.5", "mass": "2.443", "size": "1.5", "axis": "1", "damping": "0.25", "limit": "1.5", "more": ""}
LOOPS = {
    "its own child": '<link name="c"/><joint name="k" type="fixed"><parent link="c"/><child link="c"/></joint>',
    "two in a ring": '<link name="c"/><link name="d"/><joint name="k" type="fixed"><parent link="c"/><child link="d"/>'
    '</joint><joint name="l" type="fixed"><parent link="d"/><child link="c"/></joint>',
}


def load(**changed: str) -> ArmModel:
    return ArmModel.from_urdf(ARM.format(**{**GOOD, **changed}))


def numbers(arm: ArmModel) -> np.ndarray:
    """All that the parsers made of the numbers."""
    model = arm.model
    parts = (arm.inertial_parameters, arm.lower, arm.upper, arm.velocity_limit, model.damping, arm.chain.axes.ravel())
    return np.concatenate([np.asarray(part, dtype=float) for part in parts])


@pytest.mark.parametrize("form", SAME)
@pytest.mark.parametrize("key", ["origin", "mass", "size", "axis", "damping"])
def test_a_number_is_the_same_however_it_is_written(key: str, form: str) -> None:
    """Law: blanks, signs and exponents change nothing; no parser takes zero for what it can't read."""
    arm, plain = load(**{key: form.format(GOOD[key] if "." in GOOD[key] else GOOD[key] + ".")}), load()
    np.testing.assert_array_equal(numbers(arm), numbers(plain))
    boxes = [[list(shape.geometry.halfSide) for shape in one.geometry.geometryObjects] for one in (arm, plain)]
    assert boxes[0] == boxes[1]


@pytest.mark.parametrize("text", NO_NUMBERS)
@pytest.mark.parametrize("key", ["origin", "mass", "size", "axis", "damping"])
def test_what_parsers_read_in_different_ways_is_no_number(key: str, text: str) -> None:
    with pytest.raises(RobotError, match="give"):
        load(**{key: text})


@pytest.mark.parametrize("way", LOOPS)
def test_links_that_hang_from_themselves_are_refused(way: str) -> None:
    with pytest.raises(RobotError, match="hangs from itself"):
        load(more=LOOPS[way])


def test_the_planner_refuses_them_as_well(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.format(**{**GOOD, "more": LOOPS["its own child"]}))
    (tmp_path / "task.toml").write_text('robot = "arm.urdf"\n[task]\nstart_deg = [0]\ngoal_deg = [9]\nduration_s = 1\n')
    with pytest.raises(RobotError, match="hangs from itself"):
        open_task(tmp_path / "task.toml")


def test_the_shipped_arm_weighs_the_same_with_blanks_in_every_number(tmp_path: Path) -> None:
    """Law: of a whole file, too; with its meshes and by the commands' door."""
    text = Path(data_path("urdf/tm5_900.urdf")).read_text(encoding="utf-8")
    blank = tmp_path / "arm.urdf"
    head, robot = text.split("<robot", 1)
    blank.write_text(f"{head}<robot" + re.sub(r'"([-+0-9. e]+)"', r'" \1 "', robot), encoding="utf-8")
    plain, loaded = ArmModel.load("tm5-900"), ArmModel.load(blank)
    np.testing.assert_array_equal(loaded.inertial_parameters, plain.inertial_parameters)
    np.testing.assert_array_equal(loaded.upper, plain.upper)
