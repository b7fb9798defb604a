"""Written files: loaded back, they differ from the tuned arm by what the effects say, and by nothing else."""

import ast
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from ident.effects.added_body import PLACE
from ident.effects.base import Interval
from ident.effects.catalogue import find_effect
from ident.errors import InputError
from ident.export.bodies import Links, nearest_bodies
from ident.export.formats import state_arm, usual_run
from ident.export.identified import Change, Diagnosed, IdentifiedArm, in_module, untuned
from ident.export.into import require_loadable, write_into
from ident.export.loaded import LoadedMjcf, WrittenFile, load_module
from ident.export.mjcf import spring_at_rest
from ident.export.urdf_file import write_urdf
from ident.export.write import PATCH_FILES, write_patch
from ident.laws.acting import acting_torque, link_change, point_mass
from ident.laws.motion import Losses, MovingArm
from ident.model.bodies import is_consistent
from ident.model.carried import describe_arm
from ident.model.inertia import base_parameters, lift_base
from ident.model.linearisation import stop_operator
from ident.outputs import MARKER
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from tests.ident.export.diagnoses import COULOMB, FIGURES, VISCOUS, baseline, write_diagnosis
from tests.ident.made_up import random_states


def make_patch(folder: Path, arm: ArmModel, *effects: str, joint: int = 1, **changes: Any) -> dict[str, Any]:
    """A patch of effects with the figures of `FIGURES`."""
    path = write_diagnosis(folder / "diagnosis.json", arm, *effects, joint=joint, **changes)
    return write_patch(Diagnosed.load(path), arm, folder / "patch")


@pytest.mark.parametrize("taken_kg", [-1.0, -1.48])
def test_a_change_larger_than_the_link_takes_from_what_hangs_on_it(taken_kg: float) -> None:
    """Less than the last link's own mass is left, then less than its and the hand's: what is read back was meant, and
    no link weighs less than nothing; also where the URDF that the arm was read from is gone, whatever axis it had.
    """
    whole = ArmModel.load("panda")
    urdf = whole.urdf.replace('_hand_joint" type="fixed">', '_hand_joint" type="fixed"><axis xyz="0 0 0"/>')
    arm = replace(whole, source=Path("gone.urdf"), urdf=urdf)
    last = arm.inertial_parameters.reshape(-1, 10)[-1]
    changes = np.zeros((arm.n, 10))
    changes[-1] = last * (taken_kg / last[0])
    none = np.zeros(arm.n)
    links = Links(changes, 0.0 * changes, 0.0)
    text = write_urdf(IdentifiedArm(arm, Losses(none, none, none, none, none), links))
    again = ArmModel.from_urdf(text, arm.source)
    np.testing.assert_allclose(again.inertial_parameters, arm.inertial_parameters + changes.ravel(), atol=1e-9)


def test_a_users_urdf_keeps_prefixes_that_it_never_declared(tmp_path: Path) -> None:
    """Law: the file that is edited comes out readable, and other programs' attributes in it as they were."""
    given = tmp_path / "arm.urdf"
    given.write_text(
        ArmModel.load("panda").urdf.replace("<limit ", '<limit drake:acceleration="2.5" '), encoding="utf-8"
    )
    arm = ArmModel.load(given)
    none, links = np.zeros(arm.n), np.zeros((arm.n, 10))
    text = write_urdf(IdentifiedArm(arm, Losses(none, none, none, none, none), Links(links, links, 0.0)))
    assert text.count("drake:acceleration") == given.read_text(encoding="utf-8").count("drake:acceleration") > 0
    assert ArmModel.from_urdf(text, given).joint_names == arm.joint_names


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, arm: ArmModel) -> Path:
    """A patch of an effect that neither file has words for."""
    folder = tmp_path_factory.mktemp("plain")
    make_patch(folder, arm, "stribeck_friction")
    return folder / "patch"


