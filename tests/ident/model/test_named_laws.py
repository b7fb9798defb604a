"""Laws that a diagnosis names, as part of a model."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from ident.command_options import FitOptions
from ident.errors import InputError, RecordingError
from ident.fitting.fit import FitResults, fit_hybrid
from ident.fitting.named_laws import NamedLaws, read_named_laws
from ident.laws.carried import KINDS, JointStates, NamedLaw
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.schemas.publish import make_schema
from tests.ident.made_up import made_motions, two_joint_arm

ARM = two_joint_arm()
OWN = np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])
BUMP = {"stribeck_velocity_rad_s": 0.4, "exponent": 1.0}
NO_NET = FitOptions(net="none", inertia="nominal", laws="none")


def _law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Losses, a bump at low speed at the first joint, friction by the load at the second."""
    rigid = ARM.inverse_dynamics(q, dq, ddq)
    tau = rigid + OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.sign(dq)
    tau[:, 0] += 4.0 * np.sign(dq[:, 0]) * np.exp(-np.abs(dq[:, 0]) / 0.4)
    tau[:, 1] += 0.1 * np.sign(dq[:, 1]) * np.abs(rigid[:, 1])
    return tau


@pytest.fixture(scope="module")
def runs() -> list[Motion]:
    return made_motions(ARM, _law, range(6), 12.0, noise=0.1)


@pytest.fixture(scope="module")
def fitted(runs: list[Motion]) -> FitResults:
    named = NamedLaws(
        (
            NamedLaw("stribeck_friction", 0, BUMP),
            NamedLaw("load_dependent_friction", 1, {"terms": 2, "load_Nm": 1.0}),
        )
    )
    return fit_hybrid(runs[:5], ARM, NO_NET, named=named)


def test_a_named_law_is_fitted_beside_the_rest(fitted: FitResults, runs: list[Motion]) -> None:
    """Its figures come back within their intervals, the losses are the true ones again, and its rung leaves noise."""
    bump, load = fitted.model.named
    assert bump.figures[0][1] < 4.0 < bump.figures[0][2]
    # Driving and backdriving alike at 0.1: two thirds of it on each column.
    assert [value for value, _, _ in load.figures] == pytest.approx([0.1 / 1.5] * 2, abs=0.01)
    assert np.allclose(fitted.model.loss.coulomb, OWN[:, 2], rtol=0.03)
    one = runs[5]
    rungs = fitted.model.ladder(one.q, one.dq, one.ddq)
    left = {name: np.std(one.tau_filtered[one.moving] - one.filtered(tau)[one.moving]) for name, tau in rungs.items()}
    assert list(rungs) == ["analytic", "loss", "named"]
    plain = fit_hybrid(runs[:5], ARM, NO_NET).model.torque(one.q, one.dq, one.ddq)
    assert left["named"] < 0.5 * np.std((one.tau_filtered - one.filtered(plain))[one.moving])


def test_a_saved_model_keeps_its_laws(fitted: FitResults, runs: list[Motion], tmp_path: Path) -> None:
    """The same torque to the last bit; the summary says laws in words, with their intervals."""
    loaded = HybridModel.load(fitted.model.save(tmp_path / "m"))
    states = (runs[5].q, runs[5].dq, runs[5].ddq)
    assert np.array_equal(loaded.torque(*states), fitted.model.torque(*states))
    told = " ".join(fitted.summary().split())
    shape = "(Stribeck velocity 0.4 rad/s, exponent 1)"
    value, low, high = fitted.model.named[0].figures[0]
    size = f"more near rest {value:.3g} N m [{low:.3g}, {high:.3g}]"
    assert f"joint_1: friction that falls as motion sets in {shape}: {size}" in told
    for value, low, high in fitted.model.named[1].figures:
        assert f"{value:.3g} N m per N m [{max(low, 0.0):.3g}, {high:.3g}]" in told


def test_the_record_is_what_its_schema_says(fitted: FitResults) -> None:
    """Laws stand in the JSON of a fit in the published shape."""
    record = json.loads(json.dumps(fitted.to_dict()))
    published = make_schema("fit")
    rows = {"$defs": published["$defs"], **published["properties"]["named"]}
    jsonschema.validate(record["named"], rows)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate([{**record["named"][0], "joint": "joint_1"}], rows)


