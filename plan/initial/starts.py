"""Initial trajectories as problems to search from: the straight line, seeds round obstacles, taught via points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from plan.initial.rrt_starts import Seed
from plan.problem.problem import PlanningProblem

# More via points than this are thinned out: every one adds n variables.
MOST_VIAS = 5
# Shortest section, as a share of the longest.
SHORTEST = 0.2


def straight(start: Float[Array, " n"], goal: Float[Array, " n"], count: int) -> Float[Array, "V n"]:
    """Via points that part the line into equal pieces: the paper's initial condition."""
    share = np.arange(1, count + 1)[:, None] / (count + 1)
    return start + share * (goal - start)


def time_stamps(points: Float[Array, "K n"], speed: Float[Array, " n"], total: float) -> Float[Array, " S"]:
    """Section durations in proportion to the time that the slowest joint needs at its top speed [s]."""
    need = np.max(np.abs(np.diff(points, axis=0)) / speed, axis=1)
    need = np.maximum(need, max(SHORTEST * need.max(), 1e-6))
    return total * need / need.sum()


def from_vias(problem: PlanningProblem, vias: Float[Array, "V n"], label: str, least: int) -> PlanningProblem:
    """The problem from other via points, at least so many of them, the whole duration kept."""
    vias = _thin(_refine(problem, np.asarray(vias, dtype=float).reshape(-1, problem.n), least), problem)
    points = np.concatenate([[problem.start], vias, [problem.goal]])
    durations = time_stamps(points, problem.limits.speed, float(problem.durations.sum()))
    return replace(problem, vias=vias, durations=durations, label=label)


def from_seeds(problem: PlanningProblem, seeds: Sequence[Seed]) -> list[PlanningProblem]:
    """One problem a seed that was found, the straight line in front; ways that are the same are kept once."""
    problems = [problem]
    known = [problem.vias]
    for seed in seeds:
        if seed.reason or len(seed.vias) == 0:
            continue
        if any(other.shape == seed.vias.shape and np.abs(other - seed.vias).max() < 0.02 for other in known):
            continue
        known.append(seed.vias)
        problems.append(from_vias(problem, seed.vias, seed.label, problem.via_count))
    return problems


def _refine(problem: PlanningProblem, vias: Array, least: int) -> Array:
    """Adds the middle of the longest section until there are enough via points."""
    while len(vias) < least:
        points = np.concatenate([[problem.start], vias, [problem.goal]])
        longest = int(np.argmax(np.abs(np.diff(points, axis=0)).max(axis=1)))
        vias = np.insert(vias, longest, (points[longest] + points[longest + 1]) / 2, axis=0)
    return vias


def _thin(vias: Array, problem: PlanningProblem) -> Array:
    """Takes out the via points that the path misses least until few enough are left."""
    while len(vias) > MOST_VIAS:
        points = np.concatenate([[problem.start], vias, [problem.goal]])
        detour = np.abs(points[1:-1] - (points[:-2] + points[2:]) / 2).max(axis=1)
        vias = np.delete(vias, int(np.argmin(detour)), axis=0)
    return vias