@pytest.mark.parametrize("effect", sorted(FIGURES))
def test_every_file_says_its_effect_or_that_it_does_not(
    tmp_path: Path, arm: ArmModel, plain: Path, effect: str
) -> None:
    """Loaded back, each file is its tuned arm plus the effects that it claims; what it can't say has a reason."""
    record = make_patch(tmp_path, arm, effect)
    assert {path.name for path in (tmp_path / "patch").iterdir()} == {*PATCH_FILES, MARKER}
    formats = record["effects"][0]["formats"]
    assert formats["parameters"]["expressed"] == "yes"
    for form, name in (("urdf", "robot.urdf"), ("mjcf", "robot.xml")):
        assert formats[form]["how"]
        if formats[form]["expressed"] != "no":
            assert (tmp_path / "patch" / name).read_text() != (plain / name).read_text()
        assert formats[form].get("off", 0.0) < 0.01 or formats[form]["expressed"] == "no"
        left = record["structure"][form]["torque_difference_Nm"]
        # A payload's extent of a centimetre is not the law's point; a gear that gives way has no torque of a state.
        twists = effect == "joint_elasticity" and form == "mjcf"
        assert left is None if twists else left < (0.01 if effect == "payload" else 1e-6)


def test_the_module_needs_numpy_alone(tmp_path: Path, arm: ArmModel) -> None:
    """It imports the standard library and NumPy, nothing else, and takes single states."""
    make_patch(tmp_path, arm, "stribeck_friction")
    path = tmp_path / "patch" / "extra_torque.py"
    tree = ast.parse(path.read_text())
    named = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    named |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert named == {"__future__", "collections.abc", "dataclasses", "functools", "math", "typing", "numpy"}
    module = load_module(path)
    zero, speed = np.zeros(6), np.array([0.0, 0.25, 0.0, 0.0, 0.0, 0.0])
    extra = module.extra_torque(zero, speed, zero)
    np.testing.assert_allclose(extra, [0, 4.0 * np.exp(-0.25), 0, 0, 0, 0], atol=1e-9)
    states = np.atleast_2d(speed), np.zeros((1, 6)), np.sign(np.atleast_2d(speed))
    more = module.FILE_LOSSES["mjcf"].torque(*states) - module.LOSSES.torque(*states)  # stands in for the law
    np.testing.assert_allclose(module.missing_torque("mjcf", zero, speed, zero) + more[0], extra, atol=1e-9)


@pytest.mark.parametrize("effect", ["stribeck_friction", "load_dependent_friction", "asymmetric_friction"])
def test_losses_that_stand_in_for_a_law_are_the_nearest(tmp_path: Path, arm: ArmModel, effect: str) -> None:
    """Law: along motions like those that they were fitted to, no other pair of friction leaves less of the law."""
    path = write_diagnosis(tmp_path / "diagnosis.json", arm, effect)
    identified = Diagnosed.load(path).candidates(arm)["after"]
    run = usual_run(arm)
    losses = state_arm(identified, "urdf", [run]).losses
    moving = MovingArm(describe_arm(arm), identified.losses, *run)
    target = acting_torque(in_module(identified.changes), moving)[:, 1] + COULOMB[1] * moving.direction[:, 1]
    target += VISCOUS[1] * moving.dq[:, 1]

    def left(coulomb: float, viscous: float) -> float:
        return float(np.sum((target - coulomb * moving.direction[:, 1] - viscous * moving.dq[:, 1]) ** 2))

    best = losses.coulomb[1], losses.viscous[1]
    assert left(*best) < 0.999 * left(COULOMB[1], VISCOUS[1]) or effect == "asymmetric_friction"
    for step in (0.1, -0.1):
        assert left(best[0] + step, best[1]) > left(*best)
        assert left(best[0], best[1] + step) > left(*best)
    np.testing.assert_array_equal(np.delete(losses.coulomb, 1), np.delete(COULOMB, 1))


