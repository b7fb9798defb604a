"""The first name, its action and the first place are about one joint: on planted gaps and on development recordings."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ident import diagnose
from ident.diagnosis.result import Diagnosis
from ident.robot.arm import ArmModel
from tests.ident.diagnosis import planted
from tests.ident.diagnosis.contract import check_places

SLOW = pytest.mark.slow
# Sessions by folder of the development recordings, with their URDF beside.
REAL = ("airbot_play", "rokae_ar5")
OTHER_WORLD = ("session_a03", "session_a05", "session_b00", "session_b03", "session_b04")


def check_first_place(diagnosis: Diagnosis) -> None:
    """The first place is at a joint of the first name; a session without a gap has no place."""
    check_places(diagnosis.to_dict())
    if diagnosis.verdict == "no_gap":
        assert not diagnosis.where
    elif diagnosis.findings:
        first = diagnosis.findings[0]
        assert diagnosis.where[0].joint in first.joints
        assert diagnosis.where[0].joint in first.action


@pytest.mark.parametrize(
    "plant",
    [
        planted.nothing,
        planted.stribeck_on_1,
        planted.load_friction_on_2,
        pytest.param(planted.spring_on_3, marks=SLOW),
        pytest.param(planted.gain_on_2, marks=SLOW),
    ],
)
def test_places_of_a_planted_gap(short_arm: ArmModel, plant: planted.Plant) -> None:
    diagnosis = planted.analyse(short_arm, plant).diagnosis
    check_first_place(diagnosis)
    assert bool(diagnosis.findings) == (plant is not planted.nothing)


def of_files(session: Path, robot: Path) -> Diagnosis:
    return diagnose(session, robot)


@SLOW
@pytest.mark.real
@pytest.mark.parametrize("folder", REAL)
def test_places_of_real_recordings(real_data: Path, folder: str) -> None:
    check_first_place(of_files(real_data / folder, real_data / folder / "robot.urdf"))


@SLOW
@pytest.mark.parametrize("session", OTHER_WORLD)
def test_places_of_another_simulator(session: str) -> None:
    home = os.environ.get("IDENT_OTHER_WORLD")
    if not home:
        pytest.skip("set IDENT_OTHER_WORLD to a folder of sessions of another simulator")
    check_first_place(of_files(Path(home) / session, Path(home) / "robot.urdf"))
