"""A model knows where it was fitted: plans beyond that are reported, or kept inside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.model.hybrid import HybridModel, TrainingRange
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.api.planning import open_task
from plan.command_options import TaskOptions
from plan.planners.sequential import Sequential
from plan.problem.problem import Limits
from plan.problem.result import certify, find_extrapolation
from plan.solving.set_up import require_inside, stay_inside
from tests.plan.worlds import ledger, problem

DATA = Path(__file__).parents[1] / "data"
JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
HALF = np.array([1.0, 2.0, 1.5, 0.5, 0.5, 0.5])


def known(position: float = 3.0, speed: float = 3.0, acceleration: float = 50.0) -> TrainingRange:
    high = np.array([[position] * 6, [speed] * 6, [acceleration] * 6])
    return TrainingRange(JOINTS, -high, high, HALF)


def fitted(trained: TrainingRange | None) -> HybridModel:
    arm = ArmModel.load("tm5-900")
    return HybridModel(arm, arm, arm, LossParameters(*np.full((5, 6), 0.5)), trained=trained)


def test_what_lies_beyond_is_told_with_its_share() -> None:
    """Speed that passes its range by half the range's width is a share of a half; the worst stands first."""
    task = replace(problem(), trained=known())
    splines = task.decode(task.initial)
    assert find_extrapolation(task, splines) == ()
    top = float(splines.top_speed[0, 0])
    low, high = known().low.copy(), known().high.copy()
    low[1, 0], high[1, 0] = -0.5 * top, 0.5 * top
    high[0, 2] = np.radians(-91.0)  # the goal lies a degree beyond
    found = find_extrapolation(replace(task, trained=TrainingRange(JOINTS, low, high, HALF)), splines)
    assert [(one.joint, one.quantity) for one in found] == [("joint_1", "speed"), ("joint_3", "position")]
    assert found[0].share == pytest.approx(0.5, rel=1e-3)
    assert found[0].reached == pytest.approx(top, rel=1e-3)
    assert certify(problem(), splines).extrapolation is None


def test_joints_that_are_held_count_by_their_place() -> None:
    """A wrist held where the model never saw it is reported too."""
    low, high = known().low.copy(), known().high.copy()
    low[0, 4] = 0.2
    task = replace(problem(), trained=TrainingRange(JOINTS, low, high, HALF))
    (one,) = find_extrapolation(task, task.decode(task.initial)) or ()
    assert (one.joint, one.quantity, one.reached) == ("joint_5", "position", 0.0)


def test_staying_inside_is_a_limit_like_any_other() -> None:
    """With the range as limits, a time plan keeps to it; a start that lies beyond is refused."""
    trained = known(speed=1.2, acceleration=8.0)
    task = replace(problem(objective="time", free="both"), trained=trained)
    task = replace(task, limits=stay_inside(task.limits, trained))
    best = Sequential(starts=1, kept=(1,), levels=1).run([task], ledger(), np.random.default_rng(0)).best
    certificate = certify(best.problem, best.splines)
    assert certificate.broken == []
    assert certificate.extrapolation == ()
    with pytest.raises(InputError, match="beyond the model's training"):
        require_inside(replace(task, trained=known(position=1.0)), Path("scene.toml"))


def test_a_model_keeps_its_range_and_plans_leave_its_doubt_free(tmp_path: Path) -> None:
    """Saved and loaded the range is the same; its half widths are taken off the torque limits, unless refused."""
    trained = known()
    fitted(trained).save(tmp_path / "model")
    read = HybridModel.load(tmp_path / "model").trained
    assert read.to_dict() == trained.to_dict()

    def limits(**options: bool) -> Limits:
        return open_task(DATA / "table3.toml", tmp_path / "model", TaskOptions("time", **options)).problem.limits

    kept, whole = (limits(reserve=reserve) for reserve in (True, False))
    assert whole.torque - kept.torque == pytest.approx(HALF[:3])
    assert kept.reserve == pytest.approx(HALF[:3])
    assert whole.reserve is None
    inside = limits(inside=True)
    assert inside.speed.max() <= 3.0
    assert inside.acceleration == pytest.approx(np.full(3, 50.0))


def test_staying_inside_needs_a_range() -> None:
    """Without a model, or with one that knows no range, the remedy is named."""
    for model, words in ((None, "give --model"), (fitted(None), "fit it again")):
        with pytest.raises(InputError, match=words):
            open_task(DATA / "table3.toml", model, TaskOptions(inside=True))
