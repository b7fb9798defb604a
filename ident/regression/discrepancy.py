"""A discrepancy beside the named laws: a flexible function of each joint's state, with a variance
of its own.

    τ_j = baseline + Σ_k law_k + δ_j + noise,    δ_j = Σ_b D_b w_b,    w_b ~ N(0, σ_b² / m_b),

in four blocks b of m_b columns: the joint's own state (position, speed, load, direction), its
recent past (travel and time since the last reversal), the session's time, and the other joints.
Columns are random Fourier features of scaled inputs, so the state's block stands for a Gaussian
process; σ_b is estimated by marginal likelihood. What a law explains must be worth more than what δ
would explain in its place; what only δ explains is not in the catalogue.

Source: Kennedy and O'Hagan 2001 (discrepancy of a model); Rahimi and Recht 2007 (random Fourier
features).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.motion.motion import last_turns
from ident.regression.settings import DISCREPANCY as SHAPE
from ident.regression.settings import UNUSUAL

Block = Literal["state", "memory", "time", "coupling"]
BLOCKS: tuple[Block, ...] = ("state", "memory", "time", "coupling")


class Discrepancy(Effect):
    """One block of the flexible function at a joint; a nuisance of the regression, never a name."""

    id = "discrepancy"
    decimated = True

    def __init__(self, block: Block) -> None:
        self.block = block

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """The one variant, which holds centres and scales of the whole session's inputs."""
        inputs = np.concatenate([_inputs(run, joint) for run in session.runs])
        shape = {
            "start": session.runs[0].motion.time[0],
            "end": session.runs[-1].motion.time[-1],
        }
        for k, values in enumerate(inputs.T):
            shape[f"centre_{k}"] = float(values.mean())
            shape[f"scale_{k}"] = float(values.std() + 1e-9)
        return (Variant({}, None, shape),)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "t k"]]:
        """The columns at the samples of each run that the common filter keeps."""
        return [self._columns_of(run, joint, variant) for run in session.runs]

    def replaces(self, effect: Effect, count: int) -> Bool[Array, " k"]:
        """Which of its columns may stand in an effect's place: all but those that are the effect's
        own law.

        Friction that builds up over some travel after each reversal, or that fades with the
        session's time, is one law by two names.

        Args:
            effect: The effect.
            count: Number of the block's columns.
        """
        same = np.zeros(count, dtype=bool)
        alone = count // 3  # those that neither the direction nor a state multiplies come first
        if self.block == "memory" and effect.drawn_over == "reversal":
            # the longest travel is that of cables
            same[alone : alone + len(SHAPE.travels_rad) - 1] = True
        if self.block == "time" and effect.by_run:
            same[alone:] = True
        return ~same

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Float[Array, " k"],
        covariance: Float[Array, "k k"],
    ) -> dict[str, Interval]:
        return {}

    def _columns_of(self, run: RunContext, joint: int, variant: Variant) -> Float[Array, "t k"]:
        """The block's columns at the filtered samples of a run."""
        shape = variant.shape
        width = 5 + 3 * (run.n - 1)
        centre = np.array([shape[f"centre_{k}"] for k in range(width)])
        scale = np.array([shape[f"scale_{k}"] for k in range(width)])
        x = (_inputs(run, joint) - centre) / scale
        direction = run.direction[run.motion.coarse, joint : joint + 1]
        if self.block == "state":
            return _features(x[:, :5], direction, SHAPE.state_columns, 3, 100 + joint)
        if self.block == "coupling":
            return _features(x[:, 5:], direction, SHAPE.coupling_columns, 2, 200 + joint)
        if self.block == "memory":
            return _of_memory(run, joint, direction, x[:, 2:3])
        duration = max(shape["end"] - shape["start"], 1e-9)
        instant = (run.motion.time[run.motion.coarse] - shape["start"]) / duration
        waves = np.cos(np.pi * instant[:, None] * np.arange(1, SHAPE.waves + 1))
        return np.concatenate([waves, waves * direction, waves * x[:, 1:2]], axis=1)


