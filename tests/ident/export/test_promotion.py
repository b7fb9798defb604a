"""Laws of the gate of promotion: a file stands in the URDF's place only where it surely moves more as the arm does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.api.exporting import Written
from ident.arrays import Array
from ident.command_options import ExportOptions
from ident.export.choose import log_ratio
from ident.export.promotion import LEAST, Contest, Distance, contest_of_model, judge_model, tool_of
from ident.export.write import write_export
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))
NO_LOSS = LossParameters(*(np.full(6, value) for value in (0.0, 0.0, 0.0, 0.0, 0.02)))


@pytest.fixture(scope="module")
def model() -> HybridModel:
    """The tm5-900 with friction and heavier links than its URDF has."""
    arm = ArmModel.load("tm5-900")
    heavier = arm.with_inertial_parameters(1.1 * arm.inertial_parameters)
    return HybridModel(arm, arm, heavier, LOSS, inertia="consistent")


@pytest.mark.parametrize("formats", [("urdf",), ("mjcf", "toml")])
def test_what_moves_as_the_arm_does_is_written(model: HybridModel, formats: tuple[str, ...], tmp_path: Path) -> None:
    """Each file, and the model behind the other formats, is nearer in torque, in replay and at the tool."""
    motions = made_motions(model.robot, model.torque, [1], 6.0)
    record = write_export(model, tmp_path / "out", ExportOptions(formats=formats), motions)
    promotion = record["promotion"]
    assert promotion["passed"]
    assert set(promotion["forms"]) == {formats[0], *(["model"] if len(formats) > 1 else [])}
    for contest in promotion["forms"].values():
        assert all(contest[name]["high"] < 1.0 for name in LEAST)
    assert (tmp_path / "out" / record["files"][0]).is_file()


@pytest.mark.parametrize("which", ["urdf", "worse"])
def test_what_does_not_beat_the_urdf_leaves_the_folder_as_it_was(
    which: str, model: HybridModel, tmp_path: Path
) -> None:
    """The URDF itself, and a model that is farther off than it, are not promoted."""
    arm = model.robot
    plain = replace(model, arm=arm, loss=NO_LOSS)
    motions = made_motions(arm, plain.torque, [1], 6.0)
    tried = plain if which == "urdf" else model
    write_export(model, tmp_path / "out", ExportOptions(formats=("toml",)))
    before = (tmp_path / "out/parameters.toml").read_bytes()
    record = write_export(tried, tmp_path / "out", ExportOptions(formats=("urdf", "toml")), motions)
    assert not record["promotion"]["passed"]
    assert record["files"] == []
    assert not (tmp_path / "out/robot.urdf").exists()
    assert (tmp_path / "out/parameters.toml").read_bytes() == before
    assert not Written(tmp_path / "out", record).promoted


def test_the_tool_is_off_by_what_the_joints_are(model: HybridModel) -> None:
    """A tool's miss is no longer than the joints' misses times the arm's reach from each, and not nothing."""
    motions = made_motions(model.robot, model.torque, [1], 6.0)
    contest = contest_of_model(replace(model, arm=model.robot), motions)
    reach = 2.0  # of no joint of this arm is the tool farther away [m]
    joints = contest.nominal.rms("replay_rms_rad") * model.robot.n
    assert 0.0 < contest.nominal.rms("tool_rms_m") <= reach * joints
    assert tool_of(model.robot) in model.robot.forward_kinematics(model.robot.neutral)


def test_a_longer_horizon_is_harder(model: HybridModel) -> None:
    """Without feedback a model that lacks friction drifts: its miss grows with the time that it is left alone."""
    motions = made_motions(model.robot, model.torque, [1], 6.0)
    misses = [contest_of_model(model, motions, horizon).nominal.rms("tool_rms_m") for horizon in (0.1, 0.2, 0.4)]
    assert misses == sorted(misses)


def test_a_horizon_beyond_the_runs_leaves_the_torque_to_decide(model: HybridModel) -> None:
    """What is not told is null, and no gain and no harm."""
    motions = made_motions(model.robot, model.torque, [1], 6.0)
    contest = contest_of_model(model, motions, horizon=5.0)
    assert contest.gains == ["torque_rms_Nm"]
    told = contest.to_dict()["replay_rms_rad"]
    assert told == {"nominal": None, "written": None, "ratio": 1.0, "low": 0.0, "high": None}


def test_a_model_fitted_on_the_recordings_passes_by_request_alone(model: HybridModel) -> None:
    """However near it is."""
    motions = made_motions(model.robot, model.torque, [1], 6.0)
    assert not judge_model(model, motions, in_sample=True, accepted=False).passed
    assert judge_model(model, motions, in_sample=True, accepted=True).passed


def test_chance_is_no_promotion() -> None:
    """Of two files that are as far off, few are promoted; the more a file was chosen from, the fewer."""
    rng = np.random.default_rng(4)
    promoted = {1: 0, 6: 0}
    for _ in range(200):
        nominal, written = (_chance(rng) for _ in range(2))
        for tried in promoted:
            promoted[tried] += Contest("urdf", nominal, written, tried).beats
    assert promoted[6] <= promoted[1] <= 0.05 * 200


def test_the_bounds_of_a_ratio_enclose_it() -> None:
    """Half a per cent of the level on either side of the middle, wider for less data, and nothing for one stretch."""
    rng = np.random.default_rng(5)
    squares, rivals = rng.chisquare(1, (2, 400))
    low, middle, high = (float(log_ratio(squares, rivals, level)) for level in (0.025, 0.5, 0.975))
    assert low < middle < high
    assert np.isclose(middle, 0.5 * np.log(squares.mean() / rivals.mean()))
    few = float(log_ratio(squares[:20], rivals[:20], 0.975)) - float(log_ratio(squares[:20], rivals[:20], 0.5))
    assert few > high - middle


def _chance(rng: np.random.Generator) -> Distance:
    numbers: Array = rng.chisquare(2, (3, 30))
    return Distance(dict(zip(LEAST, numbers, strict=True)))