def test_without_recordings_losses_fitted_without_a_law_stand_in_for_it(tmp_path: Path, arm: ArmModel) -> None:
    """Law: at the joint of a law that no file tells, both files rub as the joint that was tuned without it."""
    alone = baseline(arm)
    alone["joint_2"] |= {"coulomb_Nm": 9.0, "viscous_Nms_rad": 7.0}
    record = make_patch(tmp_path, arm, "load_dependent_friction", baseline_alone=alone)
    assert sum("measured on no recordings: with --on" in line for line in record["told"]) == 1
    rubs = ArmModel.load(tmp_path / "patch" / "robot.urdf").model
    np.testing.assert_allclose(rubs.friction, [8.0, 9.0, 6.0, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(rubs.damping, [10.0, 7.0, 8.0, 3.0, 3.0, 2.0])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "patch" / "robot.xml"))
    np.testing.assert_allclose(model.dof_frictionloss, rubs.friction)


def test_what_the_reported_figures_leave_open_is_carried_along(tmp_path: Path, arm: ArmModel) -> None:
    """All ranges of a hysteresis, and the displacement of dry friction, come from the diagnosis into every part."""
    tuned = baseline(arm)
    tuned["joint_2"]["sliding_range_rad"] = 2e-4
    shape = {"range_0_rad": 0.001, "range_1_rad": 0.01, "range_2_rad": 0.05}
    tuned["joint_2"]["laws"] = {"presliding_hysteresis": {"coefficients": [1.0, 3.0, 2.0], "shape": shape}}
    make_patch(tmp_path, arm, "presliding_hysteresis", baseline=tuned)
    q = np.zeros((400, 6))
    q[:, 1] = 0.03 * np.sin(np.linspace(0.0, 9.0, 400))
    ladder = [stop_operator(np.ascontiguousarray(q[:, 1]), size) / size for size in (2e-4, *shape.values())]
    module = load_module(tmp_path / "patch" / "extra_torque.py")
    states = q, np.gradient(q, 0.01, axis=0), np.zeros_like(q)
    wanted = np.array([1.0, 3.0, 2.0]) @ np.array(ladder[1:])
    np.testing.assert_allclose(module.extra_torque(*states, 0.01)[:, 1], wanted, atol=1e-9)
    friction = module.modelled_torque(*states, 0.01) - module.modelled_torque(*states, 0.01, slip=np.zeros_like(q))
    np.testing.assert_allclose(friction[:, 1], COULOMB[1] * ladder[0], atol=1e-9)
    record = tomllib.loads((tmp_path / "patch" / "parameters.toml").read_text())
    assert record["losses"]["joint_2"]["sliding_range_rad"] == 2e-4
    assert record["effect"][0]["law"]["range_2_rad"] == 0.05


def test_a_sensor_is_late_and_a_motor_is_not(tmp_path: Path, arm: ArmModel) -> None:
    """A pulse of torque acts at once and is read after the delay."""
    make_patch(tmp_path, arm, "torque_delay")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "patch" / "robot.xml"))
    data = mujoco.MjData(model)
    read, acted = [], []
    for k in range(40):
        data.ctrl[1] = 5.0 if k == 10 else 0.0
        mujoco.mj_step(model, data)
        read.append(float(data.sensordata[1]))
        acted.append(float(data.qfrc_actuator[1]))
    assert int(np.argmax(acted)) == 10
    assert int(np.argmax(read)) == 10 + round(FIGURES["torque_delay"]["delay_s"] / model.opt.timestep)


def test_a_named_error_that_leaves_no_body_is_written_by_its_torque(arm: ArmModel) -> None:
    """A kilogram can't be taken from a link of less: bodies that together act as if it were are written instead."""
    error = {"mass_change_kg": -1.0, "moment_change_x_kgm": 0.0, "moment_change_y_kgm": 0.0, "moment_change_z_kgm": 0.0}
    figures = {name: Interval(value, value, value) for name, value in error.items()}
    change = Change("link_inertial_error", 5, ("joint_6",), figures, kind=find_effect("link_inertial_error"))
    wanted = link_change(arm.inertial_parameters.reshape(6, 10)[5], error)
    assert not is_consistent(arm.inertial_parameters.reshape(6, 10)[5] + wanted)
    links = IdentifiedArm.tuned_to(arm, untuned(6), [change]).links
    bodies = arm.inertial_parameters.reshape(6, 10) + links.total
    assert all(is_consistent(body) for body in bodies)
    rng = np.random.default_rng(2)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, 50, 6))
    regressor = arm.regressor(q, dq, ddq)
    torque = regressor[:, :, 50:] @ wanted
    left = regressor @ links.total.ravel() - torque
    assert np.sqrt(np.mean(left**2)) < 0.05 * np.sqrt(np.mean(torque**2))


