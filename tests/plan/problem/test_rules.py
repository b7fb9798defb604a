"""What a way has to keep: slopes are those of the values, plans keep it before the second checker, slips get a line."""

import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomli_w

from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf
from plan.api.planning import solve
from plan.planners.sequential import Sequential
from plan.problem.rule_values import Rules
from plan.problem.rules import Cone, ViaPoint, WayRules
from tests.plan.checker import World, rule_faults

SCENES = Path(__file__).parents[3] / "examples" / "scenes"
QUICK = Sequential(starts=3, kept=(1,), levels=1)
TIPS = {"tm5-900": "flange", "ur10": "tool0", "panda": "panda_hand_tcp"}
DOWN = np.array([0.0, 0.0, -1.0])


def rules(name: str, way: WayRules, seed: int = 3) -> tuple[Rules, np.ndarray, np.ndarray]:
    """Rules of an arm between two drawn positions, and states that are not far from the straight line."""
    arm, rng = ArmModel.load(name), np.random.default_rng(seed)
    start, goal = rng.uniform(-1.0, 1.0, (2, arm.n))
    made = Rules(arm, way, start, goal)
    shares = rng.uniform(0.1, 0.9, (6, 1))
    q = start + shares * (goal - start) + 0.002 * rng.normal(size=(6, arm.n))
    return made, q, rng.normal(size=(6, arm.n))


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_slopes_are_those_of_the_values(name: str) -> None:
    """Along random changes of position and speed every row changes as its derivatives say."""
    cones = (Cone(np.array([0.6, 0.0, 0.8]), DOWN, 0.4, True), Cone(np.array([0.0, 0.0, 1.0]), DOWN, 0.3, False))
    made, q, dq = rules(name, WayRules(speed=0.3, straight=0.01, cones=cones))
    rng, step = np.random.default_rng(9), 1e-6
    for _ in range(3):
        a, b = rng.normal(size=q.shape), rng.normal(size=q.shape)
        ahead, behind = (made.rows(q + sign * step * a, dq + sign * step * b) for sign in (1.0, -1.0))
        for row, after, before in zip(made.rows(q, dq), ahead, behind, strict=True):
            seen = (row.by_position * a).sum(axis=1)
            seen += 0.0 if row.by_speed is None else (row.by_speed * b).sum(axis=1)
            if row.name == "turn":  # right where it is kept only: the tool's own turn is taken as small
                continue
            assert (after.value - before.value) / (2.0 * step) == pytest.approx(seen, rel=1e-6, abs=1e-6)


def test_the_tool_is_where_pinocchio_has_it() -> None:
    """Place and axes of the frame, its speed, and the order in which via points are passed."""
    vias = (ViaPoint(np.zeros(6), False, 0.1), ViaPoint(np.zeros(3), True, 0.1))
    made, q, _ = rules("ur10", WayRules(vias=vias))
    arm = ArmModel.load("ur10")
    place, turn, linear, angular = made.tool(q)
    for k, row in enumerate(q):
        frame, data = arm.model.getFrameId("tool0"), arm.model.createData()
        jacobian = pin.computeFrameJacobian(arm.model, data, row, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        pin.updateFramePlacement(arm.model, data, frame)
        assert place[k] == pytest.approx(data.oMf[frame].translation, abs=1e-9)
        assert turn[k] == pytest.approx(data.oMf[frame].rotation, abs=1e-9)
        assert np.concatenate([linear[k].T, angular[k].T]) == pytest.approx(jacobian, abs=1e-9)
    first, second = made.when_passed(q)
    assert first <= second


@pytest.mark.parametrize("name", ["through_2", "through_4", "straight_4", "goals_1", "cone_5", "straight_1"])
def test_plans_keep_what_their_scene_asks_for(name: str) -> None:
    """A quick search of each kind: solved, and the second checker, which shares no code, finds nothing broken."""
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    plan = solve(SCENES / f"{name}.toml", planner=QUICK, gap=False).to_dict()
    assert plan["status"] == "solved", plan["reason"]
    assert all(one["kept"] for one in plan["rules"])
    world = World(find_urdf(scene["robot"]), [], {}) if scene["robot"] == "tm5-900" else bare_world(scene["robot"])
    assert rule_faults(plan, scene, world, TIPS[scene["robot"]]) == []
    # What the scene asks for beyond that is seen by the checker, too.
    stricter = {**scene, "tool": {**scene.get("tool", {}), "speed_m_s": 1e-3}}
    assert rule_faults(plan, stricter, world, TIPS[scene["robot"]]) != []


def bare_world(robot: str) -> World:
    """The checker's arm without its shapes."""
    world = World.__new__(World)
    world.model = pin.buildModelFromUrdf(str(find_urdf(robot)))
    world.data = world.model.createData()
    return world


def test_a_tool_too_slow_for_its_time_is_refused_with_the_time_it_takes(tmp_path: Path) -> None:
    """0.9 m at 5 cm/s take longer than the task's 3 s: no search, and the least duration is named."""
    scene = tomllib.loads((SCENES / "straight_1.toml").read_text())
    scene["tool"]["speed_m_s"] = 0.05
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(scene))
    found = solve(tmp_path / "scene.toml", planner=QUICK, gap=False)
    assert found.status == "infeasible"
    assert "the tool takes 18" in found.reason
