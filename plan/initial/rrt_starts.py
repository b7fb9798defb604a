"""Initial trajectories: ways round the obstacles, found as in section 3.1 of the paper.

The midplane stands on the middle of the line between the start and the goal of the arm's tip. The obstacles'
corners are projected onto it; round their hull, widened by the arm's girth, eight points 45° apart and the middle of
the line are the places through which the tip may go. Trees lead from the start to each of them and on to the goal.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from plan.geometry.solids import Box
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.trees import Trees
from plan.problem.problem import PlanningProblem
from plan.problem.rules import Pose

DIRECTIONS = 8
# Initial positions from which the arm is brought to a point, and how near to it is there [m].
TRIES, THERE = 12, 1e-3
# A point where the arm collides is moved outwards by so many girths in all before it is given up.
INFLATIONS = (1.0, 2.0, 3.0)
# Trees look near their ends first, then half a turn around them: reach beyond the ends [rad] and nodes.
RANGES = ((0.7, 600), (np.pi, 4000))


@dataclass(frozen=True, eq=False)
class Seed:
    """One initial trajectory, or why there is none."""

    label: str  # which of the nine points it goes through
    target: Float[Array, " 3"]  # that point in the base frame [m]
    # Via points between start and goal [rad]; empty if it failed.
    vias: Float[Array, "V n"] = field(default_factory=lambda: np.empty((0, 0)))
    reason: str = ""  # why it failed; empty if it did not


def midplane_targets(
    start: Float[Array, " 3"], goal: Float[Array, " 3"], obstacles: Sequence[Box], inflation: float
) -> list[tuple[str, Float[Array, " 3"]]]:
    """The middle of the line, and eight points round the obstacles' hull on the midplane.

    Args:
        start, goal: Ends of the tip's way [m].
        obstacles: Boxes.
        inflation: How far outside the hull the points lie [m].

    Returns:
        Names and points in the base frame.
    """
    middle, along = (start + goal) / 2, goal - start
    length = np.linalg.norm(along)
    found = [("midpoint", middle)]
    if not obstacles:
        return found
    axes = _plane_axes(along / length if length > 1e-9 else np.array([1.0, 0.0, 0.0]))
    flat = (np.concatenate([box.corners for box in obstacles]) - middle) @ axes.T
    try:
        hull = ConvexHull(flat)
    except QhullError:  # they have no area, seen from there
        hull = ConvexHull(flat, qhull_options="QJ")
    centre = flat[hull.vertices].mean(axis=0)
    room = -(hull.equations[:, :2] @ centre + hull.equations[:, 2])
    for i in range(DIRECTIONS):
        angle = 2 * np.pi * i / DIRECTIONS
        ray = np.array([np.cos(angle), np.sin(angle)])
        outward = hull.equations[:, :2] @ ray
        exit_ = float((room / np.where(outward > 1e-12, outward, np.nan))[outward > 1e-12].min())
        found.append((f"{round(np.degrees(angle))} deg", middle + (centre + (exit_ + inflation) * ray) @ axes))
    return found


def _plane_axes(normal: Float[Array, " 3"]) -> Float[Array, "2 3"]:
    """Two unit vectors of the plane: the first level where that is possible, the second upwards."""
    first = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(first) < 1e-6:
        first = np.array([1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def find_seeds(problem: PlanningProblem, rng: np.random.Generator, seconds: float = np.inf) -> list[Seed]:
    """Looks for the nine ways, for so much processor time at most [s]; those that fail say why."""
    end = time.process_time() + seconds
    return list(iterate_seeds(problem, Trees.of(problem, rng), late=lambda: time.process_time() > end))


def iterate_seeds(
    problem: PlanningProblem, trees: Trees, most: int = RANGES[-1][1], late: Callable[[], bool] = lambda: False
) -> Iterator[Seed]:
    """The nine ways one by one, each looked for when it is asked for.

    Args:
        problem: Task; its scene's obstacles shape the midplane.
        trees: Look for ways.
        most: Most nodes of trees.
        late: Whether no time is left to look for another one.
    """
    arm, scene = problem.scene.arm, problem.scene
    tip = tip_solver(arm)
    # Half the thickness of the arm's thickest moving box: how far the tip's way must stay outside.
    girth = max((np.sort(box.half)[1] for box in scene.boxes if box.joint > 0 and box.body >= 0), default=0.0)
    ends = tip.place(problem.start), tip.place(problem.goal)
    for rays in zip(*(midplane_targets(*ends, scene.in_the_way, share * girth) for share in INFLATIONS), strict=True):
        seed = Seed(rays[0][0], rays[0][1], reason="no time was left to look for it")
        for label, target in () if late() else rays:
            found = _look(problem, tip, target, trees, most)
            seed = Seed(label, target, reason=found) if isinstance(found, str) else Seed(label, target, found)
            if not seed.reason or label == "midpoint":
                break
        yield seed


def _look(
    problem: PlanningProblem, tip: PoseSolver, target: Array, trees: Trees, most: int
) -> Float[Array, "V n"] | str:
    """Via points of a way on which the tip passes a point; or why there is none."""
    reached = _reach(problem, tip, target, trees)
    if isinstance(reached, str):
        return reached
    halves: list[Array] = []
    for a, b, name in ((problem.start, reached, "from the start"), (reached, problem.goal, "to the goal")):
        for reach, nodes in RANGES:  # ways near the ends are shorter
            path = trees.connect(a, b, min(nodes, most), reach)
            if not isinstance(path, str):
                break
        if isinstance(path, str):
            return f"{name}: {path}"
        halves.append(path)
    return trees.prune(np.concatenate([halves[0], halves[1][1:]]))[1:-1]


def _reach(problem: PlanningProblem, tip: PoseSolver, target: Array, trees: Trees) -> Float[Array, " n"] | str:
    """A free position with the tip at the target, the nearest to the middle of the task; or why there is none."""
    middle, limits = (problem.start + problem.goal) / 2, problem.limits
    found, blocked, outside = [], 0, 0
    for attempt in range(TRIES):
        guess = middle + (trees.rng.normal(size=problem.n) * 0.15 * attempt if attempt else 0.0)
        q, missed = tip.descend(Pose(None, target), np.clip(guess, limits.lower, limits.upper))
        if missed[0] > THERE:
            continue
        if np.any(q < limits.lower) or np.any(q > limits.upper):
            outside += 1
        elif not trees.is_free(q[None]):
            blocked += 1
        else:
            found.append(q)
    if found:
        return min(found, key=lambda q: float(np.abs(q - middle).max()))
    if blocked:
        return "the arm collides when its tip is there"
    return "joint limits keep the tip from it" if outside else "out of the arm's reach"


def tip_solver(arm: ArmModel) -> PoseSolver:
    """Of the arm's tip: the last frame that the last joint moves."""
    return PoseSolver(arm, [frame.name for frame in arm.model.frames if frame.parentJoint == arm.n][-1])
