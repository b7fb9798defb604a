"""Of all candidates the nearest file is written, joint by joint."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from ident.api.exporting import patch
from ident.arrays import Array
from ident.cli.app import app
from ident.export.bodies import Links, nearest_bodies
from ident.export.choose import WINDOW, Gap, choose, measure_gap
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import WrittenFile
from ident.export.mjcf import write_mjcf
from ident.export.urdf_file import write_urdf
from ident.export.write import write_patch
from ident.laws.motion import Losses
from ident.recordings.recording import Payload
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.export.diagnoses import COULOMB, FIGURES, LINK_KEYS, ROTOR, VISCOUS, baseline, write_diagnosis
from tests.ident.made_up import made_motions, made_session

LOSSES = Losses(np.full(6, 0.2), np.full(6, 6.0), np.full(6, 4.0), np.full(6, 0.01), np.zeros(6))
Law = Callable[[Array, Array, Array], Array]


@pytest.fixture(autouse=True)
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six windows say enough where the law is known."""
    monkeypatch.setattr("ident.export.choose.MOST_WINDOWS", 6)


def stated(coulomb: float = 4.0, heavier: float = 0.0, joint: Any = slice(None)) -> IdentifiedArm:
    """Links that are heavier by a share, dry friction of one joint or of all."""
    arm = ArmModel.load("tm5-900")
    level = np.full(6, 4.0)
    level[joint] = coulomb
    links = heavier * arm.inertial_parameters.reshape(6, 10)
    losses = replace(LOSSES, coulomb=level, motor_inertia=np.full(6, 0.2))
    return IdentifiedArm(arm, losses, Links(links, 0.0 * links, 0.0))


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize(
    "options",
    [
        {"before": stated(heavier=0.3), "tuned": stated(heavier=0.1), "after": stated()},
        {"before": stated(heavier=0.3), "tuned": stated(), "after": stated(heavier=0.2)},
        {"before": stated(heavier=0.3), "tuned": stated(6.0), "after": stated(8.0, joint=2)},
    ],
)
def test_the_nearest_is_written_joint_by_joint(form: str, options: dict[str, IdentifiedArm], tmp_path: Path) -> None:
    """Law: on runs of a known arm its own bodies are taken, and at each joint the friction that is nearest."""
    arm = ArmModel.load("tm5-900")
    law: Law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + LOSSES.torque(dq, ddq, np.tanh(dq / 0.01))  # noqa: E731
    found = choose(form, options, made_motions(arm, law, [3], duration=4.0), tmp_path / "scratch")
    np.testing.assert_array_equal(found.stated.links.total, 0.0)
    np.testing.assert_allclose(found.stated.losses.coulomb, 4.0, rtol=1e-3)
    for gap in found.gaps.values():
        assert np.all(found.gaps["after"].error("torque") <= 1.01 * gap.error("torque") + 1e-6)
    assert bool(found.in_words(form, arm.joint_names)) == (found.name != "after" or bool(found.worse))


def test_meshes_are_kept_as_hulls() -> None:
    """The MJCF of an arm of meshes loads, and has a geom a mesh, where the mesh is."""
    arm = ArmModel.load("ur10")
    model = mujoco.MjModel.from_xml_string(write_mjcf(IdentifiedArm.as_urdf(arm)))
    assert model.ngeom == len(arm.geometry.geometryObjects)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shapes = [item for item in arm.geometry.geometryObjects if hasattr(item.geometry, "vertices")]
    for number, item in enumerate(shapes[:3]):
        corners = np.array(item.geometry.vertices())
        geom = next(i for i in range(model.ngeom) if model.geom_dataid[i] == number)
        start, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
        turned = data.geom_xmat[geom].reshape(3, 3) @ model.mesh_vert[start : start + count].T
        body = model.geom_bodyid[geom]
        there = turned.T + data.geom_xpos[geom] - data.xpos[body]
        there = there @ data.xmat[body].reshape(3, 3)
        here = corners @ item.placement.rotation.T + item.placement.translation
        assert there.min(axis=0) == pytest.approx(here.min(axis=0), abs=1e-5)
        assert there.max(axis=0) == pytest.approx(here.max(axis=0), abs=1e-5)


