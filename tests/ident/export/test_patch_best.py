"""Of all candidates the nearest file is written, joint by joint."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ident.arrays import Array
from ident.export.bodies import Links, nearest_bodies
from ident.export.choose import Gap, choose, mix
from ident.export.identified import IdentifiedArm
from ident.export.loading import WrittenFile
from ident.export.mjcf import write_mjcf
from ident.laws.motion import Losses
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions

LOSSES = Losses(np.full(6, 0.2), np.full(6, 6.0), np.full(6, 4.0), np.full(6, 0.01), np.zeros(6))
LAW = Callable[[Array, Array, Array], Array]


@pytest.fixture(autouse=True)
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six windows say enough where the law is known."""
    monkeypatch.setattr("ident.export.choose.MOST_WINDOWS", 6)


def stated(coulomb: float = 4.0, heavier: float = 0.0, joint: int | None = None) -> IdentifiedArm:
    """Links that are heavier by a share, and dry friction of one joint or of all."""
    arm = ArmModel.load("tm5-900")
    level = np.full(6, 4.0)
    level[slice(None) if joint is None else joint] = coulomb
    links = heavier * arm.inertial_parameters.reshape(6, 10)
    return IdentifiedArm(arm, replace(LOSSES, coulomb=level), Links(links, 0.0 * links, 0.0))


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
    law: LAW = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + LOSSES.torque(dq, ddq, np.tanh(dq / 0.01))  # noqa: E731
    found = choose(form, options, made_motions(arm, law, [3], duration=4.0), tmp_path / "scratch")
    np.testing.assert_array_equal(found.stated.links.total, 0.0)
    np.testing.assert_allclose(found.stated.losses.coulomb, 4.0, rtol=1e-3)
    for gap in found.gaps.values():
        assert np.all(found.gaps["after"].error("torque") <= 1.01 * gap.error("torque") + 1e-6)
    assert bool(found.in_words(form, arm.joint_names)) == (found.name != "after" or bool(found.worse))


def test_a_mixture_has_one_candidates_bodies_and_each_joints_own_losses() -> None:
    """Law: links of the one, losses of the named candidate at each joint."""
    options = {"before": stated(1.0, heavier=0.1), "after": stated(2.0)}
    found = mix(options, "before", ("before", "after", "before", "after", "after", "before"))
    np.testing.assert_array_equal(found.losses.coulomb, [1, 2, 1, 2, 2, 1])
    np.testing.assert_array_equal(found.links.total, options["before"].links.total)


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


def test_dry_friction_of_a_light_joint_is_whole_in_mujoco(tmp_path: Path) -> None:
    """Law: at speeds beyond rest every joint of the MJCF rubs with its friction, however light its link is."""
    arm = stated()
    model = WrittenFile.write("mjcf", tmp_path, replace(arm, losses=replace(LOSSES, motor_inertia=np.zeros(6)))).load()
    q, dq = np.zeros((1, 6)), np.full((1, 6), 0.03)
    rubbed = model.joint_torque(q, dq, 0 * q, 0.0) - model.joint_torque(q, -dq, 0 * q, 0.0)
    np.testing.assert_allclose(rubbed / 2.0 - LOSSES.viscous * dq, 4.0, rtol=0.03)
