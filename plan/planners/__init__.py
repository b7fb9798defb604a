"""The planners: one file each, one interface."""

from __future__ import annotations

from collections.abc import Callable

from plan.errors import MethodError
from plan.planners.base import Budget, Candidate, Ledger, Planner
from plan.planners.brute_force import BruteForce
from plan.planners.compression import Compression
from plan.planners.evolution import Evolution
from plan.planners.genetic import PaperGenetic, StrongGenetic
from plan.planners.ompl_toppra import OmplToppra, is_installed
from plan.planners.ppo import Ppo
from plan.planners.reference import Reference
from plan.planners.sequential import Sequential
from plan.planners.toppra import Toppra

__all__ = ["METHODS", "Budget", "Candidate", "Ledger", "Planner", "default_budget", "make_planner"]

METHODS: dict[str, Callable[[], Planner]] = {
    "sqp": Sequential,
    "reference": Reference,
    "cma": Evolution,
    "ppo": Ppo,
    "ppo-paper": lambda: Ppo(reward="paper"),
    "ga": PaperGenetic,
    "ga-pymoo": StrongGenetic,
    "brute": BruteForce,
    "compress": Compression,
    "toppra": Toppra,
    "ompl": OmplToppra,
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
    if method == "ompl" and not is_installed():
        raise MethodError("--method ompl", "OMPL is not installed", "pip install ompl, or use another method")
    return METHODS[method]()


def default_budget(method: str) -> Budget:
    """What a method may spend where the user says nothing."""
    return Budget(20_000_000, 3600.0) if method == "brute" else Budget(200_000, 120.0)