def test_a_body_beside_a_link_has_the_inertia_of_its_place(arm: ArmModel) -> None:
    """Where a diagnosis laid a body out about a place, the written link's second moments are those of a body there."""
    place, mass = np.array([0.1, -0.05, 0.06]), 0.4
    error = {"mass_change_kg": mass, **{f"moment_change_{k}_kgm": mass * x for k, x in zip("xyz", place, strict=True)}}
    figures = {name: Interval(value, value, value) for name, value in error.items()}
    law = {"coefficients": (mass, 0.0, 0.0, 0.0), "shape": dict(zip(PLACE, place, strict=True))}
    change = Change("link_inertial_error", 4, ("joint_5",), figures, law=law, kind=find_effect("link_inertial_error"))
    link = arm.inertial_parameters.reshape(6, 10)[4]
    np.testing.assert_allclose(link_change(link, change.values), mass * point_mass(place), atol=1e-12)
    identified = IdentifiedArm.tuned_to(arm, untuned(6), [change])
    np.testing.assert_allclose(identified.links.named[4], mass * point_mass(place))


def test_friction_that_bends_is_a_polynomial(tmp_path: Path, arm: ArmModel) -> None:
    """Law: a square is stated exactly, a root to a tenth, and each says so; the file's own figures are the module's."""
    for exponent, answer in ((2.0, "yes"), (0.5, "approximate")):
        path = write_diagnosis(tmp_path / "diagnosis.json", arm, "nonlinear_viscous_friction")
        record = json.loads(path.read_text())
        record["findings"][0]["parameters"]["exponent"] = dict.fromkeys(("value", "low", "high"), exponent)
        path.write_text(json.dumps(record))
        said = write_patch(Diagnosed.load(path), arm, tmp_path / "patch")["effects"][0]["formats"]["mjcf"]
        assert said["expressed"] == answer
        assert (f"it lacks {100.0 * said['off']:.0f} %" in said["how"]) == (answer != "yes")
        model = LoadedMjcf(tmp_path / "patch" / "robot.xml", arm.joint_names)
        module = load_module(tmp_path / "patch" / "extra_torque.py")
        q, dq = np.zeros((40, 6)), np.linspace(0.1, 1.5, 40)[:, None] * np.eye(6)[1]
        law = module.modelled_torque(q, dq, 0 * q) + module.extra_torque(q, dq, 0 * q)
        found = model.joint_torque(q, dq, 0 * q, 0.0)
        np.testing.assert_allclose(found + module.missing_torque("mjcf", q, dq, 0 * q), law, atol=1e-5)
        np.testing.assert_allclose(found[:, 1], law[:, 1], rtol=1e-3 if answer == "yes" else 0.03)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not JSON"),
        ("[]", "holds no JSON object"),
        (
            '{"schema": "ident.diagnosis/1", "joints": ["a"], "findings": [], "verdict": "no_gap"}',
            "nothing was identified",
        ),
        ('{"schema": "ident.diagnosis/1", "joints": ["a"], "findings": [{}]}', "it is damaged"),
        (
            '{"schema": "ident.diagnosis/1", "joints": ["a"],'
            ' "findings": [{"effect": "stribeck_friction", "joints": ["a"], "parameters": {}}]}',
            "it is damaged",
        ),
    ],
)
def test_what_is_no_diagnosis_is_refused(tmp_path: Path, content: str, said: str) -> None:
    """One line says what is wrong with the file."""
    path = tmp_path / "diagnosis.json"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        Diagnosed.load(path)