def test_an_error_is_worse_by_its_ratio_and_by_what_stretches_leave_open_in_a_choice() -> None:
    """Law: errors compare by their ratio; a candidate that is better in one stretch alone is not taken."""
    one = dict.fromkeys(("torque", "energy", "position"), np.ones((9, 6)))
    better, worse = (Gap({**one, "energy": k * one["energy"]}, np.ones(6)) for k in (1.0, 4.0))
    luck = Gap({**one, "energy": 1.0 - 0.9 * np.eye(9, 1) * np.ones(6)}, np.ones(6))
    np.testing.assert_allclose(np.exp(worse.over([better, worse]))[:, 0], [1.0, 2.0, 1.0], rtol=1e-6)
    assert np.all(worse.cost([better]) > 4.0 * np.log(2.0))
    assert np.all(better.cost([worse]) < 0.0)
    assert np.all(luck.over([better])[1] < 0.0)
    assert np.all(luck.cost([better]) >= 0.0)


def test_a_replay_judges_joints_that_move_and_knows_an_arm_that_is_lost(tmp_path: Path) -> None:
    """Law: standing still is no error; light links don't swing up by friction's steps; one that is lost misses its way.

    So much and no more, however far it flies: it is a few of its windows that are lost.
    """
    arm, light = stated().nominal, replace(stated(), losses=replace(LOSSES, motor_inertia=np.zeros(6)))
    (motion,) = made_motions(arm, healthy(arm), [3], duration=4.0)
    still, file = replace(motion, dq=motion.dq * (np.arange(6) != 2)), WrittenFile.write("urdf", tmp_path, light)
    fast = WINDOW * np.sqrt(np.mean(motion.dq**2, axis=0))
    near, *lost = (
        measure_gap(file.load(), [replace(motion, tau=motion.tau + push)]).error("position") for push in (0.0, 1e4, 1e6)
    )
    assert np.all((near > 0.0) & (near < lost[0]))
    assert np.all((lost[0] > 0.5 * fast) & (lost[0] < 2.0 * fast))
    np.testing.assert_allclose(*lost, rtol=1e-6)
    assert measure_gap(file.load(), [still]).error("position")[2] == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_what_an_arm_weighs_is_kept_where_tuning_leaves_no_bodies(seed: int) -> None:
    """Law: of a tuning with impossible second moments the nearest bodies keep 95 % of the weight's change."""
    arm, rng = ArmModel.load("ur10"), np.random.default_rng(seed)
    numbers = arm.inertial_parameters.reshape(6, 10)
    tuning = numbers * np.concatenate([np.full(4, 0.3), np.full(6, -1.5)]) * rng.uniform(0.5, 1.0, (6, 10))
    change, _ = nearest_bodies(arm, tuning)
    poses = rng.uniform(-2.0, 2.0, (50, 6))
    weight = arm.regressor(poses, 0.0 * poses, 0.0 * poses)
    left = np.linalg.norm(weight @ (change - tuning).ravel()) / np.linalg.norm(weight @ tuning.ravel())
    assert left < 0.05


def healthy(arm: ArmModel) -> Law:
    """Torque of the arm with the losses of the hand-written diagnoses."""
    return lambda q, dq, ddq: (
        arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + VISCOUS * dq + COULOMB * np.tanh(dq / 0.01)
    )


def measure(folder: Path, arm: ArmModel, effect: str, law: Law) -> dict[str, Any]:
    """Gaps of the patch of an effect on a run with a law."""
    diagnosed = Diagnosed.load(write_diagnosis(folder / "diagnosis.json", arm, effect))
    motions = made_motions(arm, law, [3], duration=6.0)
    return dict(write_patch(diagnosed, arm, folder / "patch", motions)["heldout"]["gaps"])


def torque(gap: dict[str, Any]) -> float:
    return float(np.max(list(gap["torque_rms_Nm"].values())))


def miss(gap: dict[str, Any]) -> float:
    return float(np.max(list(gap["position_rms_rad"].values())))


def loaded(arm: ArmModel) -> Law:
    """The same arm with the payload of `FIGURES`, as the identification carries payloads."""
    figures = FIGURES["payload"]
    x, y, z = (figures[f"com_{axis}_m"] for axis in "xyz")
    return healthy(arm.with_payload(Payload(figures["mass_kg"], (x, y, z))))


def sprung(arm: ArmModel) -> Law:
    spring = FIGURES["spring_torque"]
    pull = np.eye(6)[1] * spring["stiffness_Nm_rad"]
    return lambda q, dq, ddq: healthy(arm)(q, dq, ddq) + pull * (q - spring["rest_rad"])


def misread(arm: ArmModel) -> Law:
    gain = np.ones(6) + np.eye(6)[1] * FIGURES["torque_gain_error"]["gain"]
    return lambda q, dq, ddq: gain * healthy(arm)(q, dq, ddq)


