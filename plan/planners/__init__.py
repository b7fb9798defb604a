"""The planners: one file each, one interface."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from plan.errors import MethodError
from plan.planners.base import Budget, Candidate, Ledger, Planner

__all__ = ["METHODS", "Budget", "Candidate", "Ledger", "Planner", "default_budget", "make_planner"]


def _planner(module: str, name: str, **options: Any) -> Planner:
    """A planner from its file, which is loaded now: the libraries of some take seconds to load."""
    found: Planner = getattr(import_module(f"plan.planners.{module}"), name)(**options)
    return found


METHODS: dict[str, Callable[[], Planner]] = {
    "sqp": partial(_planner, "sequential", "Sequential"),
    "reference": partial(_planner, "reference", "Reference"),
    "cma": partial(_planner, "evolution", "Evolution"),
    "ppo": partial(_planner, "ppo", "Ppo"),
    "ppo-paper": partial(_planner, "ppo", "Ppo", reward="paper"),
    "ga": partial(_planner, "genetic", "PaperGenetic"),
    "ga-pymoo": partial(_planner, "genetic", "StrongGenetic"),
    "brute": partial(_planner, "brute_force", "BruteForce"),
    "compress": partial(_planner, "compression", "Compression"),
    "toppra": partial(_planner, "toppra", "Toppra"),
    "ompl": partial(_planner, "ompl_toppra", "OmplToppra"),
}
# Methods that shorten time only, and peers that are there to be compared with when they are named.
TIME_ONLY, PEERS = ("compress", "toppra"), ("ompl",)


def make_planner(method: str, objective: str) -> Planner:
    """The planner of a name.

    Raises:
        MethodError: No such method, or not for this objective.
    """
    if method not in METHODS:
        raise MethodError("--method", f"{method!r} is unknown", f"use one of: {', '.join(METHODS)}")
    if method in TIME_ONLY and objective != "time":
        raise MethodError("--method", f"{method} shortens time only", "use --objective time, or another method")
    if method == "ompl" and not import_module("plan.planners.ompl_toppra").is_installed():
        raise MethodError("--method ompl", "OMPL is not installed", "pip install ompl, or use another method")
    return METHODS[method]()


def default_budget(method: str) -> Budget:
    """What a method may spend where the user says nothing."""
    return Budget(20_000_000, 3600.0) if method == "brute" else Budget(200_000, 120.0)
