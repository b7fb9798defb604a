"""A model knows where it was fitted: plans beyond that are reported, or kept inside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.model.training_range import TrainingRange
from ident.robot.arm import ArmModel
from plan.api.planning import open_task
from plan.command_options import SolveOptions, TaskOptions
from plan.planners.sequential import Sequential
from plan.problem.certificate import certify
from plan.problem.extrapolation import find_extrapolation
from plan.problem.problem import ADVICE, TRAINING, Limits
from plan.solving.obstruction import require_inside
from plan.solving.task_limits import stay_inside
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
    inside = limits()
    assert inside.speed.max() <= 3.0
    assert inside.acceleration == pytest.approx(np.full(3, 50.0))
    assert limits(beyond=True).acceleration is None


def test_staying_inside_needs_a_range() -> None:
    """Without a model, or with one that knows no range, the remedy is named; leaving it, too, is a contradiction."""
    for model in (None, fitted(None)):
        with pytest.raises(InputError, match="give --model"):
            open_task(DATA / "table3.toml", model, TaskOptions(inside=True))
    with pytest.raises(InputError, match="give one of them"):
        open_task(DATA / "table3.toml", fitted(known()), TaskOptions(inside=True, beyond=True))


def test_what_is_known_bounds_a_plan_unless_it_is_left() -> None:
    """By default the training range, else the maker's advice; the reason and `--beyond` say what was left."""
    options = TaskOptions("time")
    narrow = known(speed=1.2, acceleration=8.0)
    for model, words, most in (
        (fitted(narrow), TRAINING, 8.0),
        (fitted(None), ADVICE, 1.0),
        (None, ADVICE, 1.0),
    ):
        task = open_task(DATA / "table3.toml", model, options)
        assert task.problem.known == words
        limit = task.problem.limits.acceleration
        assert limit is not None
        assert limit.max() == most
        left = open_task(DATA / "table3.toml", model, replace(options, beyond=True)).problem
        assert left.limits.acceleration is None
        assert left.notes[0].startswith("beyond what is known")
        assert f"{most:g} rad/s2" in left.notes[0]
    result = open_task(DATA / "table3.toml", None).solve(SolveOptions(gap=False))
    assert result.status == "infeasible"
    assert f"({ADVICE}; --beyond leaves it)" in result.reason
    plan = open_task(DATA / "table3.toml", fitted(narrow), options)
    best = plan.solve(SolveOptions("time", gap=False, seconds=3.0))
    assert best.certificate is not None
    assert [one.quantity for one in best.certificate.extrapolation or ()] == []
    assert best.splines.top_acceleration.max() <= 8.0


def test_the_task_itself_may_begin_beyond_the_training() -> None:
    """Start and goal widen the positions that a plan may use, and only as far as they lie; that is told."""
    task = open_task(DATA / "table3.toml", fitted(known(position=1.0)), TaskOptions("time")).problem
    assert task.limits.lower == pytest.approx([-1.0, -1.0, np.radians(-120.0)])
    assert task.limits.upper == pytest.approx([np.radians(80.0), 1.0, 1.0])
    assert "positions of joint_1, joint_3" in task.notes[-1]
    with pytest.raises(InputError, match="beyond the model's training"):
        open_task(DATA / "table3.toml", fitted(known(position=1.0)), TaskOptions("time", inside=True))
