"""Genetic algorithms: the paper's binary one, and pymoo's as the strong one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.evaluator import Evaluator
from pymoo.core.problem import Problem
from pymoo.problems.static import StaticProblem

from ident.arrays import Array, Float, Int
from plan.planners.base import Ledger, Planner
from plan.problem.problem import PlanningProblem


@dataclass(frozen=True)
class PaperGenetic(Planner):
    """Binary genes, roulette, uniform exchange (paper, section 3.4 and Fig. 7).

    Each variable is a line of bits over its range. Parents are drawn with a probability that falls with cost; each
    exchanges random bits with another. The paper prints neither mutation nor how cost becomes probability: here
    exponential in the rank of cost, and a small flip rate. The best is carried over.

    Attributes:
        bits: Bits of a gene.
        population: Offspring a generation.
        generations: Generations.
        crossover: Share of parents that exchange bits.
        flip: Probability that a bit flips.
        serial: Evaluate one child at a time, as the paper had to on its graphics card.
    """

    bits: int = 10
    population: int = 100
    generations: int = 200
    crossover: float = 0.8
    flip: float = 0.004
    serial: bool = False
    name: ClassVar[str] = "ga"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Runs all generations on the first problem; the initial trajectory is one of the first children."""
        problem = problems[0]
        genes = rng.integers(0, 2, (self.population, problem.dimension, self.bits))
        genes[0] = self._encode(problem, problem.initial)
        cost = self._cost(problem, genes, ledger)
        for _ in range(self.generations - 1):
            best = genes[np.argmin(cost)].copy()
            genes = self._offspring(genes, cost, rng)
            genes[0] = best
            cost = self._cost(problem, genes, ledger)

    def _cost(self, problem: PlanningProblem, genes: Int[Array, "P d b"], ledger: Ledger) -> Float[Array, " P"]:
        x = self._decode(problem, genes)
        batches = [x[i : i + 1] for i in range(len(x))] if self.serial else [x]
        found = np.concatenate([ledger.penalised(problem, batch) for batch in batches])
        return np.concatenate([found, np.full(len(x) - len(found), np.inf)])

    def _offspring(self, genes: Array, cost: Array, rng: np.random.Generator) -> Array:
        rank = np.argsort(np.argsort(cost))
        weight = np.exp(-5.0 * rank / len(cost))
        chosen = rng.choice(len(cost), (2, len(cost)), p=weight / weight.sum())
        first, second = genes[chosen[0]], genes[chosen[1]]
        exchange = (rng.random(len(cost)) < self.crossover)[:, None, None] & (rng.random(genes.shape) < 0.5)
        children = np.where(exchange, second, first)
        return children ^ (rng.random(genes.shape) < self.flip)

    def _decode(self, problem: PlanningProblem, genes: Array) -> Float[Array, "P d"]:
        number = genes @ (1 << np.arange(self.bits)[::-1])
        return problem.lower + number / (2**self.bits - 1) * (problem.upper - problem.lower)

    def _encode(self, problem: PlanningProblem, x: Array) -> Array:
        span = problem.upper - problem.lower
        number = np.rint((x - problem.lower) / span * (2**self.bits - 1)).astype(int)
        return (number[:, None] >> np.arange(self.bits)[::-1]) & 1


@dataclass(frozen=True)
class StrongGenetic(Planner):
    """pymoo's real-coded genetic algorithm: simulated binary crossover, polynomial mutation, elitist survival.

    Attributes:
        population: Offspring a generation.
        generations: Generations at most.
    """

    population: int = 100
    generations: int = 200
    name: ClassVar[str] = "ga-pymoo"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Runs on the first problem from a population around its initial trajectory and over the whole box."""
        problem = problems[0]
        shape = (self.population, problem.dimension)
        wide = rng.uniform(problem.lower, problem.upper, shape)
        near = problem.initial + rng.normal(size=shape) * 0.1 * (problem.upper - problem.lower)
        mixed = np.where(np.arange(self.population)[:, None] % 2 == 0, near, wide)
        mixed[0] = problem.initial
        start = np.clip(mixed, problem.lower, problem.upper)
        shell = Problem(n_var=problem.dimension, n_obj=1, xl=problem.lower, xu=problem.upper)
        algorithm = GA(pop_size=self.population, sampling=start, eliminate_duplicates=True)
        algorithm.setup(shell, termination=("n_gen", self.generations), seed=int(rng.integers(2**31)))
        while algorithm.has_next():
            asked: Any = algorithm.ask()
            cost = ledger.penalised(problem, asked.get("X"))
            cost = np.concatenate([cost, np.full(len(asked) - len(cost), np.inf)])
            Evaluator().eval(StaticProblem(shell, F=cost[:, None]), asked)
            algorithm.tell(infills=asked)