def test_a_law_that_is_not_there_is_left_out() -> None:
    """A bump below zero would drive the joint: it goes, is reported, and the rest is as if it had not been named."""

    def hollow(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        own = OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.sign(dq)
        return ARM.inverse_dynamics(q, dq, ddq) + own - 2.0 * np.sign(dq) * np.exp(-np.abs(dq) / 0.4)

    runs = made_motions(ARM, hollow, range(4), 12.0, noise=0.1)
    found = fit_hybrid(runs, ARM, NO_NET, named=NamedLaws((NamedLaw("stribeck_friction", 0, BUMP),))).model
    assert found.named == ()
    assert found.provenance["named_left_out"] == ["stribeck_friction of joint_1: these recordings have none"]
    assert np.allclose(found.loss.viscous, fit_hybrid(runs, ARM, NO_NET).model.loss.viscous, rtol=0.01)


def test_what_is_plain_friction_is_refused(runs: list[Motion]) -> None:
    """|v|¹ is viscous friction, and what differs by the sign of the speed an offset: two parameters of one column."""
    named = NamedLaws((NamedLaw("nonlinear_viscous_friction", 0, {"exponent": 1.0}),))
    with pytest.raises(RecordingError, match="can't tell nonlinear_viscous_friction of joint_1 from plain friction"):
        fit_hybrid(runs, ARM, NO_NET, named=named)
    named, offset = NamedLaws((NamedLaw("asymmetric_friction", 0),)), FitOptions(net="none", offset=True)
    with pytest.raises(RecordingError, match=r"can't tell asymmetric_friction of joint_1 from .* offset"):
        fit_hybrid(runs, ARM, offset, named=named)


def _record(**changes: Any) -> dict[str, Any]:
    """What a diagnosis of the arm says, as far as it is read."""
    figures = {"coefficient": 9.0, "exponent": 0.5}
    bend = {name: {"value": one, "low": one, "high": one} for name, one in figures.items()}
    law = {"coefficients": [9.0], "shape": {"exponent": 0.45}}
    findings = [
        {"effect": "nonlinear_viscous_friction", "joints": ["joint_2"], "parameters": bend},
        {"effect": "asymmetric_friction", "joints": ["joint_1"], "parameters": {}},
        {"effect": "unknown_payload", "joints": ["joint_1", "joint_2"], "parameters": {}},
    ]
    record = {
        "schema": "ident.diagnosis/1",
        "robot": ARM.name,
        "joints": list(ARM.joint_names),
        "verdict": "named",
        "findings": findings,
        "baseline": {"joint_2": {"laws": {"nonlinear_viscous_friction": law}}},
    }
    return {**record, **changes}


def _written(folder: Path, record: Any) -> Path:
    path = folder / "why.json"
    path.write_text(json.dumps(record))
    return path


def test_laws_are_read_from_a_diagnosis(tmp_path: Path) -> None:
    """With the shape that their coefficients were found at; what is no law of a joint is told as left out."""
    found = read_named_laws(_written(tmp_path, _record()), ARM)
    assert [(law.effect, law.joint, law.shape) for law in found.laws] == [
        ("nonlinear_viscous_friction", 1, {"exponent": 0.45}),
        ("asymmetric_friction", 0, {}),
    ]
    assert len(found.left_out) == 1
    assert found.left_out[0].startswith("unknown_payload of joint_1")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot": "ur10"}, "it is of the robot 'ur10', not of .*; give a diagnosis of this robot"),
        ({"joints": ["shoulder", "elbow"]}, "give a diagnosis of this robot"),
        ({"schema": "ident.model/1"}, "its schema is 'ident.model/1'"),
        ({"findings": [], "verdict": "no_gap"}, "nothing to take: its verdict is 'no_gap'"),
        ({"findings": [{}]}, "it is damaged"),
        ({"findings": 7}, "it is damaged"),
        ({"baseline": {"joint_2": {"laws": {"nonlinear_viscous_friction": {"shape": {"exponent": -1}}}}}}, "exponent"),
    ],
)
def test_what_is_no_diagnosis_of_this_robot_is_refused(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    """One line that names the file and the remedy."""
    with pytest.raises(InputError, match=words) as caught:
        read_named_laws(_written(tmp_path, _record(**changes)), ARM)
    assert "why.json" in str(caught.value)


@pytest.mark.parametrize("effect", list(KINDS))
def test_no_law_acts_on_a_joint_at_rest(effect: str) -> None:
    """Where neither speed nor direction is, there is no friction, whatever load and angle."""
    shape = {"stribeck_velocity_rad_s": 0.1, "exponent": 0.5, "terms": 4, "load_Nm": 2.0, "order": 1.0}
    law = NamedLaw(effect, 0, shape)
    q, load = np.random.default_rng(0).normal(size=(2, 20))
    still = np.zeros(20)
    assert not law.columns(JointStates(q, still, load, still)).any()


@pytest.mark.parametrize(
    "entry",
    [
        {"effect": "magnet", "joint": 0, "shape": {}, "coefficients": [[1, 0, 2]]},
        {"effect": "stribeck_friction", "joint": 5, "shape": BUMP, "coefficients": [[1, 0, 2]]},
        {"effect": "stribeck_friction", "joint": 0, "shape": {}, "coefficients": [[1, 0, 2]]},
        {"effect": "stribeck_friction", "joint": 0, "shape": BUMP, "coefficients": []},
        {"effect": "stribeck_friction", "joint": 0, "shape": BUMP, "coefficients": [[1, 0, 2]] * 2},
        {"effect": "stribeck_friction", "joint": 0, "shape": BUMP, "coefficients": [[float("nan"), 0, 2]]},
    ],
)
def test_a_damaged_law_is_refused(entry: dict[str, Any]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        NamedLaw.from_dict(entry, 2)
