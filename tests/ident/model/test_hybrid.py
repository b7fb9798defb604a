"""Laws of the hybrid model and of its folder."""

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from ident import fit
from ident.arrays import Array
from ident.command_options import FitOptions
from ident.errors import InputError, ModelError
from ident.export.urdf_file import source_text
from ident.fitting.fit import FitResults, fit_hybrid
from ident.fitting.training_range import find_training_range
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, made_session, random_states, two_joint_arm

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))
DATA = [{"session": "made_up", "file": "run_1.parquet", "sha256": "ab" * 32}]


@pytest.fixture(scope="module")
def motions(arm: ArmModel) -> list[Motion]:
    """Runs of an arm whose links are 10 % heavier, with a friction bump that only a net can follow."""
    heavy = arm.with_inertial_parameters(1.1 * arm.inertial_parameters)

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        bump = 2.0 * np.tanh(dq / 0.02) * np.exp(-((dq / 0.3) ** 2))
        return heavy.inverse_dynamics(q, dq, ddq) + LOSS.torque(dq, ddq) + bump

    return made_motions(arm, law, [1, 2], 8.0, noise=0.1)


@pytest.fixture(scope="module")
def fitted(motions: list[Motion], arm: ArmModel) -> FitResults:
    return fit_hybrid(motions, arm, FitOptions(inertia="base", offset=True), DATA)


@pytest.fixture
def folder(fitted: FitResults, tmp_path: Path) -> Path:
    return fitted.model.save(tmp_path / "model")


def test_a_model_knows_where_it_was_fitted(fitted: FitResults, motions: list[Motion]) -> None:
    """The range holds all but the thousandth outermost states; the torque's half width knows what the fit left open."""
    trained = fitted.model.trained
    assert trained is not None
    assert trained.joints == fitted.model.joint_names
    for k, name in enumerate(("q", "dq", "ddq")):
        values = np.concatenate([getattr(motion, name)[motion.coarse] for motion in motions])
        outside = (values < trained.low[k]) | (values > trained.high[k])
        assert outside.mean() <= 0.003
        assert (trained.high[k] - trained.low[k] <= np.ptp(values, axis=0)).all()
    half = trained.torque_half_width
    assert np.all(half > 0.0)
    estimate = fitted.identified.estimate
    twice = replace(
        fitted.identified,
        estimate=replace(
            estimate,
            covariance=4.0 * estimate.covariance,
            efficient=estimate.values - 2.0 * estimate.shift(estimate.values),
            spread=2.0 * estimate.spread,
        ),
    )
    assert find_training_range(motions, fitted.model.nominal, twice).torque_half_width == pytest.approx(2.0 * half)


def test_a_saved_model_gives_equal_torques(fitted: FitResults, folder: Path) -> None:
    """Torque, ladder, figures and provenance are the same after loading, to the last bit of a float's text."""
    loaded, states = HybridModel.load(folder), random_states(np.random.default_rng(4), 100, 6)
    assert np.allclose(loaded.torque(*states), fitted.model.torque(*states), rtol=0, atol=1e-10)
    for name, torque in fitted.model.ladder(*states).items():
        assert np.allclose(loaded.ladder(*states)[name], torque, rtol=0, atol=1e-10)
    assert loaded.figures == fitted.model.figures
    assert loaded.provenance == fitted.model.provenance
    assert (fitted.model.provenance["data"], fitted.model.provenance["samples"]) == (DATA, 1600)
    assert fitted.model.provenance["versions"].keys() >= {"torch", "pin", "numpy", "python"}
    assert (loaded.links, loaded.inertia, loaded.joint_names) == (6, "base", fitted.model.joint_names)


@pytest.mark.parametrize("links", [3, 6])
def test_a_model_without_a_net_comes_back_too(links: int, motions: list[Motion], arm: ArmModel, tmp_path: Path) -> None:
    """The lumped arm and the full one, nominal inertias: the folder holds text only."""
    model = fit_hybrid(motions, arm, FitOptions(links=links, net="none")).model
    loaded = HybridModel.load(model.save(tmp_path / "model"))
    n = 3 if links == 3 else 6
    states = random_states(np.random.default_rng(5), 20, n)
    assert loaded.joint_names == arm.joint_names[:n]
    assert np.allclose(loaded.torque(*states), model.torque(*states), rtol=0, atol=1e-10)
    assert loaded.net is None
    assert {path.name for path in (tmp_path / "model").iterdir()} == {
        ".armgap.json",
        "robot.urdf",
        "arm.urdf",
        "model.toml",
    }


