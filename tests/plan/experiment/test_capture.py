"""Laws of a capture: what a controller is sent is the motion, step by step, and nothing else lies in the folder."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pyarrow.csv as pacsv
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.trajectories.files import read_commands
from ident.trajectories.reference import ReferenceMotion, via_spline
from plan.api.exciting import excite
from plan.experiment.capture import (
    SLOWER,
    TABLES,
    choose_format,
    execution_of,
    slowed,
    steps_of,
    write_capture,
)
from plan.experiment.result import Excitation

# Half a millimetre at a metre: less than any path's clearance [rad].
NEAR = 5e-4
NAMES = ("tmscript", "tm_ros2", "ros2_control")


@pytest.fixture(scope="module")
def motion() -> ReferenceMotion:
    """Six joints to and fro, from rest to rest."""
    points = np.random.default_rng(4).uniform(-0.5, 0.5, (7, 6))
    points[[0, -1]] = 0.0
    return via_spline("to_and_fro", points, 6.0)


@pytest.fixture(scope="module")
def found() -> Excitation:
    return excite("tm5-900", separate="backlash,payload", minutes=0.2, evaluations=8)


@pytest.mark.parametrize("name", NAMES)
def test_what_the_controller_makes_of_it_is_the_motion(motion: ReferenceMotion, whole: ArmModel, name: str) -> None:
    execution, miss = execution_of(motion, whole.joint_names, choose_format(name, whole))
    assert miss < NEAR
    np.testing.assert_allclose(execution.q[[0, -1]], motion.q[[0, -1]], atol=1e-6)
    assert execution.duration >= motion.duration - 1e-9


def test_the_slow_test_goes_the_same_way(motion: ReferenceMotion) -> None:
    """Law: every place of it is a place of the motion, at a share of its speed."""
    slow = slowed(motion, SLOWER)
    assert slow.duration == pytest.approx(SLOWER * motion.duration)
    np.testing.assert_allclose(slow.q[::SLOWER], motion.q, atol=1e-9)
    np.testing.assert_allclose(slow.dq[::SLOWER], motion.dq / SLOWER, atol=1e-9)


def test_held_out_runs_are_at_the_same_places_the_other_way(motion: ReferenceMotion) -> None:
    *_, held_out = steps_of([motion])
    (back,) = held_out.motions
    np.testing.assert_array_equal(back.q, motion.q[::-1])
    np.testing.assert_array_equal(back.dq, -motion.dq[::-1])
    assert held_out.session != steps_of([motion])[2].session


def test_every_file_is_told_with_its_digest(found: Excitation, whole: ArmModel, tmp_path: Path) -> None:
    """Law: the record names all files of the steps, and each is what its digest says."""
    write_capture(found, tmp_path / "motion", choose_format("tmscript", whole))
    record = json.loads((tmp_path / "motion" / "capture.json").read_text(encoding="utf-8"))
    told = {}
    for step in record["steps"]:
        for file in step["files"]:
            told[file["file"]] = file["sha256"]
    scripts = (tmp_path / "motion").rglob("*.tmscript")
    seen = {path.relative_to(tmp_path / "motion").as_posix(): path for path in scripts}
    assert told.keys() == seen.keys()
    for name, path in seen.items():
        assert hashlib.sha256(path.read_bytes()).hexdigest() == told[name]
    assert read_commands(tmp_path / "motion", whole)[0].duration == pytest.approx(found.runs[0].duration, abs=0.004)


def test_tables_are_the_motions_samples(found: Excitation, whole: ArmModel, tmp_path: Path) -> None:
    write_capture(found, tmp_path / "motion", choose_format(TABLES, whole))
    first = min((tmp_path / "motion" / "3_record").glob("*.csv"))
    table = pacsv.read_csv(first)
    q = table["joint_2/position_command"].to_numpy()
    assert q[-1] == pytest.approx(found.runs[0].q[-1, 1])
    assert np.ptp(q) == pytest.approx(np.ptp(found.runs[0].q[:, 1]), abs=1e-3)


def test_another_arms_controller_is_refused(whole: ArmModel) -> None:
    with pytest.raises(InputError, match="or csv"):
        choose_format("ur_servoj", whole)
