"""Via points of an initial trajectory: how many, where, and when each is passed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from plan.initial.trees import Seed
from plan.problem.problem import PlanningProblem

# More via points than this are thinned out: every further one adds n variables.
MOST_VIAS = 5
# Shortest section, as a share of the longest.
SHORTEST = 0.2
# Ways whose via points are nearer to each other than this are the same [rad].
SAME = 0.02


def straight(
    start: Float[Array, " n"], goal: Float[Array, " n"], count: int
) -> Float[Array, "V n"]:
    """So many via points that part the straight line into equal pieces.

    It is the paper's initial condition.
    """
    share = np.arange(1, count + 1)[:, None] / (count + 1)
    return start + share * (goal - start)


def time_stamps(
    points: Float[Array, "K n"], speed: Float[Array, " n"], total: float
) -> Float[Array, " S"]:
    """Section durations [s].

    They are in proportion to the time that the slowest joint needs at its top speed.

    Args:
        points: Start, via points and goal [rad].
        speed: Each joint's limit [rad/s].
        total: Sum of the durations [s].

    Returns:
        One a section, S = K - 1.
    """
    distances = np.abs(np.diff(points, axis=0))
    need = np.max(distances / speed, axis=1)
    shortest = max(SHORTEST * need.max(), 1e-6)
    need = np.maximum(need, shortest)
    return total * need / need.sum()


def through(problem: PlanningProblem, vias: Float[Array, "V n"], label: str) -> PlanningProblem:
    """The problem from other via points, the whole duration kept."""
    total = float(problem.durations.sum())
    points = problem.with_ends(vias)
    durations = time_stamps(points, problem.limits.speed, total)
    return replace(problem, vias=vias, durations=durations, label=label)


def from_vias(
    problem: PlanningProblem, vias: Float[Array, "V n"], label: str, least: int
) -> PlanningProblem:
    """The problem from other via points, which are made so many that they suit a search.

    Where they are fewer than `least`, the longest sections are parted; where they are too many,
    those go that the path misses least.
    """
    vias = np.asarray(vias, dtype=float).reshape(-1, problem.n)
    points = problem.with_ends(vias)
    while len(points) < least + 2:
        points = _with_longest_parted(points)
    while len(points) > MOST_VIAS + 2:
        points = _without_straightest(points)
    return through(problem, points[1:-1], label)


def _with_longest_parted(points: Float[Array, "K n"]) -> Float[Array, "K+1 n"]:
    """A point more, in the middle of the longest section."""
    lengths = np.abs(np.diff(points, axis=0)).max(axis=1)
    longest = int(np.argmax(lengths))
    middle = (points[longest] + points[longest + 1]) / 2
    return np.insert(points, longest + 1, middle, axis=0)


def _without_straightest(points: Float[Array, "K n"]) -> Float[Array, "K-1 n"]:
    """Without the via point that lies nearest to the middle of its neighbours."""
    middles = (points[:-2] + points[2:]) / 2
    detour = np.abs(points[1:-1] - middles).max(axis=1)
    straightest = int(np.argmin(detour)) + 1
    return np.delete(points, straightest, axis=0)


def from_seeds(problem: PlanningProblem, seeds: Sequence[Seed]) -> list[PlanningProblem]:
    """The problem from the straight line, then from each seed that has a way.

    Args:
        problem: Started from the straight line.
        seeds: Those with a reason against them, or without via points, are passed over.

    Returns:
        At least `problem` itself; ways that are the same are kept once.
    """
    problems = [problem]
    known = [problem.vias]
    for seed in seeds:
        if seed.reason or len(seed.vias) == 0:
            continue
        if any(_is_same(vias, seed.vias) for vias in known):
            continue
        known.append(seed.vias)
        problems.append(from_vias(problem, seed.vias, seed.label, problem.via_count))
    return problems


def _is_same(vias: Float[Array, "V n"], others: Float[Array, "W n"]) -> bool:
    """Whether two ways have as many via points, at the same places."""
    return vias.shape == others.shape and bool(np.abs(vias - others).max() < SAME)
