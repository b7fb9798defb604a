"""An effect from outside the package goes all the way: diagnosed, patched, asked for again, computed by the module."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.next_experiment import next_experiment
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE, find_effect, load_catalogue
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.loaded import load_module
from ident.export.write import write_patch
from ident.inference.calibration import load_calibration
from ident.robot.arm import ArmModel
from plan.api.exciting import excite
from plan.experiment.hypotheses import ask
from tests.ident.diagnosis.planted import analyse, at_joint, named

MAGNET = '''
import numpy as np
from ident.effects.base import Effect
from ident.effects.effect_info import Typical
from ident.effects.session_context import coefficient_interval, coulomb_level


class Magnet(Effect):
    """A magnet that pulls the joint towards some angles: tau = A sin 3q."""

    id = "magnet"
    summary = "torque repeats three times a turn"
    nonnegative = (0,)
    shown_by = "slow"
    typical = Typical("amplitude_Nm", 0.5)

    def untestable(self, session, joint):
        q = np.concatenate([run.motion.q[:, joint] for run in session.runs])
        return "the joint covers too little" if np.ptp(q) < 1.0 else None

    def columns(self, session, joint, variant):
        return [np.sin(3 * run.motion.q[:, [joint]]) for run in session.runs]

    def parameters(self, session, joint, variant, coefficients, covariance):
        return {"amplitude_Nm": coefficient_interval(0, coefficients, covariance)}

    def prior_scale(self, session, joint, variant):
        return np.array([coulomb_level(session, joint)])

    @staticmethod
    def law(m, j, p):
        return m.at(j, p["amplitude_Nm"] * np.sin(3 * m.q[:, j]))
'''


def magnet_on_3(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """τ₃ = 2 sin 3 q₃ N m."""
    return at_joint(2, 2.0 * np.sin(3 * q[:, 2]))


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> tuple[Effect, ...]:
    path = tmp_path_factory.mktemp("own") / "magnet.py"
    path.write_text(MAGNET)
    found = load_catalogue(path)
    assert found[:-1] == CATALOGUE
    return found


@pytest.fixture(scope="module")
def analysis(catalogue: tuple[Effect, ...], short_arm: ArmModel) -> Analysis:
    """What the diagnosis makes of an arm with a magnet."""
    few = [effect for effect in catalogue if effect.id in ("magnet", "spring_torque", "torque_offset")]
    return analyse(short_arm, magnet_on_3, few)


@pytest.fixture(scope="module")
def diagnosis(analysis: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its JSON."""
    assert named(analysis) == {("magnet", "joint_3")}
    path = tmp_path_factory.mktemp("diagnosis") / "diagnosis.json"
    path.write_text(json.dumps(analysis.diagnosis.to_dict()))
    return path


def test_its_law_goes_into_the_module(
    catalogue: tuple[Effect, ...], diagnosis: Path, short_arm: ArmModel, tmp_path: Path
) -> None:
    """Law: the module computes what the class's columns say, and the patch tells that no file has words for it."""
    record = write_patch(Diagnosed.load(diagnosis, catalogue), short_arm, tmp_path / "patch")
    formats = record["effects"][0]["formats"]
    assert {form: one["expressed"] for form, one in formats.items()} == {
        "urdf": "no",
        "mjcf": "no",
        "parameters": "yes",
        "module": "yes",
    }
    module = load_module(tmp_path / "patch" / "extra_torque.py")
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    extra = module.extra_torque(q, 0.5 + 0.0 * q, 0.0 * q)
    np.testing.assert_allclose(extra[:, :2], 0.0, atol=1e-9)
    told = json.loads(diagnosis.read_text())["findings"][0]["parameters"]["amplitude_Nm"]
    assert told["low"] < 2.0 < told["high"]
    np.testing.assert_allclose(extra[:, 2], told["value"] * np.sin(3 * q[:, 2]), atol=1e-9)


def test_what_lies_outside_its_range_is_believed_less(short_arm: ArmModel, tmp_path: Path) -> None:
    """Law: where a class says that no magnet has more than 1 N m, the share stays by which such names of the corpus
    were right; the reason stands first.
    """
    path = tmp_path / "weak.py"
    bounded = """
    def physical(self, session, joint, figures):
        return {"amplitude_Nm": Range(0.0, 1.0, "no magnet of this size is stronger")}
"""
    text = MAGNET.replace("    @staticmethod", f"{bounded}\n    @staticmethod").replace(
        "Typical\n", "Range, Typical\n", 1
    )
    path.write_text(text)
    magnet = find_effect("magnet", load_catalogue(path))
    told = analyse(short_arm, magnet_on_3, [magnet]).conclusion
    (weak,) = [*told.names, *told.unlikely]
    share = load_calibration().unlike_any_arm
    assert 0.0 < share < 1.0
    features = weak.described.features
    assert weak.estimate.class_probability == pytest.approx(share * load_calibration().names.probability(features))
    assert "no magnet of this size is stronger" in weak.estimate.reasons[0].what
    assert weak.estimate.parameters["amplitude_Nm"].value == pytest.approx(2.0, rel=0.1)


def test_without_its_file_the_patch_says_so(diagnosis: Path, short_arm: ArmModel, tmp_path: Path) -> None:
    """Law: what is known to its file only is left out, and the reason names the remedy."""
    record = write_patch(Diagnosed.load(diagnosis), short_arm, tmp_path / "patch")
    assert "--catalogue" in record["effects"][0]["formats"]["module"]["how"]


def test_a_motion_can_be_asked_for_it(catalogue: tuple[Effect, ...], diagnosis: Path, short_arm: ArmModel) -> None:
    """Law: its own motion and its own typical size are asked, where the diagnosis says nothing else."""
    question = ask(short_arm, "magnet,spring_torque", None, diagnosis, catalogue)
    assert question.ids == ("magnet", "spring_torque")
    assert question.joint == 2
    assert question.reported["magnet"]["amplitude_Nm"] == pytest.approx(2.0, rel=0.2)
    assert ask(short_arm, "magnet", None, diagnosis, catalogue).family == "slow"
    unseen = [{"effect": "magnet", "joints": ["joint_1"], "reason": "it stands still"}]
    found = next_experiment([], unseen, catalogue)
    assert found is not None
    assert "two slow steady speeds" in found["motion"]
    short = [{"effect": "thermal_friction", "joints": ["joint_1"], "reason": "the session lasts 9 s only"}]
    assert str((next_experiment([], short) or {})["motion"]).startswith(
        "All joints fast over wide poses, longer than before"
    )
    with pytest.raises(InputError, match="no effect 'magnet'"):
        ask(short_arm, "magnet", None, diagnosis)


def test_a_motion_is_worked_out_for_it(catalogue: tuple[Effect, ...], diagnosis: Path) -> None:
    """Law: `plan excite` finds runs that part it from its rival, and says by how much."""
    found = excite(
        "tm5-900", separate="magnet,spring_torque", joint="3", catalogue=catalogue[-1:], minutes=0.2, evaluations=2
    )
    assert found.runs
    assert found.smallest[0] > 0.0