def test_a_model_opens_nothing_where_a_command_is_started(
    fitted: FitResults, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: a URDF that was named from where the fit was run is that file wherever the model is used, and a name in
    model.toml is one from its own folder: no file of that name elsewhere is read.
    """
    (tmp_path / "fitting").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/own.urdf").write_text("no URDF")
    monkeypatch.chdir(tmp_path / "fitting")
    named = replace(fitted.model, robot=replace(fitted.model.robot, source=Path("own.urdf")))
    named.save(tmp_path / "named")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert HybridModel.load(tmp_path / "named").robot.source == tmp_path / "fitting/own.urdf"
    source = str(fitted.model.robot.source)
    _rewrite("model.toml", (f'source = "{source}"', 'source = "own.urdf"'))(folder)
    loaded = HybridModel.load(folder)
    assert loaded.robot.source == folder / "own.urdf"
    assert source_text(loaded.nominal) == loaded.nominal.urdf


def test_a_model_is_for_its_robot(fitted: FitResults, folder: Path, arm: ArmModel) -> None:
    """Another robot, or the same one without its joints, is refused with both names; the own one is not."""
    fitted.model.require_robot(arm, folder)
    with pytest.raises(ModelError, match=r"the model is of 'tm5_900' \(joint_1.*not of 'panda'"):
        fitted.model.require_robot(ArmModel.load("panda"), folder)
    with pytest.raises(ModelError, match="fit a model for this robot"):
        fitted.model.require_robot(arm.locked(["joint_6"]), folder)


def _rewrite(name: str, *changes: tuple[str, str]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        (folder / name).write_text(text, encoding="utf-8")

    return change


def _cut(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-200])


def _spoil_weight(folder: Path, value: float) -> None:
    """One number of the net's weights becomes another."""
    path = folder / "residual.safetensors"
    weights = load_file(path)
    first = min(weights)
    weights[first] = np.array(weights[first])
    weights[first].flat[0] = value
    save_file(weights, path)


DAMAGES: dict[str, Callable[[Path], None]] = {
    "no folder": shutil.rmtree,
    "empty folder": lambda folder: [path.unlink() for path in folder.iterdir()],
    "no URDF": lambda folder: (folder / "robot.urdf").unlink(),
    "cut URDF": _cut("arm.urdf"),
    "binary URDF": lambda folder: (folder / "arm.urdf").write_bytes(b"\xff\xfe\x00" * 9),
    "another arm's URDF": lambda folder: (folder / "arm.urdf").write_text(ArmModel.load("panda").urdf),
    "binary TOML": lambda folder: (folder / "model.toml").write_bytes(b"\xff\xfe\x00" * 9),
    "not TOML": _rewrite("model.toml", ("[robot]", "[robot")),
    "another schema": _rewrite("model.toml", ("ident.model/1", "ident.model/9")),
    "no schema": _rewrite("model.toml", ('schema = "ident.model/1"', "")),
    "no mode": _rewrite("model.toml", ("mode =", "mood =")),
    "text for a link": _rewrite("model.toml", ("link_1 = [", 'link_1 = ["x", ')),
    "too many numbers": _rewrite("model.toml", ("link_1 = [", "link_1 = [1.0, ")),
    "a link less": _rewrite("model.toml", ("link_6 =", "link_9 =")),
    "no loss": _rewrite("model.toml", ("viscous =", "vicious =")),
    "loss of seven joints": _rewrite("model.toml", ("viscous = [", "viscous = [1.0, ")),
    "loss is NaN": _rewrite("model.toml", ("coulomb = [", "coulomb = [nan]\nspare = [")),
    "loss is a number": _rewrite("model.toml", ("[loss]", "[spare]"), ("schema =", "loss = 3\nschema =")),
    "an unknown figure": _rewrite("model.toml", ("joint = ", "gelenk = ")),
    "no weights": lambda folder: (folder / "residual.safetensors").unlink(),
    "cut weights": _cut("residual.safetensors"),
    "weights are NaN": lambda folder: _spoil_weight(folder, math.nan),
    "a weight is infinite": lambda folder: _spoil_weight(folder, math.inf),
    "scale is NaN": _rewrite("residual.json", ('"input_std":', '"input_std": NaN, "spare":')),
    "no net record": lambda folder: (folder / "residual.json").unlink(),
    "cut net record": _cut("residual.json"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_folder_is_a_model_error(damage: str, folder: Path) -> None:
    """Whatever is missing, cut or foreign, the error names a file of the folder and a remedy in one line."""
    DAMAGES[damage](folder)
    with pytest.raises(ModelError) as error:
        HybridModel.load(folder)
    assert str(folder) in error.value.where
    assert error.value.remedy
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("option", "value", "name"),
    [("links", 4, "--links"), ("inertia", "guessed", "--inertia"), ("net", "huge", "--net"), ("links", "6", "--links")],
)
def test_an_unknown_option_is_an_input_error(option: str, value: object, name: str) -> None:
    """The message names the option, what was given and what may be."""
    with pytest.raises(InputError, match=f"^{name}: {value!r} is unknown; use one of: "):
        FitOptions(**{option: value})  # type: ignore[arg-type]


def test_both_smoothers_lead_to_the_same_fit() -> None:
    """filterpy's general filter by an option: the same losses to a millionth; another name is refused."""
    two, found = two_joint_arm(), []
    session = made_session(
        two, lambda q, dq, ddq: two.inverse_dynamics(q, dq, ddq) + 5.0 * dq + 3.0 * np.sign(dq), [1], 20.0, 50.0
    )
    for smoother in ("fast", "filterpy"):
        fitted = fit(session, two, FitOptions(inertia="nominal", net="none", smoother=smoother))
        assert fitted.model.provenance["options"]["smoother"] == smoother
        found.append(np.concatenate([fitted.loss.params.viscous, fitted.loss.params.coulomb]))
    assert not np.array_equal(*found)
    assert np.allclose(*found, rtol=1e-6)
    with pytest.raises(InputError, match="--smoother"):
        FitOptions(smoother="other")


def test_every_rung_is_nearer_to_the_truth(fitted: FitResults, motions: list[Motion]) -> None:
    """On the training runs no rung is worse than the one below it, joint by joint, and inertia takes gravity's part."""
    errors = []
    for name in ("analytic", "inertia", "loss", "net"):
        left = [motion.tau - fitted.model.ladder(motion.q, motion.dq, motion.ddq)[name] for motion in motions]
        errors.append(np.sqrt(np.mean(np.concatenate(left) ** 2, axis=0)))
    assert np.all(np.diff(errors, axis=0) < 0.05)
    # Where a net stays silent, on two runs of unlike motion, friction's law is left.
    assert np.mean(errors[-1]) < 0.2 * np.mean(errors[1])
    assert np.min(errors[-1]) < 0.4
