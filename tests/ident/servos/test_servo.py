"""What goal and position tell of a servo, and what they don't: on servos stepped by other code than the estimator's."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ident import diagnose, servo
from ident.cli.app import app
from ident.errors import InputError
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.servos.servo_fit import ServoArm, ServoJoint
from tests.ident.foreign import lerobot
from tests.ident.servos.servo_plant import Servo, one_link, record
from tests.schemas import check_file, check_record


def seen(one: Servo, arm: ArmModel | None, seed: int = 0, quick: bool = True) -> tuple[ServoArm, ServoJoint]:
    """What is reported of four runs of a servo."""
    runs = [record(one, 10 * seed + k, quick=quick) for k in range(4)]
    # Each run has its own clock.
    found = servo(Session("lever", tuple(runs), common_clock=False), arm)
    return found, found.joints[0]


def truth(one: Servo) -> dict[str, float]:
    return {
        "lag_s": one.damping / one.gain,
        "dead_band_rad": one.friction / one.gain,
        "zero_rad": one.zero,
        "droop_rad_Nm": 1.0 / one.gain,
        "gain_Nm_rad": one.gain,
        "delay_s": one.delay,
        "total_lag_s": one.delay + one.damping / one.gain,
    }


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return one_link()


def test_all_that_is_there_is_told_and_lies_in_its_interval(arm: ArmModel) -> None:
    """Over servos that differ in everything nine of ten intervals hold the truth, and each figure is near it."""
    rng, inside, count = np.random.default_rng(5), 0, 0
    for k in range(5):
        scale = np.exp(0.25 * rng.standard_normal(5))
        one = Servo(8.0 * scale[0], 0.03, 0.6 * scale[1], 0.12 * scale[2], 0.024 * scale[3], 0.01 * scale[4])
        found, joint = seen(one, arm, k)
        assert {"total_lag_s", "dead_band_rad", "droop_rad_Nm", "gain_Nm_rad"} <= set(joint.figures), found.summary()
        for name, value in truth(one).items():
            if name in joint.figures:
                middle, low, high = joint.figures[name]
                inside, count = inside + (low <= value <= high), count + 1
                assert middle == pytest.approx(value, rel=0.3, abs=0.006), name
        assert joint.rms_after < 0.2 * joint.rms_before
    assert inside >= 0.85 * count
    assert count >= 5 * 5


def test_what_is_not_there_is_not_told(arm: ArmModel) -> None:
    """No dead band and no offset: neither gets a figure, on any of several servos."""
    wrong = []
    for k in range(5):
        _, joint = seen(Servo(friction=0.0, zero=0.0), arm, 20 + k)
        wrong += [name for name in joint.figures if name in ("dead_band_rad", "zero_rad")]
    assert wrong == []


@pytest.mark.parametrize("inertia", [0.01, 0.02])
def test_moves_at_one_speed_tell_no_dead_band(inertia: float) -> None:
    """Law: where delay, lag and dead band fit nearly alike, none is told beside an inertia below zero."""
    servo_ = Servo(inertia=inertia, friction=0.0, zero=0.0, load=0.0)
    session = Session("ramps", (record(servo_, 71, 90.0, ramped=True),))
    (joint,) = servo(session).joints
    assert "dead_band_rad" not in joint.figures
    for name in ("delay_s", "lag_s", "total_lag_s"):
        assert joint.figures[name][0] == pytest.approx(truth(servo_)[name], rel=0.1), name


def test_slow_motion_tells_the_sum_of_delay_and_lag_but_not_the_delay(arm: ArmModel) -> None:
    one = Servo(noise=0.01)
    found, joint = seen(one, arm, 40, quick=False)
    assert "delay_s" not in joint.figures
    assert "move it faster" in joint.untold["delay_s"]
    _, low, high = joint.figures["total_lag_s"]
    assert low <= truth(one)["total_lag_s"] <= high
    assert "Delay of goals: a later goal and a slower joint are the same here" in found.summary()


def test_without_a_load_that_changes_nothing_is_said_of_droop_and_gain() -> None:
    """No robot, or a joint that gravity does not bend."""
    _, joint = seen(Servo(load=0.0), None, 50)
    assert "give --robot" in joint.untold["droop_rad_Nm"]
    found, joint = seen(Servo(load=0.0), one_link("0 0 1"), 50)
    assert "gravity hardly changes" in joint.untold["droop_rad_Nm"]
    assert "gain_Nm_rad" not in joint.figures
    check_record(found.to_dict())


def test_a_dead_band_is_told_with_what_would_look_the_same(arm: ArmModel) -> None:
    found, _ = seen(Servo(friction=0.2), arm, 60)
    record_ = check_record(found.to_dict())
    assert record_["joints"]["shoulder"]["class"]["dead_band_rad"] == ["dead_band", "dry_friction", "backlash"]
    assert "hold the joint by hand" in found.summary()


def test_goals_that_are_none_are_refused(arm: ArmModel) -> None:
    run = record(Servo(), 1)
    for wrong, what in (
        (replace(run, position_command=None), "logs no goal of"),
        (replace(run, position_command=run.position), "is its position, sample for sample"),
        (run.at(slice(0, 25)), "its longest run lasts"),
    ):
        with pytest.raises(InputError, match=what):
            servo(Session("lever", (wrong,)), arm)
    resting = replace(run, position=0.0 * run.position)
    joint = servo(Session("lever", (resting,)), arm).joints[0]
    assert not joint.figures
    assert "move it farther" in joint.untold["lag_s"]


def test_a_table_without_effort_goes_through_the_command(tmp_path: Path) -> None:
    """Other commands say where such a table belongs."""
    run = record(Servo(), 3)
    rows = np.column_stack([run.time, run.position[:, 0], run.position_command[:, 0]])  # type: ignore[index]
    header = "time,shoulder/position,shoulder/position_command"
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="")
    done = CliRunner().invoke(app, ["servo", str(tmp_path / "run.csv"), "--json", str(tmp_path / "told.json")])
    assert done.exit_code == 0, done.output
    assert "ms late" in done.output
    half_ms = 500.0 * run.sample_interval
    assert f"{half_ms:.0f} ms later still" in " ".join(done.output.split())
    assert check_file(tmp_path / "told.json")["joints"]["shoulder"]["figures"]["total_lag_s"]["unit"] == "s"
    with pytest.raises(InputError, match="is for `ident servo`"):
        diagnose(tmp_path / "run.csv", "tm5-900")


def test_a_data_set_of_an_so101_is_told_in_one_command(tmp_path: Path) -> None:
    """LeRobot's names and degrees: nothing has to be written before."""
    names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    episodes = []
    for run in (record(Servo(load=0.0, zero=0.0), k) for k in range(4)):
        pair = {"observation.state": run.position, "action": run.position_command}
        columns = {name: np.repeat(np.degrees(values), 6, axis=1) for name, values in pair.items()}
        episodes.append({**columns, "timestamp": run.time})
    lerobot(tmp_path, [f"{name}.pos" for name in names], *episodes)
    found = CliRunner().invoke(app, ["servo", str(tmp_path), "--robot", "so101", "--json", str(tmp_path / "out.json")])
    assert found.exit_code == 0, found.output
    joints = check_file(tmp_path / "out.json")["joints"]
    assert set(joints) >= set(names[:5])
    lag = joints["shoulder_pan"]["figures"]["lag_s"]
    assert lag["value"] == pytest.approx(0.6 / 8.0, rel=0.03)


