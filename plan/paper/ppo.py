"""Proximal policy optimisation of a bandit: the paper's method.

There is no state, so actor and critic have no input layer: the first hidden layer is its bias
alone. The policy is a Gaussian over offsets from the initial trajectory, the critic one number, the
baseline of the advantage.

Source: paper, section 3 and Fig. 5, 6, 10; Schulman et al., "Proximal policy optimization
algorithms", 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from ident.model.net_options import torch_threads
from plan.planners.base import Ledger, Planner
from plan.problem.problem import PlanningProblem


@dataclass(frozen=True)
class Ppo(Planner):
    """PPO with the schedule of Fig.

    10: 100 epochs for every seed, then rounds of 100 for one drawn by its learning.

    An epoch is one trajectory, as in the paper; they are evaluated in batches.
    """

    epochs: int = 2100  # epochs in all
    round: int = 100  # epochs of a seed before another may be drawn
    batch: int = 25  # trajectories an update
    passes: int = 3  # gradient steps an update
    learning_rate: float = 3e-3  # of Adam, falling linearly to a tenth
    clip: float = 0.3  # range of the probability ratio about one
    spread: float = 0.03  # initial standard deviation, as a share of each variable's range
    hidden: tuple[int, int] = (512, 256)  # sizes of both networks' layers
    name: ClassVar[str] = "ppo"

    @torch_threads(1)
    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Trains one agent a seed, by turns."""
        agents = [_Agent(problem, self, rng) for problem in problems]
        ledger.expected = max(self.epochs, self.round * len(agents))
        spent = 0
        for agent in agents:
            spent += agent.learn(self.round, ledger)
        # Whose turn it is is drawn by the level reached, and by what the last round gained.
        while spent < self.epochs:
            level = np.array([agent.best for agent in agents])
            gain = np.array([agent.gain for agent in agents])
            score = (level - level.max()) / 0.05 + gain / max(gain.max(), 1e-9)
            weight = np.exp(np.clip(score, -50.0, None))
            agent = agents[rng.choice(len(agents), p=weight / weight.sum())]
            spent += agent.learn(min(self.round, self.epochs - spent), ledger)


class _Net(torch.nn.Module):
    """Two hidden layers of rectifiers without an input, and linear heads."""

    def __init__(
        self, hidden: tuple[int, int], heads: Sequence[int], generator: torch.Generator
    ) -> None:
        super().__init__()
        first, second = hidden
        self.first = torch.nn.Parameter(torch.rand(first, generator=generator) * 0.1)
        self.second = torch.nn.Parameter(
            torch.randn(second, first, generator=generator) * (2.0 / first) ** 0.5
        )
        self.bias = torch.nn.Parameter(torch.zeros(second))
        self.heads = torch.nn.ParameterList(
            [torch.nn.Parameter(torch.zeros(size, second)) for size in heads]
        )
        self.offsets = torch.nn.ParameterList(
            [torch.nn.Parameter(torch.zeros(size)) for size in heads]
        )

    def forward(self) -> list[torch.Tensor]:
        hidden = torch.relu(self.second @ torch.relu(self.first) + self.bias)
        return [
            weight @ hidden + offset
            for weight, offset in zip(self.heads, self.offsets, strict=True)
        ]


class _Agent:
    """Actor and critic of one seed."""

    def __init__(self, problem: PlanningProblem, options: Ppo, rng: np.random.Generator) -> None:
        self.problem = problem
        self.options = options
        self.rng = rng
        self.best = -np.inf
        self.gain = 0.0
        self.learned = 0
        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        d = problem.dimension
        self.actor, self.critic = (
            _Net(options.hidden, heads, generator) for heads in ((d, d), (1,))
        )
        parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.adam = torch.optim.Adam(parameters, lr=options.learning_rate, fused=True)
        self.unit = options.spread * (problem.upper - problem.lower)

    def learn(self, epochs: int, ledger: Ledger) -> int:
        """Runs some epochs; returns how many."""
        before = self.best
        done = 0
        while done < epochs:
            size = min(self.options.batch, epochs - done)
            self._update(size, ledger)
            done += size
        self.gain = max(self.best - before, 0.0) if np.isfinite(before) else 0.0
        return done

    def _update(self, size: int, ledger: Ledger) -> None:
        with torch.no_grad():
            mean, spread = (output.numpy() for output in self.actor())
        noise = self.rng.normal(size=(size, len(mean)))
        # Antithetic pairs: the mean is felt with less noise.
        noise[size // 2 : 2 * (size // 2)] = -noise[: size // 2]
        action = mean + np.exp(spread) * noise
        candidates = self.problem.initial + action * self.unit
        penalised = self.problem.penalised(ledger.evaluate(self.problem, candidates))
        # The paper's reward, eq. 7 and 9, is singular at contact and unknown under penetration:
        # this one is bounded.
        reward = -np.clip(penalised, -10.0, 10.0)
        self.best = max(self.best, float(-penalised.min()))
        self.learned += len(reward)
        share = min(self.learned / max(self.options.epochs, 1), 1.0)
        for group in self.adam.param_groups:
            group["lr"] = self.options.learning_rate * (1.0 - 0.9 * share)
        # Mean zero and spread one within a batch: the rewards' scale carries no meaning.
        scaled = (reward - reward.mean()) / (reward.std() + 1e-9)
        self._fit(torch.from_numpy(action[: len(reward)]).float(), torch.from_numpy(scaled).float())

    def _fit(self, action: torch.Tensor, reward: torch.Tensor) -> None:
        old = None
        clip = self.options.clip
        for _ in range(self.options.passes):
            mean, spread = self.actor()
            (value,) = self.critic()
            z = (action - mean) * torch.exp(-spread)
            logarithm = -(0.5 * z * z + spread).sum(dim=1)
            if old is None:
                old = logarithm.detach()
                advantage = reward - value.detach()
            ratio = torch.exp(logarithm - old)
            clipped = torch.clamp(ratio, 1.0 - clip, 1.0 + clip)
            gained = torch.minimum(ratio * advantage, clipped * advantage).mean()
            loss = -gained + 0.5 * ((value - reward) ** 2).mean()
            self.adam.zero_grad(set_to_none=True)
            loss.backward()
            self.adam.step()
