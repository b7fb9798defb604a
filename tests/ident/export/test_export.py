"""Laws of exported models and of the gate."""

import dataclasses
import shutil
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ident.command_options import ExportOptions
from ident.errors import InputError
from ident.export.controllers import write_cpp, write_isaac, write_limits
from ident.export.identified import IdentifiedArm
from ident.export.loaded import load_module
from ident.export.write import FILES, USUAL, write_export
from ident.laws.carried import NamedLaw
from ident.laws.motion import Losses
from ident.model.evaluation import evaluate
from ident.model.evaluation_limits import check_limits, load_limits
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, random_states, sliding_arm

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))

PLAIN = IdentifiedArm.with_losses
NO_LOSSES = Losses(np.zeros(6), np.zeros(6), np.zeros(6), np.full(6, 0.01), np.zeros(6))


@pytest.fixture(scope="module")
def model() -> HybridModel:
    arm = ArmModel.load("tm5-900")
    heavier = arm.with_inertial_parameters(1.1 * arm.inertial_parameters)
    return HybridModel(arm, arm, heavier, LOSS, inertia="consistent")


def test_every_file_carries_the_model_s_torque(model: HybridModel, tmp_path: Path) -> None:
    """URDF in Pinocchio, MJCF in MuJoCo and the Python module give the model's torque to 1e-9, with less error."""
    motions = made_motions(model.robot, model.torque, [1], 3.0)
    record = write_export(model, tmp_path / "export", motions=motions)
    assert {path.name for path in (tmp_path / "export").iterdir()} >= {*(FILES[name] for name in USUAL), "export.json"}
    for name in ("urdf", "mjcf", "python"):
        assert record["loaded_back"][name]["torque_difference_Nm"] < 1e-9
    for error in record["torque_rmse_Nm"].values():
        assert error["after"] < 0.2 * error["before"]


def test_named_laws_are_in_the_module_and_the_parameters(model: HybridModel, tmp_path: Path) -> None:
    """Module and model agree to 1e-9 N m with every law, and the parameters hold the laws' figures."""
    laws = (
        _law("stribeck_friction", 0, {"stribeck_velocity_rad_s": 0.3, "exponent": 1.3}, 4.0),
        _law("nonlinear_viscous_friction", 1, {"exponent": 0.6}, 3.0),
        _law("load_dependent_friction", 1, {"terms": 2, "load_Nm": 1.0}, 0.08, 0.03),
        _law("load_dependent_friction", 2, {"terms": 4, "load_Nm": 9.0}, 0.08, 0.03, 0.02, 0.05),
        _law("position_dependent_friction", 3, {"order": 3.0}, 0.7, -0.4),
        _law("asymmetric_friction", 4, {}, 0.8, 0.3),
    )
    named = replace(model, named=laws)
    record = write_export(named, tmp_path / "export")
    for form in ("urdf", "mjcf", "python"):
        assert record["loaded_back"][form]["torque_difference_Nm"] < 1e-9
    q, dq, ddq = random_states(np.random.default_rng(2), 50, 6)
    module = load_module(tmp_path / "export" / "torque_model.py")
    torque = module.modelled_torque(q, dq, ddq) + module.extra_torque(q, dq, ddq)
    assert torque == pytest.approx(named.torque(q, dq, ddq), abs=1e-9)
    told = tomllib.loads((tmp_path / "export" / "parameters.toml").read_text(encoding="utf-8"))["effect"]
    assert [(one["id"], one["joints"]) for one in told] == [(law.effect, [f"joint_{law.joint + 1}"]) for law in laws]
    assert any("torque_model.py (extra_torque)" in line for line in record["left_out"])


def _law(effect: str, joint: int, shape: dict[str, float], *values: float) -> NamedLaw:
    return NamedLaw(effect, joint, shape, tuple((value, value - 0.1, value + 0.1) for value in values))


# Fields of DelayedPDActuatorCfg and its bases. Source: Isaac Lab 2.3 and 3.0, isaaclab/actuators/actuator_cfg.py,
# actuator_base_cfg.py and actuator_pd_cfg.py.
COMMON_FIELDS = {"joint_names_expr", "stiffness", "damping", "armature", "friction", "dynamic_friction"}
COMMON_FIELDS |= {"viscous_friction", "effort_limit_sim", "velocity_limit_sim", "min_delay", "max_delay"}
LIMIT_FIELDS = {
    "LIMITS": {"effort_limit", "velocity_limit"},
    "LIMITS_3": {"actuator_effort_limit", "actuator_velocity_limit", "joint_effort_limit", "joint_velocity_limit"},
}


