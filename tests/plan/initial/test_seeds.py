"""Seeds: the midplane's points, trees, pruning, and what is said of those that fail."""

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from plan.api.planning import open_task
from plan.initial import starts
from plan.initial.starts import any_way, follow_closely, iterate_ways
from plan.initial.trees import STEP, Trees, find_seeds, midplane_targets, tip_solver
from plan.initial.vias import MOST_VIAS, from_seeds, from_vias, straight
from plan.problem.problem import PlanningProblem
from plan.problem.rules import Pose
from tests.plan.worlds import GOAL, MONITOR, START, problem


@pytest.fixture(scope="module")
def task() -> PlanningProblem:
    return problem(MONITOR, duration=1.0)


def test_no_obstacle_no_detour() -> None:
    """Without obstacles the only point is the middle."""
    assert [name for name, _ in midplane_targets(np.zeros(3), np.ones(3), [], 0.1)] == ["midpoint"]


def trees(task: PlanningProblem, seed: int = 0) -> Trees:
    return replace(Trees.of(task, np.random.default_rng(seed)), margins=0.005)


def test_blocked_search_says_so(task: PlanningProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start in collision, or too few nodes, are reasons, not errors; positions drawn are counted, not only nodes."""
    inside = np.radians([65.0, 15.0, -105.0])
    assert "collision" in trees(task).connect(inside, GOAL, 4000, 1.0)
    assert trees(task).connect(START, GOAL, 4, 1.0) == "no way found with 4 nodes"
    monkeypatch.setattr(Trees, "edge_is_free", lambda *_: False)
    assert "50 nodes" in trees(task).connect(START, GOAL, 50, 1.0)


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_a_way_is_followed_closely(objective: str) -> None:
    """The trajectory stays by a way with many corners, which few via points could not; time is taken as needed."""
    free = problem(duration=0.1, objective=objective, free="vias" if objective == "energy" else "both")
    turns = np.where(np.arange(8)[:, None] % 2, 0.12, -0.12) * [1.0, -1.0, 0.5]
    way = straight(START, GOAL, 8) + turns
    points = np.concatenate([[START], way, [GOAL]])

    def farthest(carrier: PlanningProblem) -> float:
        times = np.linspace(0.0, carrier.durations.sum(), 400)
        q = carrier.decode(carrier.initial).at(times)[0]
        share = np.linspace(0.0, 1.0, 200)[:, None, None]
        edges = points[:-1] + share * (points[1:] - points[:-1])
        return float(np.linalg.norm(q[:, None] - edges.reshape(-1, 3), axis=2).min(axis=1).max())

    close = follow_closely(free, way)
    assert farthest(close) < 0.04 < 0.1 < farthest(from_vias(free, way, "thinned", 2))
    if objective == "time":
        assert close.initial_evaluation.violation[0] == pytest.approx(0.0, abs=1e-9)


def test_the_way_comes_again_only_while_no_plan_is_known(task: PlanningProblem) -> None:
    """Behind the first way its close follower stands, unless the search has come through already."""
    for solved in (False, True):
        ways = iterate_ways(task, np.random.default_rng(0), lambda solved=solved: solved)  # type: ignore[misc]
        labels = [next(ways).label for _ in range(2)]
        assert labels == ["trees", "straight" if solved else "trees, closely"]


def test_seeds_go_round_or_say_why(task: PlanningProblem) -> None:
    """Nine seeds; some go round the box and start free searches, each failure has its reason."""
    seeds = find_seeds(task, np.random.default_rng(0))
    assert len(seeds) == 9
    assert sum(not seed.reason for seed in seeds) >= 4
    assert all(seed.reason for seed in seeds if len(seed.vias) == 0 and seed.label != "midpoint")
    starts = from_seeds(task, seeds)
    assert starts[0].label == "straight"
    clear = [start for start in starts if start.initial_evaluation.collision[0] == 0]
    assert len(clear) >= 3
    assert all(2 <= start.via_count <= MOST_VIAS for start in starts)


DATA = Path(__file__).parents[1] / "data"


def blocked() -> PlanningProblem:
    return open_task(DATA / "obstacle.toml").problem


def far_way(task: PlanningProblem, seconds: float) -> np.ndarray:
    """A via point from which the first joint needs so many seconds there and back, at its top speed."""
    via = 0.5 * (task.start + task.goal)
    via[0] = task.start[0] + 0.5 * (seconds * task.limits.speed[0] + task.goal[0] - task.start[0])
    return via[None]


class Drawn:
    """Trees whose ways are known."""

    def __init__(self, *ways: np.ndarray) -> None:
        self.ways, self.asked = iter(ways), list[tuple[int, float]]()

    def vias(self, _: object, __: object, nodes: int, reach: float) -> np.ndarray | None:
        self.asked.append((nodes, reach))
        return next(self.ways, None)


@pytest.mark.parametrize(("objective", "taken"), [("energy", 1), ("time", 0)])
def test_a_way_must_fit_into_the_duration(objective: str, taken: int) -> None:
    """At a fixed duration a longer way is passed over; where time is what is sought, the first way is as good."""
    task = replace(blocked(), objective=objective, free="vias" if objective == "energy" else "both")
    ways = [far_way(task, factor * float(task.durations.sum())) for factor in (1.5, 0.9, 0.5)]
    assert any_way(task, Drawn(*ways)) is ways[taken]  # type: ignore[arg-type]


def test_the_quickest_of_late_ways_and_patience_only_without_any() -> None:
    """All ways take too long: the quickest one, and no more trees; no way at all: the patient trees are asked."""
    task = blocked()
    late = [far_way(task, factor * float(task.durations.sum())) for factor in (3.0, 1.5, 2.0, 4.0)]
    some, none = Drawn(*late), Drawn()
    assert any_way(task, some) is late[1]  # type: ignore[arg-type]
    assert some.asked == list(starts.QUICK)
    assert any_way(task, none) is None  # type: ignore[arg-type]
    assert none.asked == [*starts.QUICK, starts.PATIENT]


def test_a_plan_without_a_net_loads_no_heavy_library() -> None:
    """The rigid arm's plan by the default method: neither torch nor cma, which take seconds."""
    code = (
        "import sys; from plan import solve; "
        f"result = solve({str(DATA / 'table3.toml')!r}, evaluations=30, gap=False, beyond=True); "
        "assert result.splines is not None; "
        "print([name for name in ('torch', 'cma', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")


def test_trees_connect_clear_of_the_box(task: PlanningProblem) -> None:
    """The path joins start and goal, every edge keeps the margin at twice the resolution; pruned it is shorter, too."""
    grown = trees(task)
    path = grown.connect(START, GOAL, 4000, 0.7)
    assert not isinstance(path, str)
    assert path[[0, -1]] == pytest.approx(np.array([START, GOAL]))
    loose = replace(grown, margins=0.0)
    assert all(loose.edge_is_free(a, b, 0.02) for a, b in pairwise(path))
    assert np.abs(np.diff(path, axis=0)).max() <= STEP + 1e-9
    short = grown.prune(path)
    lengths = [np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in (short, path)]
    assert lengths[0] <= lengths[1] + 1e-9
    assert len(short) < len(path)
    assert not any(grown.edge_is_free(a, b) for a, b in zip(short, short[2:], strict=False))


def test_tip_reaches_its_targets(task: PlanningProblem) -> None:
    """Inverse kinematics puts the tip within a millimetre, or says that it can't."""
    tip = tip_solver(task.scene.arm)
    rng = np.random.default_rng(0)
    for _ in range(10):
        known = START + rng.uniform(-0.5, 0.5, 3)
        q, _ = tip.descend(Pose(None, tip.place(known)), START)
        assert np.linalg.norm(tip.place(q) - tip.place(known)) < 1e-3
    assert tip.descend(Pose(None, np.array([3.0, 0.0, 0.0])), START)[1][0] > 1.0