@pytest.mark.parametrize(
    ("effect", "law"), [("payload", loaded), ("spring_torque", sprung), ("torque_gain_error", misread)]
)
def test_a_patch_explains_what_its_effect_does(
    tmp_path: Path, arm: ArmModel, effect: str, law: Callable[[ArmModel], Law]
) -> None:
    """In MuJoCo the patch closes the gap of torque and of motion; with the module, in Pinocchio too."""
    gaps = measure(tmp_path, arm, effect, law(arm))
    for form, when in (("mjcf", "after"), ("mjcf", "after_with_module"), ("urdf", "after_with_module")):
        assert torque(gaps[form]["before"]) > 0.5
        assert torque(gaps[form][when]) < 0.1 * torque(gaps[form]["before"])
        assert miss(gaps[form][when]) < 0.5 * miss(gaps[form]["before"])


@pytest.mark.parametrize(
    ("effect", "is_measured"),
    [
        ("torque_gain_error", False),
        ("torque_gain_error", True),
        ("torque_offset", False),
        ("torque_delay", False),
        ("torque_saturation", False),
    ],
)
def test_what_is_wrong_with_the_log_is_not_written_into_the_links(
    effect: str, is_measured: bool, tmp_path: Path, arm: ArmModel
) -> None:
    """Law: links that were tuned as if the log were right are none of the arm's, though they follow its torques."""
    gain = FIGURES["torque_gain_error"]["gain"]
    alone = baseline(arm)
    for j, joint in enumerate(arm.joint_names[1:], start=1):
        numbers = gain * arm.inertial_parameters[10 * j : 10 * j + 10]
        alone[joint]["link_change"] = dict(zip(LINK_KEYS, numbers.tolist(), strict=True))
    path = write_diagnosis(tmp_path / "why.json", arm, effect, baseline_alone=alone)
    motions = made_motions(arm, misread(arm), [3], duration=6.0) if is_measured else []
    write_patch(Diagnosed.load(path), arm, tmp_path / "patch", motions)
    written = ArmModel.load(str(tmp_path / "patch" / "robot.urdf")).inertial_parameters
    np.testing.assert_allclose(written, arm.inertial_parameters, rtol=1e-6, atol=1e-9)


def test_the_command_writes_measures_and_tells(tmp_path: Path, arm: ArmModel) -> None:
    """`ident patch … --on SESSION` prints what each format says, and writes the gaps."""
    diagnosis = write_diagnosis(tmp_path / "diagnosis.json", arm, "payload", "stribeck_friction")
    session = tmp_path / "session"
    session.mkdir()
    write_session(made_session(arm, loaded(arm), [1], duration=6.0), session)
    out, record = tmp_path / "patch", tmp_path / "record.json"
    words = [str(diagnosis), "--robot", "tm5-900", "--out", str(out), "--on", str(session), "--json", str(record)]
    result = CliRunner().invoke(app, ["patch", *words])
    assert result.exit_code == 0, result.output
    told = " ".join(result.output.split())
    assert "payload felt at joint_1, joint_2, joint_3" in told
    assert ": URDF has it, MJCF has it, parameter file has it, Python module has it" in told
    assert "URDF has no place for it, MJCF has no place for it, parameter file has it, Python module has it" in told
    assert "measured on no recordings" not in result.output
    written = json.loads((out / "patch.json").read_text())
    assert written == json.loads(record.read_text())
    assert written["schema"] == "ident.patch/1"
    assert set(written["heldout"]["gaps"]["mjcf"]) == {"given", "before", "tuned", "after", "after_with_module"}


WALL, CEILING = (9.81, 0.0, 0.0), (0.0, 0.0, 9.81)
POSES = np.random.default_rng(3).uniform(-1.5, 1.5, (20, 6))


def diagnosed(folder: Path, arm: ArmModel, gravity: tuple[float, ...], *effects: str) -> Path:
    origin = {"command": "ident diagnose", "settings": {"gravity_mps2": list(gravity)}, "sessions": []}
    return write_diagnosis(folder / "why.json", arm, *effects, provenance=origin)


