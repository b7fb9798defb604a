"""Plans before a checker that shares no code with the planner: what is sound passes, what was touched is named."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.api.planning import solve
from tests.plan.checker import Model, World, faults

DATA = Path(__file__).parent / "data"
URDF = Path(__file__).parents[2] / "urdf" / "tm5_900.urdf"
LOSS = LossParameters(*(np.full(6, value) for value in (0.3, 4.0, 3.0, 0.2, 0.02)))


@pytest.fixture(scope="module")
def folder(tm5: ArmModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    heavier = tm5.with_inertial_parameters(1.1 * tm5.inertial_parameters)
    return HybridModel(tm5, tm5, heavier, LOSS, inertia="base").save(tmp_path_factory.mktemp("checked") / "model")


def limits_of(arm: ArmModel, n: int, clearance: float) -> dict[str, Any]:
    """What the first joints of the arm may do."""
    names = {"lower": arm.lower, "upper": arm.upper, "speed": arm.velocity_limit, "torque": arm.effort_limit}
    return {**{name: values[:n] for name, values in names.items()}, "clearance": clearance}


def straight_line(plan: dict[str, Any]) -> list[list[float]]:
    """Via points at three and seven tenths of the line from start to goal."""
    ends = plan["start_rad"], plan["goal_rad"]
    return [[(1 - s) * a + s * b for a, b in zip(*ends, strict=True)] for s in (0.3, 0.7)]


def test_the_checker_knows_the_arm(tm5: ArmModel, folder: Path) -> None:
    """Its torque is the model's own, at random states."""
    q, dq, ddq = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 50, 6))
    assert Model(folder).torque(q, dq, ddq) == pytest.approx(HybridModel.load(folder).torque(q, dq, ddq), abs=1e-9)


def test_sound_plans_pass_and_touched_ones_do_not(tm5: ArmModel, folder: Path) -> None:
    """A plan round a box is found sound; a moved via point, a faster motion and other joules are not."""
    scene = tomllib.loads((DATA / "obstacle.toml").read_text())
    scene["task"]["objective"] = "energy"
    plan = solve(DATA / "obstacle.toml", folder, method="cma", evaluations=1500, gap=False, beyond=True).to_dict()
    assert plan["status"] == "solved"
    limits = limits_of(tm5, 3, 0.005)
    model, world = Model(folder), World(URDF, [], scene)

    def found(**changes: Any) -> str:
        return "; ".join(faults({**json.loads(json.dumps(plan)), **changes}, scene, model, world, limits))

    assert found() == ""
    assert "and monitor" in found(via_points_rad=straight_line(plan), times_s=[0.3, 0.7])
    assert "energy is" in found(energy_J={**plan["energy_J"], "absolute": 1.01 * plan["energy_J"]["absolute"]})
    faster = found(times_s=[0.2 * t for t in plan["times_s"]], duration_s=0.2)
    assert "speed" in faster
    assert "torque" in faster
    assert "goal is another" in found(goal_rad=[0.0, 0.0, 0.0])


def test_a_folded_wrist_cuts_no_other_margin(tm5: ArmModel, folder: Path, tmp_path: Path) -> None:
    """Links 2 mm apart at the ends keep that, with a note; the post is passed at all that was asked for."""
    folded = [1.1, -144.0, -1.9, 140.5, -63.9]
    task = {"start_deg": [-40.0, *folded], "goal_deg": [40.0, *folded], "duration_s": 1.5, "clearance_m": 0.03}
    post = {"name": "post", "size_m": [0.08, 0.08, 0.3], "xyz_m": [-0.43, -0.05, 0.2]}
    scene: dict[str, Any] = {"robot": "tm5-900", "task": task, "obstacle": [post]}
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    result = solve(path, folder, evaluations=80, gap=False, beyond=True)
    plan = result.to_dict()
    assert plan["status"] == "solved"
    (cut,) = plan["clearance_cuts"]
    assert cut["links"] == ["link_6", "link_3"]
    assert 0.001 < cut["kept_m"] < 0.004
    assert cut["asked_m"] == plan["asked_clearance_m"] == 0.03
    assert any(note.startswith("link_6 and link_3 are ") for note in plan["notes"])
    assert "instead of the 30 mm asked for" in " ".join(result.summary().split())
    scene["task"]["objective"] = "energy"
    limits = limits_of(tm5, 6, 0.03)
    world = World(URDF, [], scene)
    assert faults(plan, scene, Model(folder), world, limits) == []
    assert "link_6 and post" in "; ".join(faults(plan, scene, Model(folder), world, {**limits, "clearance": 0.06}))
    task["clearance_m"] = 0.5
    path.write_text(tomli_w.dumps(scene | {"task": {k: v for k, v in task.items() if k != "objective"}}))
    with pytest.raises(InputError, match=r"task\.start_deg: link_\d and post are .* mm apart there, 500 mm are asked"):
        solve(path, folder)


def test_plans_among_what_was_scanned_are_sound(tm5: ArmModel, folder: Path, tmp_path: Path) -> None:
    """A plan round the points on a box is found sound; a straight one hits them."""
    scene = tomllib.loads((DATA / "obstacle.toml").read_text())
    (box,) = scene["obstacle"]
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (4000, 3))
    face = rng.integers(3, size=4000)
    points[np.arange(4000), face] = np.sign(points[np.arange(4000), face]) / 2
    np.save(tmp_path / "scan.npy", points * box["size_m"])
    place = {key: box[key] for key in ("xyz_m", "rpy_rad") if key in box}
    scene["obstacle"] = [{"name": "monitor", "cloud": "scan.npy", "radius_m": 0.004, **place}]
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    plan = solve(path, folder, evaluations=300, gap=False, beyond=True).to_dict()
    assert plan["status"] == "solved"
    scene["task"]["objective"] = "energy"
    limits = limits_of(tm5, 3, 0.005)
    world = World(URDF, [], scene, tmp_path)
    assert faults(plan, scene, Model(folder), world, limits) == []
    plan["via_points_rad"] = straight_line(plan)
    plan["times_s"] = [0.3 * plan["duration_s"], 0.7 * plan["duration_s"]]
    assert any("and monitor" in line for line in faults(plan, scene, Model(folder), world, limits))
