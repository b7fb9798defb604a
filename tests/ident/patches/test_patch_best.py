"""The file that measures best is the one that is written."""

from pathlib import Path

import pytest

from ident.patches.best import best_of, tell_choice, write_best
from ident.patches.verify import WrittenPatch
from ident.robot.arm import ArmModel


def gaps(**means: float) -> dict[str, dict[str, dict[str, float]]]:
    """Torque gaps of two joints, of very different size."""
    return {when: {"torque_rms_Nm": {"a": 10.0 * mean, "b": 0.1 * mean}} for when, mean in means.items()}


@pytest.mark.parametrize(
    ("measured", "best"),
    [
        ({"before": 1.0, "tuned": 0.8, "after": 0.5, "after_with_module": 0.5}, "after"),
        ({"before": 1.0, "tuned": 0.8, "after": 0.5, "after_with_module": 0.4}, "after_with_module"),
        ({"before": 1.0, "tuned": 0.44, "after": 1.09, "after_with_module": 1.0}, "tuned"),
        ({"before": 0.3, "tuned": 0.8, "after": 0.5, "after_with_module": 0.4}, "before"),
        ({"before": 1.0, "tuned": 0.499, "after": 0.5, "after_with_module": 0.5}, "after"),
    ],
)
def test_the_nearest_is_best(measured: dict[str, float], best: str) -> None:
    """A patch that is worse than tuning alone loses to it; a hundredth better is chance."""
    assert best_of(gaps(**measured)) == best


def test_the_best_file_is_written_and_told(tmp_path: Path) -> None:
    """Where tuning alone is nearer, the folder holds the tuned file, and the user is told."""
    arm = ArmModel.load("tm5-900")
    files = {}
    for when in ("before", "tuned", "out"):
        (tmp_path / when).mkdir()
        for name in ("robot.urdf", "robot.xml"):
            (tmp_path / when / name).write_text(when)
        files[when] = WrittenPatch(tmp_path / when, arm, (), {})
    measured = {
        "urdf": gaps(before=1.0, tuned=0.4, after=1.1, after_with_module=1.0),
        "mjcf": gaps(before=1.0, tuned=0.8, after=0.5, after_with_module=0.3),
    }
    written = write_best(measured, files, tmp_path / "out")
    assert written == {"urdf": "tuned", "mjcf": "after"}
    assert (tmp_path / "out" / "robot.urdf").read_text() == "tuned"
    assert (tmp_path / "out" / "robot.xml").read_text() == "out"
    told = tell_choice(written, {form: best_of(one) for form, one in measured.items()})
    assert any("robot.urdf" in line and "measured better than the patch" in line for line in told)
    assert any("robot.xml" in line and "missing_torque" in line for line in told)


def test_meshes_are_kept_as_hulls() -> None:
    """The MJCF of an arm of meshes loads, and has a geom a mesh, where the mesh is."""
    import mujoco
    import numpy as np

    from ident.patches.mjcf import write_mjcf
    from ident.patches.standalone.motion import Losses

    arm = ArmModel.load("ur10")
    zero = np.zeros(arm.n)
    model = mujoco.MjModel.from_xml_string(write_mjcf(arm, Losses(zero, zero, zero, np.full(arm.n, 0.01), zero), ()))
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