KINDS = tuple(Discrepancy(block) for block in BLOCKS)


def _of_memory(
    run: RunContext, joint: int, direction: Float[Array, "t 1"], load: Float[Array, "t 1"]
) -> Float[Array, "t k"]:
    """Columns that fade with the travel and the time since the joint last turned.

    Args:
        run: The run.
        joint: Index of the joint.
        direction: In which it moves.
        load: Its scaled load.
    """
    motion = run.motion
    age, moved = since_reversal(motion.time, motion.q[:, joint], motion.dq[:, joint])
    fade = [np.exp(-np.abs(moved) / travel) for travel in SHAPE.travels_rad]
    fade += [np.exp(-age / age_scale) for age_scale in SHAPE.ages_s]
    fading = np.stack(fade, axis=1)[motion.coarse]
    turned = fading * direction
    return np.concatenate([fading, turned, turned * load], axis=1)


def _inputs(run: RunContext, joint: int) -> Float[Array, "t k"]:
    """What the function depends on, at the samples that the common filter keeps.

    The joint's position, speed, load, its slow speeds spread out, its direction; then position,
    speed and direction of each other joint.
    """
    coarse = run.motion.coarse
    q = run.motion.q[coarse]
    dq = run.motion.dq[coarse]
    direction = run.direction[coarse]
    mean_square = np.mean(run.motion.dq[:, joint] ** 2)
    usual = 0.05 + 0.05 * np.sqrt(mean_square)
    of_joint = [
        q[:, joint],
        dq[:, joint],
        run.link[coarse, joint],
        np.arcsinh(dq[:, joint] / usual),
        direction[:, joint],
    ]
    of_others = []
    for k in range(run.n):
        if k != joint:
            of_others += [q[:, k], dq[:, k], direction[:, k]]
    return np.stack(of_joint + of_others, axis=1)


def _features(
    x: Float[Array, "T k"], direction: Float[Array, "T 1"], count: int, active: int, seed: int
) -> Float[Array, "T m"]:
    """Random Fourier features, each of some of the inputs; every other one turns its sign with the
    direction.

    In half the room: their seventh digit decides nothing, and cosines are as fast again.
    """
    weights, phases = _draw_features(x.shape[1], count, active, seed)
    waves = np.cos(x.astype(np.float32) @ weights + phases)
    waves[:, 1::2] *= direction
    return np.asarray(waves)


@cache
def _draw_features(
    inputs: int, count: int, active: int, seed: int
) -> tuple[Float[Array, "k m"], Float[Array, " m"]]:
    """Frequencies and phases of features of some inputs."""
    rng = np.random.default_rng(seed)
    weights = np.zeros((inputs, count), dtype=np.float32)
    for m in range(count):
        width = min(int(rng.integers(1, active + 1)), inputs)
        used = rng.choice(inputs, width, replace=False)
        length = SHAPE.lengths[m % len(SHAPE.lengths)]
        weights[used, m] = rng.standard_normal(len(used)) / length
    phases = rng.uniform(0.0, 2.0 * np.pi, count).astype(np.float32)
    return freeze(weights), freeze(phases)


def since_reversal(time: Array, q: Array, dq: Array) -> tuple[Array, Array]:
    """Time [s] and travel [rad] of each sample since the joint last turned, started or stopped.

    Args:
        time: Of the samples [s].
        q, dq: Position and velocity of one joint [rad, rad/s].
    """
    last = last_turns(np.sign(dq)[:, None])[:, 0]
    return time - time[last], q - q[last]