@pytest.mark.parametrize("gravity", [WALL, CEILING, (1.0, -2.0, -9.0)])
@pytest.mark.parametrize("effects", [("torque_offset",), ("gravity_misalignment",)])
def test_the_urdf_stands_as_the_arm_was_mounted(
    gravity: tuple[float, ...], effects: tuple[str, ...], tmp_path: Path, arm: ArmModel
) -> None:
    found = Diagnosed.load(diagnosed(tmp_path, arm, gravity, *effects)).candidates(arm)["after"]
    (tmp_path / "robot.urdf").write_text(write_urdf(found), encoding="utf-8")
    written = ArmModel.load(tmp_path / "robot.urdf").keeping(arm.joint_names)
    wanted = arm.with_gravity(found.gravity * 9.81 / np.linalg.norm(found.gravity)).gravity(POSES)
    assert np.abs(written.gravity(POSES) - wanted).max() < 1e-6
    assert f'gravity="{" ".join(map(repr, map(float, found.gravity)))}"' in write_mjcf(found)


def test_a_patch_says_how_its_base_hangs(tmp_path: Path, arm: ArmModel) -> None:
    patch(diagnosed(tmp_path, arm, WALL, "torque_offset"), arm, tmp_path / "patch")
    record = json.loads((tmp_path / "patch" / "patch.json").read_text(encoding="utf-8"))
    assert any("(9.81 0.00 0.00)" in line for line in record["told"])


def test_dry_friction_of_a_light_joint_is_whole_in_mujoco(tmp_path: Path) -> None:
    """Law: at speeds beyond rest every joint of the MJCF rubs with its friction, however light its link is."""
    arm = stated()
    model = WrittenFile.write("mjcf", tmp_path, replace(arm, losses=replace(LOSSES, motor_inertia=np.zeros(6)))).load()
    q, dq = np.zeros((1, 6)), np.full((1, 6), 0.03)
    rubbed = model.joint_torque(q, dq, 0 * q, 0.0) - model.joint_torque(q, -dq, 0 * q, 0.0)
    np.testing.assert_allclose(rubbed / 2.0 - LOSSES.viscous * dq, 4.0, rtol=0.03)


def test_of_a_few_stretches_little_is_sure() -> None:
    """Law: the same scatter counts more the fewer stretches there are, of one alone all of it; no scatter, nothing."""
    even, names = np.tile([[1.0], [3.0]], (32, 1)) * np.ones(6), ("torque", "energy", "position")

    def cost(count: int) -> float:
        one, other = (Gap(dict.fromkeys(names, x[:count]), np.ones(6)) for x in (0.5 * even, even[::-1]))
        return float(one.cost([other]).max())

    assert cost(64) < 0.0 < cost(8) < cost(4) < cost(2)
    one, better = (Gap(dict.fromkeys(names, x), np.ones(6)) for x in (even[:1], 0.1 * even[:1]))
    assert np.all(better.cost([one]) > one.cost([one]))
    np.testing.assert_allclose(one.cost([one]), 0.0, atol=1e-9)


@pytest.mark.parametrize("better", [1.0 - 0.9 * np.eye(9, 1), np.full((9, 1), 0.2)], ids=["in one stretch", "in all"])
def test_a_mixture_is_written_where_it_surely_gains(
    better: Array, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: tuned, one joint is better and another worse; by chance alone no joint takes another candidate's losses."""

    def measured(model: Any, _: Any) -> Gap:
        squares = np.where(model.losses.coulomb == 1.0, 1.0, np.column_stack([better, np.full((9, 5), 4.0)]))
        return Gap(dict.fromkeys(("torque", "energy", "position"), squares), np.ones(6))

    monkeypatch.setattr("ident.export.choose.measure_gap", measured)
    arm, law = stated().nominal, healthy(stated().nominal)
    options = {"before": stated(1.0), "tuned": stated(2.0), "after": stated(1.0)}
    found = choose("urdf", options, made_motions(arm, law, [3], duration=4.0), tmp_path / "scratch")
    assert found.joints[0] == ("tuned" if better[-1] < 1.0 else found.bodies)
    assert set(found.joints[1:]) <= {"before", "after"}


def test_work_that_is_given_back_is_an_error_of_energy(tmp_path: Path) -> None:
    """Law: an error that is a spring's takes and gives its energy, whatever of it is left at a stretch's end."""
    arm, file = stated().nominal, WrittenFile.write("urdf", tmp_path, stated())
    law: Law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + LOSSES.torque(dq, ddq, np.tanh(dq / 0.01))  # noqa: E731
    (motion,) = made_motions(arm, law, [3], duration=4.0)
    turn = motion.q - motion.q.mean(axis=0)
    swing = (2.5 * turn**2).std(axis=0)
    found = measure_gap(file.load(), [replace(motion, tau=motion.tau + 5.0 * turn)]).error("energy")
    assert np.all((found > 0.4 * swing) & (found < 1.5 * swing))