@pytest.mark.parametrize("limits", LIMIT_FIELDS)
def test_isaac_lab_s_configurations_take_the_figures_as_keywords(model: HybridModel, limits: str) -> None:
    """By the published fields: every keyword is one, values are numbers by joint, delays whole steps."""
    found: dict[str, Any] = {}
    exec(write_isaac(PLAIN(model.robot, NO_LOSSES)), found)
    fields = COMMON_FIELDS | LIMIT_FIELDS[limits]
    config = dataclasses.make_dataclass("DelayedPDActuatorCfg", [(name, Any, None) for name in sorted(fields)])
    least, most = found["delay_steps"](0.005)
    made = config(**found["ACTUATOR"], **found[limits], stiffness=1.0, damping=1.0, min_delay=least, max_delay=most)
    for name, value in vars(made).items():
        if isinstance(value, dict):
            assert set(value) == set(made.joint_names_expr), name
            assert all(isinstance(one, float) for one in value.values()), name
    assert isinstance(least, int)
    assert isinstance(most, int)
    assert (least, most) == (0, 0)  # no recording tells of a command's delay


def test_ros2_limits_are_the_urdf_s_and_the_acceleration_leaves_torque(model: HybridModel) -> None:
    """At the told acceleration every pose's torque keeps the effort limit; more breaks it somewhere."""
    yaml = pytest.importorskip("yaml")
    found = yaml.safe_load(write_limits(PLAIN(model.robot, NO_LOSSES)))["/**"]["ros__parameters"]["joint_limits"]
    assert list(found) == list(model.joint_names)
    arm, rng = model.robot, np.random.default_rng(3)
    q = rng.uniform(np.maximum(arm.lower, -3.0), np.minimum(arm.upper, 3.0), (200, 6))
    for j, one in enumerate(found.values()):
        assert (one["min_position"], one["max_velocity"]) == (arm.lower[j], arm.velocity_limit[j])
        ddq = np.zeros_like(q)
        ddq[:, j] = one["max_acceleration"]
        need = np.abs(arm.inverse_dynamics(q, np.zeros_like(q), ddq)[:, j])
        assert np.mean(need > 1.02 * one["max_effort"]) < 0.02
        assert need.max() > 0.5 * one["max_effort"]


def test_ros2_control_s_reader_takes_every_limit_of_the_file(model: HybridModel) -> None:
    """Keys and types as joint_limits declares them: a switch is a bool, a limit is a double, an integer is refused."""
    yaml = pytest.importorskip("yaml")
    kinds = ("position", "velocity", "acceleration", "deceleration", "jerk", "effort")
    declared = {f"has_{kind}_limits": bool for kind in kinds} | {"angle_wraparound": bool, "min_position": float}
    declared |= {f"max_{kind}": float for kind in kinds}
    for arm in (model.robot, sliding_arm()):
        losses = Losses(*(np.full(arm.n, 0.01) for _ in range(5)))
        found = yaml.safe_load(write_limits(PLAIN(arm, losses)))["/**"]["ros__parameters"]["joint_limits"]
        for one in found.values():
            assert {key: type(value) for key, value in one.items()} == {key: declared[key] for key in one}
            for kind in kinds:
                ends = [f"max_{kind}", *(["min_position"] if kind == "position" else [])]
                assert all((end in one) == one.get(f"has_{kind}_limits", False) for end in ends)


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
@pytest.mark.parametrize("which", ["tm5-900", "sliding"])
def test_the_cpp_header_gives_the_same_torque(which: str, tmp_path: Path) -> None:
    """Compiled without a library and with all warnings, to 1e-9."""
    arm = ArmModel.load("tm5-900") if which == "tm5-900" else sliding_arm()
    losses = Losses(*(np.full(arm.n, value) for value in (0.1, 8.0, 6.0, 0.02, 0.0)))
    (tmp_path / "torque_model.hpp").write_text(write_cpp(PLAIN(arm, losses)))
    (tmp_path / "try.cpp").write_text(
        '#include <cstdio>\n#include "torque_model.hpp"\nint main() {\n'
        f"  namespace m = arm_{arm.name};\n  m::Vector s[3];\n  for (;;) {{\n"
        '    for (auto& v : s) for (auto& x : v) if (std::scanf("%lf", &x) != 1) return 0;\n'
        '    for (double t : m::torque(s[0], s[1], s[2])) std::printf("%.17g ", t);\n  }\n}\n'
    )
    command = ["c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-O0", "try.cpp", "-o", "try"]
    subprocess.run(command, cwd=tmp_path, check=True)
    states = random_states(np.random.default_rng(1), 20, arm.n)
    rows = np.stack(states, axis=1)
    text = " ".join(map(repr, map(float, rows.ravel())))
    done = subprocess.run([str(tmp_path / "try")], input=text, capture_output=True, text=True, check=True)
    found = np.array(done.stdout.split(), dtype=float).reshape(-1, arm.n)
    q, dq, ddq = states
    wanted = arm.inverse_dynamics(q, dq, ddq) + losses.torque(dq, ddq, np.tanh(dq / losses.transition))
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_what_no_body_could_be_is_refused_and_the_nearest_offered(model: HybridModel, tmp_path: Path) -> None:
    """A negative moment of inertia ends in one line with the remedy; with it, only that link changes much."""
    numbers = np.array(model.arm.inertial_parameters)
    numbers[14] = -0.5
    broken = replace(model, arm=model.robot.with_inertial_parameters(numbers), inertia="base")
    with pytest.raises(InputError, match=r"link_2 could be no real body; give --nearest"):
        write_export(broken, tmp_path / "export", ExportOptions(formats=("urdf",)))
    assert not (tmp_path / "export").exists()
    record = write_export(broken, tmp_path / "export", ExportOptions(formats=("urdf",), nearest=True))
    assert record["changed_links"] == ["link_2"]
    assert record["loaded_back"]["urdf"]["torque_difference_Nm"] < 1e-9


