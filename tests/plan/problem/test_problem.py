"""Decision vectors, limits, makers' limits and penalties."""

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ident.robot.arm import ArmModel
from plan.geometry.clearance_proof import SHORT, find_cuts, find_margins, why_refused
from plan.geometry.scene import Scene
from plan.problem.makers_limits import TABLE, find_makers_limits
from plan.problem.problem import SHARE, TIME_NODES
from plan.problem.task_file import load_surroundings, load_task
from plan.solving.set_up import set_up
from tests.plan.worlds import MONITOR, problem


def test_every_limit_is_seen() -> None:
    """A motion too fast breaks speed and torque; one past a joint's limit breaks position; one through a box hits."""
    task = problem()
    fast = replace(task, durations=np.full(3, 0.02)).initial_evaluation
    assert fast.speed[0] > 0
    assert fast.torque[0] > 0
    narrow = replace(task, limits=replace(task.limits, upper=np.radians([75.0, 180.0, 155.0])))
    assert narrow.initial_evaluation.position[0] == pytest.approx(np.radians(5.0), abs=1e-6)
    assert problem(MONITOR).initial_evaluation.collision[0] > 0
    assert task.initial_evaluation.feasible[0]
    for broken in (fast, narrow.initial_evaluation, problem(MONITOR).initial_evaluation):
        assert not broken.feasible[0]


def test_each_pair_has_its_own_margin() -> None:
    """A pair keeps what was asked for, or what it has at an end; of the arm's own pairs that is a cut with its name."""
    task = problem(MONITOR, clearance=0.1)
    have = task.scene.gaps(task.ends).min(axis=0)
    assert (have < 0.1).any()
    assert (have > 0.1).any()
    assert np.all(task.margins <= 0.1)
    assert task.margins == pytest.approx(np.minimum(have, 0.1), abs=SHORT)
    found = {cut.pair: cut for cut in find_cuts(task.scene, task.ends, 0.1)}
    exact = np.array([task.scene.distances(q) for q in task.ends])
    for pair, least in enumerate(exact.min(axis=0)):
        assert (pair in found) == (task.scene.own[pair] and least < 0.1)
        if pair in found:
            assert found[pair].kept == pytest.approx(least)
            assert found[pair].links == task.scene.names_of(pair)
            assert found[pair].end == ("start", "goal")[int(exact[1, pair] < exact[0, pair])]
    assert not find_cuts(task.scene, task.ends, 0.005)


def test_what_the_build_holds_near_does_not_bar_the_arm() -> None:
    """Links of a UR5's wrist can nowhere be 20 mm apart: half of what they can be is asked of them, and it is said."""
    arm = ArmModel.load("ur5")
    scene, ends = Scene.build(arm), np.radians([[-44.0, -57, 57, 31, 80, 29], [42.0, 29, 40, -55, 31, 96]])
    line = ends[0] + np.linspace(0.0, 1.0, 50)[:, None] * (ends[1] - ends[0])
    assert scene.separation(line, find_margins(scene, ends, 0.02)).min() > 0.0
    found = {cut.links: cut for cut in find_cuts(scene, ends, 0.02)}
    assert 0.004 < found["wrist_3_link", "wrist_1_link"].kept < 0.007
    assert found["wrist_3_link", "wrist_1_link"].end == "build"
    assert "are hardly ever 20 mm apart on this arm and keep 5.7 mm" in str(found["wrist_3_link", "wrist_1_link"])
    assert not find_cuts(scene, ends, 0.005)


def test_an_obstacle_nearer_than_asked_is_refused_by_name() -> None:
    """An end may be near its own links but not near an obstacle; asked for less, it may."""
    task = problem(MONITOR)
    distances = np.where(task.scene.own, np.inf, task.scene.distances(task.start))
    refused = why_refused(task.scene, task.start, distances.min() + 2 * SHORT)
    assert f"{task.scene.pair_name(int(np.argmin(distances)))} are " in refused[0]
    assert "task.clearance_m" in refused[1]
    assert why_refused(task.scene, task.start, distances.min()) is None


TASK = """robot = "{robot}"
[task]
start_deg = {start}
goal_deg = {goal}
duration_s = 2
{more}"""


def limits_of(folder: Path, more: str = "", robot: str = "panda", joints: int = 7):  # type: ignore[no-untyped-def]
    start, goal = ([*ends, 0, -90, 0, 90, 0][:joints] for ends in ([0, 0], [20, 10]))
    (folder / "scene.toml").write_text(TASK.format(robot=robot, start=start, goal=goal, more=more))
    return set_up(load_task(folder / "scene.toml"))


def test_a_scene_finds_a_urdf_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: its path is from the scene's folder on, wherever the command is run, with a task or without."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell/arm.urdf").write_text(Path("urdf/tm5_900.urdf").read_text())
    (tmp_path / "cell/scene.toml").write_text('robot = "arm.urdf"\n')
    (tmp_path / "cell/task.toml").write_text(TASK.format(robot="arm.urdf", start=[0.0] * 6, goal=[1.0] * 6, more=""))
    monkeypatch.chdir(tmp_path)
    assert load_task("cell/task.toml").robot == str(Path("cell/arm.urdf"))
    assert load_surroundings("cell/scene.toml", np.zeros(6, dtype=bool)).robot == str(Path("cell/arm.urdf"))


