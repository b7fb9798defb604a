"""The numbers of the regression: how time is cut, what counts as seen, how much friction varies from run to run."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class WanderingSettings(Settings):
    """Friction that wanders from run to run, against a law of warmth."""

    own: tuple[float, ...] = number(
        (0.0, 0.005, 0.01, 0.02, 0.04, 0.08),
        "1",
        "standard deviations of a stretch's own friction that are tried",
        "chosen: steps of two, to far beyond what arms show",
    )
    steps: tuple[float, ...] = number(
        (0.0, 0.003, 0.006, 0.0125, 0.025, 0.05, 0.1),
        "1",
        "and of a step of a random walk from stretch to stretch",
        "chosen: steps of two, to far beyond what arms show",
    )
    draws: int = number(1999, "1", "draws of friction that wanders", "law: resolution of 0.0005")
    fewest: int = number(
        3, "1", "stretches below which no law of warmth is told", "law: of fewer, a mean and a slow curve leave nothing"
    )


USUAL_WANDERING = WanderingSettings()


@dataclass(frozen=True)
class RegressionSettings(Settings):
    """What the sums are made of, and what is known beforehand."""

    inertia_share: float = number(
        0.04,
        "1",
        "standard deviation of a URDF's inertial numbers, as a share of the link's mass, mass x length, mass x length²",
        "chosen: arms come out of the factory within some per cent of their drawing",
    )
    known_share: float = number(
        0.005,
        "1",
        "the same of inertias that were identified on this very arm",
        "chosen: what a fit on rich motion leaves open",
    )
    folds: int = number(10, "1", "parts of a session that are left out in turn", "chosen: usual")
    fewest_runs: int = number(
        5, "1", "runs below which folds are pieces of runs", "chosen: else each is judged by a model of another motion"
    )
    most_blocks: int = number(
        128, "1", "blocks of time, at the most", "chosen: enough for a p-value of 0.001, few enough to hold"
    )
    most_sums_mb: float = number(
        512.0,
        "MB",
        "size of the sums of all blocks, beyond which blocks are fewer",
        "chosen: memory; up to ten joints none are",
    )
    fewest_blocks: int = number(
        16, "1", "blocks that no lack of memory goes below", "law: their signs are drawn in 32,768 ways"
    )
    fewest_folds: int = number(5, "1", "and folds", "chosen: usual where data are few")
    shortest_block_s: float = number(
        0.6, "s", "and their least length", "chosen: some correlation times of what an arm's model leaves"
    )
    most_lone_runs: int = number(
        256, "1", "runs that have blocks of their own; of more, several share one", "chosen: memory"
    )
    block_draws: int = number(
        4_000,
        "1",
        "samples, after decimation, of a block that runs share for which encoder noise is drawn once more",
        "law: squares of so many samples vary by 2 %; over all blocks by far less than the noise's ridge allows",
    )
    stretch_s: float = number(
        12.0, "s", "time over which friction keeps its level", "chosen: about the length of a run"
    )
    noise_samples: int = number(
        15_000, "1", "samples, after decimation, that the noise is estimated from", "chosen: work"
    )
    noise_order: int = number(
        4, "1", "order of the noise's autoregression", "chosen: more changes no whitened spectrum"
    )
    burst_samples: int = number(
        100,
        "1",
        "samples in a row whose power is told apart from bursts",
        "chosen: two seconds, some motions to and fro",
    )
    burst_power: float = number(
        10.0,
        "1",
        "mean square of such a stretch, in units of the middle one's, from which on it is no noise",
        "chosen: noise of drives trebles from no load to rated load at most",
    )
    least_own_noise: float = number(
        0.05,
        "1",
        "share of a residual's mean square that is the torque's own noise, whatever encoders add",
        "chosen: some is",
    )
    mostly_noise: float = number(
        0.5,
        "1",
        "share of a candidate's column that may be encoder noise for it to explain any of the torque's noise",
        "law: more of it is noise than motion",
    )
    least_visible: float = number(
        1e-4, "1", "share of a column's power that a model must leave for it to be seen", "chosen: far above rounding"
    )
    least_over_noise: float = number(
        0.3, "1", "and the least multiple of its encoder noise", "calibrated: coarse encoders"
    )
    noise_ridge: float = number(
        0.05,
        "1",
        "ridge, as a share of the encoder noise that was taken off a column",
        "calibrated: coarse encoders; what is left of it is an estimate",
    )
    usual_spread: float = number(
        0.01, "1", "usual variation of friction from run to run, as a share", "calibrated: a warm UR10e"
    )
    usual_runs: float = number(2.0, "1", "runs that the usual variation counts as", "chosen: less than any session has")
    wide_spread: float = number(
        0.05,
        "1",
        "variation beside which an effect must show before anything is known of it",
        "chosen: more than a warm arm shows",
    )
    wandering: WanderingSettings = USUAL_WANDERING


USUAL_REGRESSION = RegressionSettings()
