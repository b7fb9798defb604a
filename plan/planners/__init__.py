"""The planners: one file each, one interface; those of the paper and its peers are loaded when they are named."""

from __future__ import annotations

from importlib import import_module

from ident.errors import InputError
from plan.options import SolveOptions
from plan.planners.base import Budget, Candidate, Ledger, Planner

__all__ = ["METHODS", "Budget", "Candidate", "Ledger", "Planner", "budget_of", "make_planner"]


# Where each method's planner stands; it is loaded when it is made: the libraries of some take seconds to load.
METHODS = {
    "sqp": "planners.sequential:Sequential",
    "reference": "planners.reference:Reference",
    "cma": "planners.evolution:Evolution",
    "ppo": "paper.ppo:Ppo",
    "ga": "paper.genetic:Genetic",
    "brute": "paper.brute_force:BruteForce",
    "compress": "paper.compression:Compression",
    "toppra": "paper.toppra:Toppra",
}
# Methods that shorten time only.
TIME_ONLY = ("compress", "toppra")


def make_planner(method: str, objective: str) -> Planner:
    """The planner of a name.

    Raises:
        InputError: No such method, or not for this objective.
    """
    if method not in METHODS:
        raise InputError("--method", f"{method!r} is unknown", f"use one of: {', '.join(METHODS)}")
    if method in TIME_ONLY and objective != "time":
        raise InputError("--method", f"{method} shortens time only", "use --objective time, or another method")
    module, name = METHODS[method].split(":")
    planner: Planner = getattr(import_module(f"plan.{module}"), name)()
    return planner


def budget_of(options: SolveOptions) -> Budget:
    """What a search may spend: what is asked for, and of the rest its method's usual."""
    usual = Budget(20_000_000, 3600.0) if options.method == "brute" else Budget(200_000, 120.0)
    asked = options.evaluations, options.seconds
    return Budget(usual.evaluations if asked[0] is None else asked[0], usual.seconds if asked[1] is None else asked[1])