def test_an_unknown_format_is_refused(model: HybridModel, tmp_path: Path) -> None:
    """The message lists the formats."""
    with pytest.raises(InputError, match="'sdf' is unknown; use one of: urdf"):
        write_export(model, tmp_path / "export", ExportOptions(formats=("sdf",)))


def test_limits_are_kept_or_not(model: HybridModel, tmp_path: Path) -> None:
    """Limits above the error pass, below it they don't; R² is a least value; a chosen rung is judged."""
    motions = made_motions(model.robot, lambda *states: model.torque(*states) + 1.0, [2], 4.0)
    score = evaluate(model, [("E", motions)]).pooled
    file = tmp_path / "limits.toml"
    file.write_text("[torque_rmse_Nm]\njoint_1 = 1.1\njoint_2 = 0.9\ntotal = 1.1\n[r2_moving]\njoint_2 = 0.9\n")
    checks = check_limits(score, load_limits(file, model.joint_names, model.rungs))
    assert [check.passed for check in checks] == [True, False, True, True]
    file.write_text('rung = "analytic"\n[torque_rmse_Nm]\njoint_1 = 1.1\n')
    assert not check_limits(score, load_limits(file, model.joint_names, model.rungs))[0].passed


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "holds no limit"),
        ("[torque_rmse_Nm", "not TOML"),
        ("[speed]\nx = 1", "no such figure"),
        ("torque_rmse_Nm = 1", "is no table"),
        ("[r2_moving]\ntotal = 1", "no such joint"),
        ("[torque_rmse_Nm]\njoint_9 = 1", "no such joint"),
        ("[torque_rmse_Nm]\njoint_1 = nan", "is no finite number"),
        ("[torque_rmse_Nm]\njoint_1 = true", "is no finite number"),
        ("[torque_rmse_Nm]\njoint_1 = 1e200", "beyond any arm's"),
        ("[torque_rmse_Nm]\ntotal = -1", "is negative, which no torque_rmse_Nm is"),
        ("[energy_error_J]\ntotal = -0.5", "is negative, which no energy_error_J is"),
        ("[r2_moving]\njoint_1 = 98", "is above 1, which no r2_moving is"),
        ('rung = "top"\n[torque_rmse_Nm]\ntotal = 1', "is no rung"),
    ],
)
def test_a_bad_file_of_limits_is_refused_with_its_place(
    text: str, what: str, model: HybridModel, tmp_path: Path
) -> None:
    """What is unknown or no number is named, with what would do."""
    file = tmp_path / "limits.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=what) as error:
        load_limits(file, model.joint_names, model.rungs)
    assert "limits.toml" in error.value.where
