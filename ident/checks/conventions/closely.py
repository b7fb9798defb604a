"""Readings looked at closely: by more states, with what may be said of the masses beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.checks.conventions.description import Prices
from ident.checks.conventions.hypothesis import Hypothesis, states_as
from ident.checks.conventions.masses import Variant, variants
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log, moving
from ident.checks.conventions.settings import SEARCH
from ident.checks.conventions.torques import Columns


@dataclass(frozen=True)
class Scored:
    """A hypothesis, and how well it explains."""

    hypothesis: Hypothesis
    cost: float  # with what its changes are unlikely
    costs: tuple[float, ...]  # of each joint, without that
    sizes: tuple[float, ...]  # of each joint's torque over the model's
    cost_of_moving: float = np.inf  # as `cost`, by the joints that move alone

    @property
    def explains(self) -> float:
        """Share of the torque that is explained, the geometric mean over the joints' shares that
        are left.
        """
        return float(1.0 - np.exp(min(float(np.mean(self.costs)), 0.0)))


class CloseLook:
    """The readings of one log that were looked at closely; none twice."""

    def __init__(self, log: Log, model: Model, columns: Columns, prices: Prices) -> None:
        self.log = log
        self.model = model
        self.columns = columns
        self.prices = prices
        self.moves = moving(log)
        self._largest_effort = np.abs(log.tau).max(axis=0)
        self._scored: dict[Hypothesis, Scored] = {}

    @property
    def ranked(self) -> list[Scored]:
        """The readings that were looked at, the likeliest (least cost) first."""
        return sorted(self._scored.values(), key=lambda scored: scored.cost)

    def look(self, hypothesis: Hypothesis) -> None:
        """Scores a reading alone and with what may be said of the masses beside it; once only."""
        if hypothesis in self._scored:
            return
        for variant in variants(hypothesis, self.log, self.model):
            self.take(variant)

    def take(self, variant: Variant) -> None:
        """Scores a reading whose torque is known, whether it was scored before or not."""
        hypothesis = variant.hypothesis
        columns = np.array(hypothesis.effort_order)
        beyond = self._beyond_limits(hypothesis)
        costs = np.where(self.columns.alive[columns], variant.costs, 0.0)
        told = float(self.columns.weighed(variant.costs, columns).sum())
        told_by_moving = float(costs[self.moves[columns]].sum())
        beside = SEARCH.limit_cost * beyond + variant.more + self.prices.of(hypothesis)
        self._scored[hypothesis] = Scored(
            hypothesis,
            told + beside,
            tuple(costs.tolist()),
            tuple(variant.sizes.tolist()),
            told_by_moving + beside,
        )

    def _beyond_limits(self, hypothesis: Hypothesis) -> float:
        """Of which limits joints get out: of position, speed and effort, each counted once."""
        states = (self.log.q, self.log.dq)
        q, dq = states_as([hypothesis], states, self.model.sliding)
        effort = self._largest_effort[list(hypothesis.effort_order)]
        for joint, scale in hypothesis.effort_scale:
            effort[joint] /= scale
        of_motion = float(self.model.beyond_limits(q, dq)[0])
        return of_motion + float(self.model.beyond_effort(effort).max())
