"""The numbers of the regression: how time is cut, what counts as seen, how much friction varies from run to run."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class WanderingSettings(Settings, table="wandering"):
    """Friction that wanders from run to run, against a law of warmth."""

    own: tuple[float, ...] = number()
    steps: tuple[float, ...] = number()
    draws: int = number()
    fewest: int = number()


USUAL_WANDERING = WanderingSettings()


@dataclass(frozen=True)
class RegressionSettings(Settings, table="regression"):
    """What the sums are made of, and what is known beforehand."""

    inertia_share: float = number()
    known_share: float = number()
    folds: int = number()
    fewest_runs: int = number()
    most_blocks: int = number()
    most_sums_mb: float = number()
    fewest_blocks: int = number()
    fewest_folds: int = number()
    shortest_block_s: float = number()
    most_lone_runs: int = number()
    block_draws: int = number()
    stretch_s: float = number()
    noise_samples: int = number()
    noise_order: int = number()
    burst_samples: int = number()
    burst_power: float = number()
    least_own_noise: float = number()
    mostly_noise: float = number()
    least_visible: float = number()
    least_over_noise: float = number()
    noise_ridge: float = number()
    usual_spread: float = number()
    usual_runs: float = number()
    wide_spread: float = number()
    wandering: WanderingSettings = USUAL_WANDERING


USUAL_REGRESSION = RegressionSettings()
