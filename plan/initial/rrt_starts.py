"""Initial trajectories: ways round the obstacles, found as in section 3.1 of the paper.

The midplane stands on the middle of the line between the start and the goal of the arm's tip. The obstacles'
corners are projected onto it; round their hull, widened by the arm's girth, eight points 45° apart and the middle of
the line are the places through which the tip may go. Trees lead from the start to each of them and on to the goal.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from plan.geometry.boxes import Box
from plan.geometry.scene import Scene
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.rrt import Path, TreeOptions, connect, is_free, prune
from plan.problem.pose import Pose
from plan.problem.problem import PlanningProblem

DIRECTIONS = 8
# Initial positions from which the arm is brought to a point, and how near to it is there [m].
TRIES, THERE = 12, 1e-3
# A point where the arm collides is moved outwards by so many girths in all before it is given up.
INFLATIONS = (1.0, 2.0, 3.0)
# Trees look near their ends first, then half a turn around them: reach beyond the ends [rad] and nodes.
RANGES = ((0.7, 600), (np.pi, 4000))


@dataclass(frozen=True, eq=False)
class Seed:
    """One initial trajectory, or why there is none.

    Attributes:
        label: Which of the nine points it goes through.
        target: That point in the base frame [m].
        vias: Via points between start and goal [rad]; empty if it failed.
        reason: Why it failed; empty if it did not.
    """

    label: str
    target: Float[Array, " 3"]
    vias: Float[Array, "V n"] = field(default_factory=lambda: np.empty((0, 0)))
    reason: str = ""


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
    normal = along / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    found = [("midpoint", middle)]
    if not obstacles:
        return found
    axes = _plane_axes(normal)
    corners = np.concatenate([box.corners for box in obstacles])
    flat = (corners - middle) @ axes.T
    hull = _hull(flat)
    centre = hull.mean(axis=0)
    for i in range(DIRECTIONS):
        angle = 2 * np.pi * i / DIRECTIONS
        ray = np.array([np.cos(angle), np.sin(angle)])
        place = centre + (_exit(hull, centre, ray) + inflation) * ray
        found.append((f"{round(np.degrees(angle))} deg", middle + place @ axes))
    return found


def _plane_axes(normal: Float[Array, " 3"]) -> Float[Array, "2 3"]:
    """Two unit vectors of the plane: the first level where that is possible, the second upwards."""
    up = np.array([0.0, 0.0, 1.0])
    first = np.cross(up, normal)
    if np.linalg.norm(first) < 1e-6:
        first = np.array([1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def _hull(points: Float[Array, "k 2"]) -> Float[Array, "m 2"]:
    """Corners of the convex hull, in order; the points themselves where they have no area."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points


def _exit(hull: Float[Array, "m 2"], origin: Float[Array, " 2"], ray: Float[Array, " 2"]) -> float:
    """Distance from a point inside the hull to its boundary along a ray [m]."""
    best = 0.0
    for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        edge = b - a
        matrix = np.array([ray, -edge]).T
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        distance, share = np.linalg.solve(matrix, a - origin)
        if -1e-9 <= share <= 1 + 1e-9:
            best = max(best, float(distance))
    return best


def find_seeds(
    problem: PlanningProblem,
    rng: np.random.Generator,
    options: TreeOptions | None = None,
    seconds: float = np.inf,
) -> list[Seed]:
    """Looks for the nine ways; those that fail say why.

    Args:
        problem: Task; its scene's obstacles shape the midplane.
        rng: Source of randomness.
        options: How the trees grow; the margins are the problem's unless given.
        seconds: Processor time after which no further way is looked for [s].
    """
    started = time.process_time()
    late = False
    seeds: list[Seed] = []
    ways = iterate_seeds(problem, rng, options)
    for label, target in midplane_of(problem)[0]:
        late = late or time.process_time() - started > seconds
        seeds.append(Seed(label, target, reason="no time was left to look for it") if late else next(ways))
    return seeds


def midplane_of(problem: PlanningProblem) -> list[list[tuple[str, Float[Array, " 3"]]]]:
    """The nine points of a task, at one, two and three girths from the obstacles' hull."""
    tip, width = tip_solver(problem.scene.arm), girth(problem.scene)
    ends = tip.place(problem.start), tip.place(problem.goal)
    return [midplane_targets(*ends, problem.scene.in_the_way, share * width) for share in INFLATIONS]


def iterate_seeds(
    problem: PlanningProblem, rng: np.random.Generator, options: TreeOptions | None = None
) -> Iterator[Seed]:
    """The nine ways one by one, each looked for when it is asked for."""
    options, tip = options or TreeOptions(margins=problem.margins), tip_solver(problem.scene.arm)
    for rays in zip(*midplane_of(problem), strict=True):
        for label, target in rays:
            seed = _find_seed(problem, tip, label, target, rng, options)
            if not seed.reason or label == "midpoint":
                break
        yield seed


def girth(scene: Scene) -> float:
    """Half the thickness of the arm's thickest moving box: how far the tip's way must stay outside [m]."""
    return float(max((np.sort(box.half)[1] for box in scene.boxes if box.joint > 0 and box.body >= 0), default=0.0))


def _find_seed(
    problem: PlanningProblem,
    tip: PoseSolver,
    label: str,
    target: Float[Array, " 3"],
    rng: np.random.Generator,
    options: TreeOptions,
) -> Seed:
    reached = _reach(problem, tip, target, rng, options)
    if isinstance(reached, str):
        return Seed(label, target, reason=reached)
    halves: list[Path] = []
    for a, b, name in ((problem.start, reached, "from the start"), (reached, problem.goal, "to the goal")):
        path = _connect(problem, a, b, options, rng)
        if not path.found:
            return Seed(label, target, reason=f"{name}: {path.reason}")
        halves.append(path)
    points = prune(problem.scene, np.concatenate([halves[0].points, halves[1].points[1:]]), options)
    return Seed(label, target, points[1:-1])


def _connect(problem: PlanningProblem, a: Array, b: Array, options: TreeOptions, rng: np.random.Generator) -> Path:
    """A way between two positions: looked for near them first, which gives shorter ones."""
    for reach, nodes in RANGES:
        low = np.maximum(problem.limits.lower, np.minimum(a, b) - reach)
        high = np.minimum(problem.limits.upper, np.maximum(a, b) + reach)
        path = connect(problem.scene, a, b, low, high, replace(options, nodes=min(nodes, options.nodes)), rng)
        if path.found:
            break
    return path


def _reach(
    problem: PlanningProblem, tip: PoseSolver, target: Array, rng: np.random.Generator, options: TreeOptions
) -> Float[Array, " n"] | str:
    """A free position with the tip at the target, the nearest to the middle of the task; or why there is none."""
    middle = (problem.start + problem.goal) / 2
    found, blocked, outside = [], 0, 0
    for attempt in range(TRIES):
        guess = middle + (rng.normal(size=problem.n) * 0.15 * attempt if attempt else 0.0)
        q, missed = tip.descend(Pose(None, target), np.clip(guess, problem.limits.lower, problem.limits.upper))
        if missed[0] > THERE:
            continue
        if np.any(q < problem.limits.lower) or np.any(q > problem.limits.upper):
            outside += 1
        elif not is_free(problem.scene, q[None], options.margins):
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
    return PoseSolver(arm, max(k for k, frame in enumerate(arm.model.frames) if frame.parentJoint == arm.n))
