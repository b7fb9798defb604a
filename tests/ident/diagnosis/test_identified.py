"""What the URDF says beside what the recordings say: laws of `identified`, on MuJoCo's recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ident import diagnose
from ident.effects.catalogue import find_effect
from ident.recordings.load import load_session
from ident.robot.names import data_path
from tests.ident import wrong_friction as arm

KEYS = {"nominal", "value", "low", "high", "low_with_urdf", "high_with_urdf"}
FACTOR = 1.5


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The diagnosis of an arm whose friction is 1.5 times what its URDF says, and nothing else."""
    folder = tmp_path_factory.mktemp("friction")
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.state_friction())
    more = [tuple(FACTOR * one for one in row) for row in (arm.DAMPING, arm.FRICTION)]
    arm.record(arm.load(arm.state_friction(*more)), folder / "session")
    return diagnose(folder / "session", urdf).to_dict()


def test_a_friction_half_as_large_again_is_found_within_three_per_cent(
    record: dict[str, Any],
) -> None:
    assert record["verdict"] == "no_gap"
    for j, joint in enumerate(record["joints"]):
        figures = record["identified"][joint]
        rows = (("viscous_Nms_rad", arm.DAMPING), ("coulomb_Nm", arm.FRICTION))
        for key, stated in rows:
            assert figures[key]["nominal"] == stated[j]
            assert figures[key]["value"] == pytest.approx(FACTOR * stated[j], rel=0.03)
        assert figures["armature_kgm2"]["nominal"] is None
        assert figures["armature_kgm2"]["value"] == pytest.approx(arm.ROTORS[j], rel=0.03)


def test_intervals_hold_the_value_and_the_wider_one_holds_the_other(record: dict[str, Any]) -> None:
    joints = (record["identified"][joint] for joint in record["joints"])
    figures = [figure for joint in joints for figure in joint.values()]
    links = record["identified"]["links"].values()
    figures += [link["mass_kg"] for link in links]
    seen = [figure for figure in figures if figure["value"] is not None]
    assert len(seen) > 25
    for figure in seen:
        assert set(figure) - {"change_rms_Nm"} == KEYS
        assert figure["low_with_urdf"] <= figure["low"] <= figure["value"]
        assert figure["value"] <= figure["high"] <= figure["high_with_urdf"]


def test_what_is_true_of_the_urdf_lies_within_its_interval(record: dict[str, Any]) -> None:
    """Nothing but friction is off: rotors, gains, offsets and masses are as planted, most by far within 95 %."""
    pairs = []
    for j, joint in enumerate(record["joints"]):
        figures = record["identified"][joint]
        truths = {"armature_kgm2": arm.ROTORS[j], "torque_gain": 1.0, "offset_Nm": 0.0}
        for key, truth in truths.items():
            pairs.append((figures[key], truth))
    masses = [link["mass_kg"] for link in record["identified"]["links"].values()]
    pairs += [(mass, mass["nominal"]) for mass in masses]
    seen = [(figure, truth) for figure, truth in pairs if figure["value"] is not None]
    assert len(seen) > 15
    inside = [one["low_with_urdf"] <= truth <= one["high_with_urdf"] for one, truth in seen]
    assert sum(inside) >= len(inside) - 2


def test_the_urdf_as_loaded_is_nearer_than_its_rigid_body(record: dict[str, Any]) -> None:
    """`<dynamics>` are part of a URDF: what they state makes it better, though they are a third short."""
    for gap in record["gap"].values():
        assert gap["rms_Nm"] < gap["urdf_rms_Nm"] < 0.5 * gap["rigid_body_rms_Nm"]


def test_a_urdf_that_states_no_friction_says_nothing(tmp_path: Path) -> None:
    """Where a URDF has no `<dynamics>`, its value is null, not zero."""
    from ident.diagnosis.identified import stated_friction
    from ident.robot.arm import ArmModel

    text = arm.state_friction()
    without = text.replace('<dynamics damping="10.0" friction="8.0"/>', "")
    half = without.replace('<dynamics damping="6.0" friction="5.0"/>', '<dynamics damping="6"/>')
    stated = stated_friction(ArmModel.from_urdf(half))
    assert stated["joint_1"] == {"viscous_Nms_rad": 8.0, "coulomb_Nm": 6.0}
    assert stated["joint_2"] == {}
    assert stated["joint_3"] == {"viscous_Nms_rad": 6.0}


def test_the_record_keeps_to_its_schema(record: dict[str, Any]) -> None:
    import jsonschema

    from ident.schemas.publish import make_schema

    jsonschema.validate(record, make_schema("diagnosis"))
    spoilt = {**record, "identified": {"joint_1": {"coulomb_Nm": 3.0}}}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(spoilt, make_schema("diagnosis"))


def test_a_joint_that_stands_still_has_no_value_and_no_error(tmp_path: Path) -> None:
    """Law: what does not move says nothing of its friction; the record is still JSON without infinities."""
    import json

    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    urdf = tmp_path / "arm.urdf"
    urdf.write_text(arm.state_friction())
    session = arm.record(arm.load(arm.state_friction()), tmp_path / "session", runs=5, seconds=5.0)
    for file in session.iterdir():
        table = pq.read_table(file)
        for channel, factor in (("position", 0.0), ("effort", 0.01)):
            name = f"joint_6/{channel}"
            held = pc.multiply(table.column(name), factor)
            table = table.set_column(table.column_names.index(name), name, held)
        pq.write_table(table, file)
    record = diagnose(session, urdf).to_dict()
    json.dumps(record, allow_nan=False)
    still = record["identified"]["joint_6"]
    assert still["coulomb_Nm"]["nominal"] == arm.FRICTION[5]
    assert still["coulomb_Nm"]["value"] is None
    assert "urdf_rms_Nm" not in record["gap"]["joint_6"]
    assert record["identified"]["joint_2"]["coulomb_Nm"]["value"] is not None


def test_no_figure_of_a_reading_is_one_that_no_arm_has() -> None:
    """Law: where something else has the shape of a gain, the gain has no value rather than an absurd one."""
    session = load_session(data_path("logs/tm5_900/E1"))
    gains = [1.0, 1.0, 1.0, 10.0, 1.0, 1.0]
    runs = tuple(run.replace(effort=run.effort * gains) for run in session.runs)
    record = diagnose(replace(session, runs=runs), "tm5-900").to_dict()
    low, high, _ = find_effect("torque_gain_error").bounds["gain"]
    told = [joint["torque_gain"] for joint in record["identified"].values() if "torque_gain" in joint]
    assert sum(gain["value"] is not None for gain in told) >= 3  # those of the other joints stay
    for gain in told:
        assert gain["value"] is None or (gain["high"] >= 1.0 + float(low) and gain["low"] <= 1.0 + float(high))