def test_every_row_says_where_it_is_from() -> None:
    """A source, and as many positive numbers as joints; a binding row has limits of acceleration."""
    for row in tomllib.loads(TABLE.read_text())["arm"]:
        assert len(row["source"]) > 20
        for key in ("speed_rad_s", "acceleration_rad_s2", "jerk_rad_s3"):
            assert key not in row or (len(row[key]) == row["joints"] and min(row[key]) > 0.0)
        assert not row["binding"] or "acceleration_rad_s2" in row


@pytest.mark.parametrize(("robot", "binding"), [("panda", True), ("xarm7", True), ("ur5", False), ("tm5-900", False)])
def test_arms_are_known_by_their_urdf(robot: str, binding: bool) -> None:
    found = find_makers_limits(ArmModel.load(robot))
    assert found.binding == binding


NAMES = [("fr3", 7, 301.4), ("lbr_iiwa_14_r820", 7, 135.0), ("iiwa7", 7, 180.0), ("GEN3_URDF_V12", 7, 66.46)]


@pytest.mark.parametrize(("name", "joints", "speed"), [*NAMES, ("gen3", 6, 66.46), ("ur3e_robot", 6, 360.0)])
def test_arms_are_known_by_the_names_of_makers(name: str, joints: int, speed: float) -> None:
    """Law: the first row that fits a name and a number of joints, its last joint's speed among them."""
    found = find_makers_limits(SimpleNamespace(name=name, source=None, n=joints))  # type: ignore[arg-type]
    assert np.degrees(found.speed)[-1] == pytest.approx(speed, rel=1e-3)


def test_makers_limits_are_kept_where_the_task_gives_none(tmp_path: Path) -> None:
    """The task's own come first; without either the result says that they are missing. A URDF may not say more."""
    kept = limits_of(tmp_path)
    assert kept.limits.acceleration == pytest.approx([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
    assert len(kept.limits.jerk) == 7
    assert limits_of(tmp_path, "", "ur10", 6).limits.speed[0] == pytest.approx(np.radians(120.0), rel=1e-4)
    assert any("libfranka" in note for note in kept.notes)
    assert any("without --model" in note for note in kept.notes)
    own = limits_of(tmp_path, "[limits]\nacceleration_deg_s2 = [90, 90, 90, 90, 90, 90, 90]\n")
    assert own.limits.acceleration == pytest.approx(np.full(7, np.pi / 2))
    without = limits_of(tmp_path, "[limits]\nmakers = false\n")
    assert without.limits.acceleration is None
    assert any("no limit of acceleration and jerk" in note for note in without.notes)


def test_feasible_is_always_better() -> None:
    """In the one number to minimise, no cheap broken motion passes for better than a dear allowed one."""
    task = problem(MONITOR, duration=1.0)
    beside = np.radians([47.0, 12.0, -95.0, 57.0, 23.0, -90.0])
    share = np.repeat(np.linspace(0.0, 1.2, 40), 10)[:, None]
    x = task.initial + share * (beside - task.initial) + np.random.default_rng(1).normal(size=(400, 6)) * 0.03
    found = task.evaluate(x)
    value = task.penalised(found)
    near = found.feasible & (found.cost < 1.5 * task.scale)
    deep = found.collision > 0.5
    assert near.any()
    assert deep.any()
    assert value[near].max() < value[deep].min()


@pytest.mark.parametrize("free", ["vias", "times", "both"])
@pytest.mark.parametrize("objective", ["energy", "time"])
def test_decoding_inverts_encoding(free: str, objective: str) -> None:
    """The initial decision vector is the initial trajectory, and lies within the bounds."""
    task = problem(objective=objective, free=free)
    splines = task.decode(task.initial)
    assert splines.points[0, 1:-1] == pytest.approx(task.vias)
    assert splines.durations[0] == pytest.approx(task.durations)
    assert np.all(task.lower <= task.initial)
    assert np.all(task.initial <= task.upper)


def test_bounds_hold() -> None:
    """Vectors beyond the bounds are clipped, so no via angle leaves its reach or the position limits."""
    task = problem(radius=0.2)
    splines = task.decode(np.full((1, 6), 99.0))
    assert np.abs(splines.points[0, 1:-1] - task.vias).max() <= 0.2 + 1e-12


def test_torque_limit_is_met_at_its_share() -> None:
    """The excess is zero up to the share of the limit, and counts from there."""
    task = problem(objective="time", free="times")
    _, _, tau = task.decode(task.initial).states(TIME_NODES)
    peak = task.initial_evaluation.peak[0].max()
    for factor, broken in ((0.99, True), (1.01, False)):
        limits = replace(task.limits, torque=np.full(3, factor * peak / SHARE))
        assert bool(replace(task, limits=limits).initial_evaluation.torque[0] > 0) == broken
    assert tau.shape[1] == 3 * len(TIME_NODES)
