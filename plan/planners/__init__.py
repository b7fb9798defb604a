"""The planners: one file each, one interface; those of the paper and its peers are loaded when they are named."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from plan.errors import MethodError
from plan.options import SolveOptions
from plan.planners.base import Budget, Candidate, Ledger, Planner

__all__ = ["METHODS", "Budget", "Candidate", "Ledger", "Planner", "budget_of", "make_planner"]


def _planner(module: str, name: str, **options: Any) -> Planner:
    """A planner from its file, which is loaded now: the libraries of some take seconds to load."""
    found: Planner = getattr(import_module(f"plan.{module}"), name)(**options)
    return found


METHODS: dict[str, Callable[[], Planner]] = {
    "sqp": partial(_planner, "planners.sequential", "Sequential"),
    "reference": partial(_planner, "planners.reference", "Reference"),
    "cma": partial(_planner, "planners.evolution", "Evolution"),
    "ppo": partial(_planner, "paper.ppo", "Ppo"),
    "ga": partial(_planner, "paper.genetic", "Genetic"),
    "brute": partial(_planner, "paper.brute_force", "BruteForce"),
    "compress": partial(_planner, "paper.compression", "Compression"),
    "toppra": partial(_planner, "paper.toppra", "Toppra"),
}
# Methods that shorten time only.
TIME_ONLY = ("compress", "toppra")


def make_planner(method: str, objective: str) -> Planner:
    """The planner of a name.

    Raises:
        MethodError: No such method, or not for this objective.
    """
    if method not in METHODS:
        raise MethodError("--method", f"{method!r} is unknown", f"use one of: {', '.join(METHODS)}")
    if method in TIME_ONLY and objective != "time":
        raise MethodError("--method", f"{method} shortens time only", "use --objective time, or another method")
    return METHODS[method]()


def budget_of(options: SolveOptions) -> Budget:
    """What a search may spend: what is asked for, and of the rest its method's usual."""
    usual = Budget(20_000_000, 3600.0) if options.method == "brute" else Budget(200_000, 120.0)
    asked = options.evaluations, options.seconds
    return Budget(usual.evaluations if asked[0] is None else asked[0], usual.seconds if asked[1] is None else asked[1])
