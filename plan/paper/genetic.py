"""The paper's genetic algorithm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float, Int
from plan.command_options import GENERATIONS
from plan.planners.base import Ledger, Planner
from plan.problem.problem import PlanningProblem


@dataclass(frozen=True)
class Genetic(Planner):
    """Binary genes, roulette, uniform exchange (paper, section 3.4 and Fig. 7).

    Each variable is a line of bits over its range. Parents are drawn with a probability that falls
    with cost; each exchanges random bits with another. The paper prints neither mutation nor how
    cost becomes probability: here exponential in the rank of cost, and a small flip rate. The best
    is carried over.
    """

    bits: int = 10  # bits of a gene
    population: int = 100  # offspring a generation
    generations: int = GENERATIONS
    crossover: float = 0.8  # share of parents that exchange bits
    flip: float = 0.004  # probability that a bit flips
    name: ClassVar[str] = "ga"

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Runs all generations on the first problem.

        The initial trajectory is one of the first children.
        """
        problem = problems[0]
        ledger.expected = self.population * self.generations
        genes = rng.integers(0, 2, (self.population, problem.dimension, self.bits))
        genes[0] = self._encode(problem, problem.initial)
        cost = self._cost(problem, genes, ledger)
        for _ in range(self.generations - 1):
            best = genes[np.argmin(cost)].copy()
            genes = self._offspring(genes, cost, rng)
            genes[0] = best
            cost = self._cost(problem, genes, ledger)

    def _cost(
        self, problem: PlanningProblem, genes: Int[Array, "P d b"], ledger: Ledger
    ) -> Float[Array, " P"]:
        number = genes @ (1 << np.arange(self.bits)[::-1])
        x = problem.lower + number / (2**self.bits - 1) * (problem.upper - problem.lower)
        costs = ledger.penalised(problem, x)
        return np.concatenate([costs, np.full(len(x) - len(costs), np.inf)])

    def _offspring(self, genes: Array, cost: Array, rng: np.random.Generator) -> Array:
        rank = np.argsort(np.argsort(cost))
        weight = np.exp(-5.0 * rank / len(cost))
        chosen = rng.choice(len(cost), (2, len(cost)), p=weight / weight.sum())
        first = genes[chosen[0]]
        second = genes[chosen[1]]
        exchange = (rng.random(len(cost)) < self.crossover)[:, None, None] & (
            rng.random(genes.shape) < 0.5
        )
        children = np.where(exchange, second, first)
        return children ^ (rng.random(genes.shape) < self.flip)

    def _encode(self, problem: PlanningProblem, x: Array) -> Array:
        span = problem.upper - problem.lower
        number = np.rint((x - problem.lower) / span * (2**self.bits - 1)).astype(int)
        return (number[:, None] >> np.arange(self.bits)[::-1]) & 1
