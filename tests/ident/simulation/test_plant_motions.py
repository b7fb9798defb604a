"""Laws of the motions: from rest to rest, smooth, within limits, free of self-collision, and each of its kind."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from ident.errors import InputError, RecordingError
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate
from ident.trajectories.files import read_commands
from ident.trajectories.kinds import KINDS, plan_motions
from ident.trajectories.motion_limits import MotionLimits


@pytest.fixture(scope="module")
def planned(arm):
    return {kind: plan_motions(arm, [kind], 2, 6.0, np.random.default_rng(7)) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_motions_keep_limits_and_rest_at_both_ends(arm, planned, kind):
    limits = MotionLimits(arm)
    for motion in planned[kind]:
        assert (motion.q > arm.lower).all()
        assert (motion.q < arm.upper).all()
        assert (np.abs(motion.dq) < arm.velocity_limit).all()
        torque = arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)
        assert (np.abs(torque) < 0.6 * arm.effort_limit).all()
        assert not limits.touches(motion.q)
        for values in (motion.dq, motion.ddq):
            np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-9)


@pytest.mark.parametrize(
    "robot", ["baxter:left_w2", "talos_left_arm:arm_left_7_joint", "g1_29dof_rev_1_0:left_wrist_yaw_joint"]
)
def test_an_arm_that_cannot_stand_in_the_middle_of_its_limits_moves_elsewhere(robot: str) -> None:
    """Law: an arm too weak to hold itself out straight, or one that touches its body, has motions all the same."""
    arm = ArmModel.load(robot)
    limits = MotionLimits(arm)
    halfway = 0.5 * (limits.lower + limits.upper)
    zero = np.where(np.abs(halfway) < 0.25 * (limits.upper - limits.lower), 0.0, halfway)
    assert not limits.can_rest(zero[None])
    assert limits.can_rest(limits.centre[None])
    for motion in plan_motions(arm, ["spline"], 1, 4.0, np.random.default_rng(2)):
        assert limits.stays_within(motion)


@pytest.mark.parametrize(
    ("kinds", "runs", "duration", "expected"),
    [
        (["waltz"], 2, 5.0, "spline"),
        ([], 2, 5.0, "spline"),
        (["spline"], 0, 5.0, "one run"),
        (["spline"], 1, 0.1, "3600"),
    ],
)
def test_bad_requests_are_refused(arm, kinds, runs, duration, expected):
    with pytest.raises(InputError, match=expected):
        plan_motions(arm, kinds, runs, duration, np.random.default_rng(0))


JOINTS = ("joint_1", "joint_2")


@pytest.fixture(scope="module")
def two_joints() -> ArmModel:
    return ArmModel.load("tm5-900", joints=JOINTS)


def table(seconds: float = 2.0, rate: float = 250.0) -> dict[str, np.ndarray]:
    """A swing of 0.4 rad and back, from rest to rest."""
    time = np.arange(round(seconds * rate) + 1) / rate
    swing = 0.2 * (1.0 - np.cos(2.0 * np.pi * time / seconds))
    return {"time": time, **{f"{name}/position_command": swing * (k + 1) for k, name in enumerate(JOINTS)}}


def written(path: Path, columns: dict[str, np.ndarray]) -> Path:
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        pacsv.write_csv(pa.table(columns), path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_commands_come_back_as_motion(tmp_path: Path, two_joints: ArmModel, suffix: str) -> None:
    """At the controller's ticks the motion is the file's curve, with its speed and from rest to rest."""
    motion = read_commands(written(tmp_path / f"01_swing{suffix}", table()), two_joints)[0]
    time = np.arange(len(motion.q)) * 1e-3
    assert motion.name == "swing"
    assert motion.duration == pytest.approx(2.0)
    assert motion.q[:, 0] == pytest.approx(0.2 * (1.0 - np.cos(np.pi * time)), abs=1e-6)
    assert motion.dq[:, 1] == pytest.approx(0.4 * np.pi * np.sin(np.pi * time), abs=1e-3)
    assert np.all(motion.dq[[0, -1]] == 0.0)


def test_a_folder_is_run_in_order(tmp_path: Path) -> None:
    """Every file is a run; the simulated two_joints follows it to within a few milliradians."""
    whole = ArmModel.load("tm5-900")
    for number, seconds in ((2, 3.0), (1, 2.0)):
        columns = table(seconds)
        columns |= {
            f"{name}/position_command": 0.0 * columns["time"] for name in whole.joint_names if name not in JOINTS
        }
        written(tmp_path / f"{number:02d}_swing.csv", columns)
    motions = read_commands(tmp_path, whole)
    session = simulate(SimulationOptions(rate=125.0, pause=(1.0, 1.0)), "session", motions=motions).session
    assert [round(run.duration) for run in session.runs] == [2, 3]
    for run, motion in zip(session.runs, motions, strict=True):
        assert np.abs(run.position - motion.q[::8][: len(run.position)]).max() < 0.02


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joint_2/position_command": None}, "no column 'joint_2/position_command'"),
        ({"joint_1/position_command": 9.0}, "out of its limits"),
        ({"joint_1/position_command": np.nan}, "not finite"),
        ({"time": 0.0}, "time goes on by 0 s"),
    ],
)
def test_unusable_commands_are_refused(
    tmp_path: Path, two_joints: ArmModel, change: dict[str, float | None], words: str
) -> None:
    """The one line names the file, what is wrong with it, and the remedy."""
    columns = table()
    for name, value in change.items():
        if value is None:
            del columns[name]
        else:
            columns[name] = np.full_like(columns[name], value)
    with pytest.raises(RecordingError, match=words):
        read_commands(written(tmp_path / "wrong.csv", columns), two_joints)


def test_an_empty_folder_is_refused(tmp_path: Path, two_joints: ArmModel) -> None:
    """A folder without commands makes no session."""
    with pytest.raises(RecordingError, match=r"holds no \.csv"):
        read_commands(tmp_path, two_joints)
