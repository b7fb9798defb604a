"""A discrepancy beside the named laws: a flexible function of each joint's state, with a variance of its own.

    τ_j = baseline + Σ_k law_k + δ_j + noise,    δ_j = Σ_b D_b w_b,    w_b ~ N(0, σ_b² / m_b),

in four blocks b of m_b columns: the joint's own state (position, speed, load, direction), its recent past (travel and
time since the last reversal), the session's time, and the other joints. Columns are random Fourier features of scaled
inputs, so the state's block stands for a Gaussian process; σ_b is estimated by marginal likelihood. What a law explains
must be worth more than what δ would explain in its place; what only δ explains is not in the catalogue.

Source: Kennedy and O'Hagan 2001 (discrepancy of a model); Rahimi and Recht 2007 (random Fourier features).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.motion.motion import last_turns
from ident.records import read_group

Block = Literal["state", "memory", "time", "coupling"]
BLOCKS: tuple[Block, ...] = ("state", "memory", "time", "coupling")

SHAPE = read_group(__file__, "discrepancy")


class Discrepancy(Effect):
    """One block of the flexible function at a joint; a nuisance of the regression, never a name."""

    id = "discrepancy"

    def __init__(self, block: Block) -> None:
        self.block = block

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """The one variant, which holds centres and scales of the whole session's inputs."""
        inputs = np.concatenate([_inputs(run, joint)[:: run.motion.lowpass.factor] for run in session.runs])
        shape = {"start": session.runs[0].motion.time[0], "end": session.runs[-1].motion.time[-1]}
        for k in range(inputs.shape[1]):
            shape[f"centre_{k}"], shape[f"scale_{k}"] = float(inputs[:, k].mean()), float(inputs[:, k].std() + 1e-9)
        return (Variant({}, None, shape),)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T k"]]:
        return [self._columns_of(run, joint, variant) for run in session.runs]

    def replaces(self, effect: Effect, count: int) -> Bool[Array, " k"]:
        """Which of its columns may stand in an effect's place: all but those that are the effect's own law.

        Friction that builds up over some travel after each reversal, or that fades with the session's time, is one law
        by two names.

        Args:
            effect, count: The effect, and the number of columns.
        """
        own = np.zeros(count, dtype=bool)
        alone = count // 3  # those that neither the direction nor a state multiplies come first
        if self.block == "memory" and effect.drawn_over == "reversal":
            own[alone : alone + len(SHAPE.travels_rad) - 1] = True  # the longest travel is that of cables
        if self.block == "time" and effect.by_run:
            own[alone:] = True
        return ~own

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Float[Array, " k"],
        covariance: Float[Array, "k k"],
    ) -> dict[str, Interval]:
        return {}

    def _columns_of(self, run: RunContext, joint: int, variant: Variant) -> Float[Array, "T k"]:
        shape = variant.shape
        width = 5 + 3 * (run.n - 1)
        centre = np.array([shape[f"centre_{k}"] for k in range(width)])
        scale = np.array([shape[f"scale_{k}"] for k in range(width)])
        x = (_inputs(run, joint) - centre) / scale
        direction = run.direction[:, joint : joint + 1]
        if self.block == "state":
            return _features(x[:, :5], direction, SHAPE.state_columns, 3, 100 + joint)
        if self.block == "coupling":
            return _features(x[:, 5:], direction, SHAPE.coupling_columns, 2, 200 + joint)
        if self.block == "memory":
            age, moved = since_reversal(run.motion.time, run.motion.q[:, joint], run.motion.dq[:, joint])
            fade = [np.exp(-np.abs(moved) / travel) for travel in SHAPE.travels_rad]
            fade += [np.exp(-age / one) for one in SHAPE.ages_s]
            fading = np.stack(fade, axis=1)
            return np.concatenate([fading, fading * direction, fading * direction * x[:, 2:3]], axis=1)
        at = (run.motion.time - shape["start"]) / max(shape["end"] - shape["start"], 1e-9)
        waves = np.cos(np.pi * at[:, None] * np.arange(1, SHAPE.waves + 1))
        return np.concatenate([waves, waves * direction, waves * x[:, 1:2]], axis=1)


def _inputs(run: RunContext, joint: int) -> Float[Array, "T k"]:
    """What the function depends on: the joint's own position, speed, load, its slow speeds spread out, its direction;

    then position, speed and direction of each other joint.
    """
    motion = run.motion
    dq = motion.dq[:, joint]
    slow = np.arcsinh(dq / (0.05 + 0.05 * np.sqrt(np.mean(dq**2))))
    own = [motion.q[:, joint], dq, run.link[:, joint], slow, run.direction[:, joint]]
    others = [k for k in range(run.n) if k != joint]
    return np.stack(own + [one[:, k] for k in others for one in (motion.q, motion.dq, run.direction)], axis=1)


def _features(
    x: Float[Array, "T k"], direction: Float[Array, "T 1"], count: int, active: int, seed: int
) -> Float[Array, "T m"]:
    """Random Fourier features, each of some of the inputs; every other one turns its sign with the direction.

    In half the room: their seventh digit decides nothing, and cosines are as fast again.
    """
    weights, phases = _draw_features(x.shape[1], count, active, seed)
    waves = np.cos(x.astype(np.float32) @ weights + phases)
    waves[:, 1::2] *= direction
    return np.asarray(waves)


@cache
def _draw_features(inputs: int, count: int, active: int, seed: int) -> tuple[Float[Array, "k m"], Float[Array, " m"]]:
    """Frequencies and phases of features of some inputs."""
    rng = np.random.default_rng(seed)
    weights = np.zeros((inputs, count), dtype=np.float32)
    for m in range(count):
        used = rng.choice(inputs, min(int(rng.integers(1, active + 1)), inputs), replace=False)
        weights[used, m] = rng.standard_normal(len(used)) / SHAPE.lengths[m % len(SHAPE.lengths)]
    return freeze(weights), freeze(rng.uniform(0.0, 2.0 * np.pi, count).astype(np.float32))


def since_reversal(time: Array, q: Array, dq: Array) -> tuple[Array, Array]:
    """Time [s] and travel [rad] since the last reversal of each sample."""
    last = last_turns(np.sign(dq)[:, None])[:, 0]
    return time - time[last], q - q[last]
