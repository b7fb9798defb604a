"""Laws of the ONNX graph: a runtime that knows nothing of us gives the model's own torque."""

import builtins
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.command_options import ExportOptions
from ident.errors import InputError
from ident.export.onnx_model import run_onnx, state_size
from ident.export.write import write_export
from ident.laws.carried import KINDS, NamedLaw
from ident.model.carried import CarriedEffect
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.process import missing_extra
from ident.robot.arm import ArmModel
from tests.ident.export.learned_arm import learned_runs, within_reach
from tests.ident.made_up import random_states, sliding_arm

# What a net's numbers in single precision, large ones that cancel among them, are off by [N m].
SINGLE = 2e-3
ONNX = ExportOptions(formats=("onnx",), nearest=True)
SHAPES = {
    "stribeck_friction": {"stribeck_velocity_rad_s": 0.3, "exponent": 1.3},
    "nonlinear_viscous_friction": {"exponent": 0.6, "knee_rad_s": 0.05},
    "load_dependent_friction": {"terms": 4.0, "load_Nm": 9.0},
    "position_dependent_friction": {"order": 3.0},
    "asymmetric_friction": {},
}


def _with_laws(arm: ArmModel, laws: tuple[NamedLaw, ...] = ()) -> HybridModel:
    loss = LossParameters(*(np.full(arm.n, value) for value in (0.1, 8.0, 6.0, 0.7, 0.02)))
    return HybridModel(arm, arm, arm, loss, named=laws)


def _law(effect: str, joint: int) -> NamedLaw:
    size = NamedLaw(effect, joint, SHAPES[effect]).size
    return NamedLaw(effect, joint, SHAPES[effect], tuple((0.3 + k, 0.2 + k, 0.4 + k) for k in range(size)))


@pytest.mark.parametrize("which", ["tm5-900", "sliding"])
def test_arm_losses_and_every_law_are_the_models(which: str, tmp_path: Path) -> None:
    """To 1e-9 N m at random states of turning and of sliding joints."""
    pytest.importorskip("onnx")
    arm = ArmModel.load("tm5-900") if which == "tm5-900" else sliding_arm()
    assert set(SHAPES) == set(KINDS), "give the new law a shape in SHAPES of this file"
    laws = tuple(_law(effect, k % arm.n) for k, effect in enumerate(SHAPES))
    model = _with_laws(arm, laws)
    record = write_export(model, tmp_path / "out", ONNX)
    assert record["files"] == ["torque_model.onnx"]
    assert record["loaded_back"]["onnx"]["torque_difference_Nm"] < 1e-9
    states = random_states(np.random.default_rng(2), 50, arm.n)
    (torque,) = run_onnx(tmp_path / "out/torque_model.onnx", [(*states, 0.0)], model)
    np.testing.assert_allclose(torque, model.torque(*states), atol=1e-9)


def test_net_and_memory_are_the_models_along_runs_that_no_fit_saw(
    learned_runs_and_model: tuple[list[Motion], HybridModel], tmp_path: Path
) -> None:
    """Sample by sample with the state handed on; and the graph foretells new runs as well as the model does."""
    pytest.importorskip("onnx")
    _, fitted = learned_runs_and_model
    model = within_reach(fitted, 0.05)
    assert state_size(model) > 0
    unseen = learned_runs(model.robot, seed=6)[:2]
    record = write_export(model, tmp_path / "out", ONNX, unseen)
    assert record["loaded_back"]["onnx"]["torque_difference_Nm"] < SINGLE
    runs = [(motion.q, motion.dq, motion.ddq, motion.interval) for motion in unseen]
    torques = run_onnx(tmp_path / "out/torque_model.onnx", runs, model)
    for motion, torque in zip(unseen, torques, strict=True):
        error = np.sqrt(np.mean((motion.tau - torque) ** 2))
        of_model = np.sqrt(np.mean((motion.tau - model.torque(motion.q, motion.dq, motion.ddq)) ** 2))
        assert error == pytest.approx(of_model, rel=1e-3)


def test_rows_are_arms_that_know_nothing_of_each_other(
    learned_runs_and_model: tuple[list[Motion], HybridModel], tmp_path: Path
) -> None:
    """Two arms at once give what each gives alone: each row has its own state."""
    runtime = pytest.importorskip("onnxruntime")
    _, model = learned_runs_and_model
    write_export(model, tmp_path / "out", ONNX)
    session = runtime.InferenceSession(tmp_path / "out/torque_model.onnx", providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(3)
    state = rng.uniform(0.0, 0.01, (2, state_size(model)))
    state[:, 0] = [1.0, 0.0]
    given = {name: rng.uniform(-1.0, 1.0, (2, model.arm.n)) for name in ("q", "dq", "ddq")}
    both = session.run(None, {**given, "dt": np.array([0.01]), "state": state})
    for row in range(2):
        own = {name: values[row : row + 1] for name, values in given.items()}
        alone = session.run(None, {**own, "dt": np.array([0.01]), "state": state[row : row + 1]})
        for together, single in zip(both, alone, strict=True):
            np.testing.assert_allclose(together[row : row + 1], single, atol=1e-12)


def test_what_a_graph_cannot_say_is_refused_by_name(tmp_path: Path) -> None:
    """A carried spring is no law of a joint's states: the line names it, and nothing is written."""
    spring = CarriedEffect("spring_torque", 0, {"stiffness_Nm_rad": 6.0, "rest_rad": 0.3})
    model = replace(_with_laws(ArmModel.load("tm5-900")), carried=(spring,))
    with pytest.raises(InputError, match="a graph has no place for spring_torque"):
        write_export(model, tmp_path / "out", ONNX)
    assert not (tmp_path / "out").exists()


def test_a_missing_package_is_told_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without onnx the line names the extra; formats that need none are written all the same."""
    usual = builtins.__import__

    def without(name: str, *rest: object) -> object:
        if name.partition(".")[0] == "onnx":
            raise ModuleNotFoundError("No module named 'onnx'", name="onnx")
        return usual(name, *rest)  # type: ignore[arg-type]

    model = _with_laws(ArmModel.load("tm5-900"))
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ModuleNotFoundError) as raised:
        write_export(model, tmp_path / "out", ONNX)
    told = missing_extra(raised.value)
    assert told is not None
    assert 'pip install "armgap[onnx]"' in str(told)
    assert write_export(model, tmp_path / "out", ExportOptions(formats=("toml",)))["files"] == ["parameters.toml"]