@pytest.mark.parametrize("kind", ["counts", "iso", "zoned"])
def test_counts_and_iso_times_read_as_radians_and_seconds(kind: str, tmp_path: Path) -> None:
    """Law: a log in counts about the middle of a turn, or with ISO times, is the log in radians and seconds."""
    run = record(Servo(), 0)
    pair = np.column_stack([run.position[:, 0], run.position_command[:, 0]])
    stamps = np.datetime64("2026-05-03T14:00:00") + (1e6 * run.time).astype("m8[us]")
    times = [f"{one}{'+00:00' * (kind == 'zoned')}" for one in (run.time if kind == "counts" else stamps)]
    if kind == "counts":
        pair = np.round(pair * 4096 / (2 * np.pi)) + 2048
        (tmp_path / "log.toml").write_text("counts_per_turn = 4096\n")
    lines = [",".join([time, *(repr(float(v)) for v in row)]) for time, row in zip(times, pair, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time,a/position,a/position_command", *lines]) + "\n")
    (read,) = load_session(tmp_path / "log.csv", with_effort=False).runs
    np.testing.assert_allclose(read.time - read.time[0], run.time - run.time[0], atol=1e-5)
    np.testing.assert_allclose(read.position, run.position, atol=np.pi / 4096)
    assert read.issues == ()