def unusual_torque(
    session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
) -> list[Float[Array, "t n"]]:
    """What of each run's leftover torque in motion the same states do not leave at other times [N
    m].

    It is what the discrepancy's features x of the joint's own state and of the others' do not
    predict by ridge regression of the leftover r, each piece of time from all others but its
    neighbours:

        u_k = r_k − x_k (Σ_l X_lᵀ W X_l + λ I)⁻¹ Σ_l X_lᵀ W r_l,    |l − k| > 1,

    so that a window never predicts itself; λ is the one that leaves least, by the median. Where
    even that leaves nearly as much as there was, nothing is taken off, nor at rest, where no
    function of the state says what friction holds.

    Source: Stone 1974 (cross-validated prediction); Huber 1964 (weights of what lies far out).

    Args:
        session: All runs.
        leftover: For each run what the tuned model leaves of the torque, filtered and decimated.

    Returns:
        For each run, of the shape of its leftover torque [N m].
    """
    piece = _pieces_of(session, leftover)
    every = np.concatenate(leftover)
    settled = np.concatenate([run.motion.settled for run in session.runs])
    known = settled & ~np.isnan(every)
    by_joint = []
    for joint in range(session.n):
        unusual = _of_joint(session, joint, every[:, joint], known[:, joint], piece)
        by_joint.append(unusual)
    ends = np.cumsum([len(values) for values in leftover])[:-1]
    return np.split(np.stack(by_joint, axis=1), ends)


def _pieces_of(
    session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
) -> Int[Array, " t"]:
    """Number of the piece of time that each sample of all runs lies in."""
    steps = []
    for run, values in zip(session.runs, leftover, strict=True):
        step = run.motion.interval * run.motion.lowpass.factor
        steps.append(np.full(len(values), step))
    clock = np.cumsum(np.concatenate(steps))
    duration = clock[-1]
    wanted = duration / UNUSUAL.shortest_piece
    pieces = int(np.clip(wanted, UNUSUAL.fewest_pieces, UNUSUAL.most_pieces))
    piece = (clock / duration * pieces).astype(int)
    return np.minimum(piece, pieces - 1)


def _of_joint(
    session: SessionContext,
    joint: int,
    left: Float[Array, " t"],
    known: Bool[Array, " t"],
    piece: Int[Array, " t"],
) -> Float[Array, " t"]:
    """What of one joint's leftover in motion the other pieces do not predict; all of it where they
    predict nothing.
    """
    usual = float(np.median(np.abs(left[known]))) if known.any() else 0.0
    if usual == 0.0:
        return left
    features = _state_features(session, joint)
    values = np.nan_to_num(left)
    far = np.maximum(np.abs(values), usual)
    weight = known * np.minimum(1.0, UNUSUAL.far_out * usual / far)
    pieces = int(piece[-1]) + 1
    starts = np.searchsorted(piece, np.arange(pieces + 1)).tolist()
    rows = [slice(start, end) for start, end in itertools.pairwise(starts)]
    grams = []
    scores = []
    for where in rows:
        of_piece = features[where]
        weighted = (of_piece * weight[where, None].astype(np.float32)).T
        grams.append(weighted @ of_piece)
        scores.append(weighted @ values[where])
    gram_of_piece = np.stack(grams).astype(float)
    # Each piece from all others but its neighbours.
    number = np.arange(pieces)
    distance = np.abs(np.subtract.outer(number, number))
    others = distance > 1
    gram = np.tensordot(others, gram_of_piece, 1)
    score = others @ np.stack(scores)
    width = features.shape[1]
    trace = float(np.trace(gram_of_piece.sum(axis=0)))
    ridge = trace / width * np.eye(width)
    best = left
    least = UNUSUAL.most_left * usual
    for share in UNUSUAL.ridges:
        slopes = np.linalg.solve(gram + share * ridge, score[:, :, None])[:, :, 0]
        by_piece = [features[where] @ slope for where, slope in zip(rows, slopes, strict=True)]
        predicted = np.concatenate(by_piece)
        residual = (values - predicted)[known]
        unusual = float(np.median(np.abs(residual)))
        if unusual < least:
            best = np.where(known, left - predicted, left)
            least = unusual
    return best


def _state_features(session: SessionContext, joint: int) -> Float[Array, "t k"]:
    """Features of the joint's own state and of the other joints, of all runs together."""
    blocks = [Discrepancy(block) for block in ("state", "coupling")]
    (inputs,) = blocks[0].variants(session, joint)
    columns = [np.concatenate(block.columns(session, joint, inputs)) for block in blocks]
    return np.concatenate(columns, axis=1)