def test_another_robot_and_another_folder_are_refused(tmp_path: Path, arm: ArmModel) -> None:
    """A patch is for the robot that was diagnosed, and replaces nothing but a patch."""
    diagnosed = Diagnosed.load(write_diagnosis(tmp_path / "diagnosis.json", arm, "payload"))
    with pytest.raises(InputError, match="its joint 'joint_1' is none of panda"):
        write_patch(diagnosed, ArmModel.load("panda"), tmp_path / "patch")
    with pytest.raises(InputError, match=r"holds 'diagnosis\.json', which armgap did not write"):
        write_patch(diagnosed, arm, tmp_path)


@pytest.mark.parametrize("robot", ["panda", "ur10", "z1"])
def test_other_robots_are_patched_too(tmp_path: Path, robot: str) -> None:
    """Arms with fingers, meshes and fixed links: both files load and agree with the laws."""
    found = make_patch(tmp_path, ArmModel.load(robot), "payload", "encoder_offset")["structure"]
    assert found["urdf"]["torque_difference_Nm"] < 0.01
    assert found["mjcf"]["torque_difference_Nm"] < 0.01


def test_a_bent_spring_is_written_as_its_cubic() -> None:
    """MuJoCo's passive force of the written coefficients is minus the cubic's torque."""
    figures = {"centre_rad": 0.2, "constant_Nm": 1.5, "linear_Nm_rad": 2.0, "square_Nm_rad2": 0.7, "cube_Nm_rad3": 0.4}
    (rest,), stiffness = spring_at_rest(figures)
    joint = f'<joint name="a" springref="{rest!r}" stiffness="{" ".join(map(repr, stiffness))}"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><worldbody><body>{joint}<geom size="0.1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    for q in (-1.2, -0.3, 0.4, 1.1):
        x = q - 0.2
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_passive[0], -(1.5 + 2.0 * x + 0.7 * x**2 + 0.4 * x**3), atol=1e-9)


def test_tuned_links_become_bodies_of_the_same_torque(arm: ArmModel) -> None:
    """Base parameters leave the links open: among links of one torque those that are bodies are taken."""
    rng = np.random.default_rng(1)
    base, scale = base_parameters(arm), parameter_scale(arm)
    real = [0.3 * link[0] * point_mass(rng.uniform(-0.2, 0.2, 3)) for link in arm.inertial_parameters.reshape(6, 10)]
    wanted = lift_base(base, scale) @ (base.mapping @ np.concatenate(real))
    nominal = arm.inertial_parameters.reshape(6, 10)
    assert not all(is_consistent(link) for link in nominal + wanted.reshape(6, 10))
    change, missed = nearest_bodies(arm, wanted.reshape(6, 10))
    assert all(is_consistent(link) for link in nominal + change)
    states = random_states(rng, 50, 6)
    torque = arm.regressor(*states) @ np.stack([wanted, change.ravel()], axis=1)
    left = np.sqrt(np.mean((torque[..., 0] - torque[..., 1]) ** 2) / np.mean(torque[..., 0] ** 2))
    assert left < 0.01
    assert missed < 0.01


@pytest.mark.parametrize("robot", ["tiago_pro:arm_left_7_joint", "baxter:left_w2"])
def test_a_file_of_a_robot_with_several_arms_is_of_the_one_that_was_named(robot: str, tmp_path: Path) -> None:
    """Law: written, loaded back and written into the robot's own file, it is that arm, its losses changed."""
    arm = ArmModel.load(robot)
    losses = Losses(*(np.full(arm.n, value) for value in (0.0, 2.0, 3.0, 0.02, 0.0)))
    identified = IdentifiedArm.with_losses(arm, losses)
    written = WrittenFile.write("urdf", tmp_path, identified)
    loading = written.check()
    assert loading["loads"]
    assert loading["torque_difference_Nm"] < 1e-9
    loaded = written.load()
    assert loaded.arm.joint_names == arm.joint_names
    assert arm.source is not None
    own = tmp_path / "own.urdf"
    own.write_bytes(arm.source.read_bytes())
    text, into = write_into(own, own.read_bytes(), identified)
    require_loadable(own, text, into)
    assert not any("links" in left for left in into.left)
    again = ArmModel.from_whole_urdf(text.decode(), own, arm.tip)
    np.testing.assert_allclose(again.model.damping, 2.0)
    np.testing.assert_allclose(again.model.friction, 3.0)
