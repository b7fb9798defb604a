"""One estimate of all that is linear: base inertial parameters, rotor inertia, viscous and Coulomb friction, offset.

All joints' torques are one weighted least-squares problem. Each joint is weighted by what one of its rows is worth
(its residual, inflated by autocorrelation), each run by the joints' friction in it (see `run_effects`). The covariance
is that of generalised least squares with these variances, prior included, and friction that wanders over the session
beside it. Student's t allows for variances that are themselves estimated. A sandwich of the blocks' scores in its place
was measured: of twenty blocks it is too noisy, and held above the weights' own account it made intervals 1.2 to 1.3
times too wide. Rows near reversals are left out: friction there depends on what was before, and with them rotor inertia
came out 10 % too low on arms whose friction is stick-slip.

Source: Kauermann and Carroll 2001 (what a fit takes from scores); Satterthwaite 1946 (degrees of freedom).

Joints whose effort holds no friction: torque sensors behind the gear, or a model's torque.

Rows near reversals are left out of an estimate because dry friction there depends on what was before. Where there is
none, they are as good as any other, and in some recordings the larger half. Effort without dry friction is torque at
the link, to which neither viscous friction nor the rotor belongs: where the recordings agree, they are zero too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int
from ident.errors import RecordingError
from ident.fitting.block_sums import LEAST_ROWS, LOSS_COLUMNS, BlockSums
from ident.fitting.run_effects import USUAL_SPREAD, RunEffect, RunSums, fit_run_effects, wandering
from ident.laws.carried import NamedLaw

# Weights are repeated until no parameter moves by more than this share of its uncertainty, or so many times.
SETTLED_SHARE, MOST_PASSES = 0.01, 20
# Robust weights: blocks whose residual is beyond this many medians of all blocks' lose their pull (Huber's k).
HUBER_KNEE = 1.345
# Columns that carry less than this share of the largest carry nothing: their scores are no measure of correlation.
LEAST_COLUMN = 1e-6
# Least eigenvalue of the columns of a joint's friction, scaled to length one, at which they count as distinguished.
LEAST_PARTED = 1e-7
# Columns of whose blocks' scores the fit leaves less than this share are no measure of it either.
LEAST_LEFT = 0.05


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """All parameters: r changes of base parameters, then p loss parameters a joint."""

    values: Float[Array, " m"]  # the parameters, shape (m,)
    covariance: Float[Array, "m m"]  # their covariance, shape (m, m)
    dof: Float[Array, " m"]  # degrees of freedom behind each standard deviation
    # Weighted normal equations of the data alone, without prior.
    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    # Variance of each parameter that is left however many runs there are, as friction wanders over them.
    wandering: Float[Array, " m"]
    noise: Float[Array, " n"]  # residual standard deviation of each joint, runs' changes taken out [N m]
    spread: Float[Array, "n 2"]  # relative spread of (viscous, Coulomb) friction from run to run, shape (n, 2)
    rank: int  # number r of base parameters
    per_joint: int  # number p of loss parameters a joint
    # How many there were.
    blocks: int
    runs: int
    shared: int = 0  # number of parameters of named laws, which stand last

    @property
    def std(self) -> Float[Array, " m"]:
        return np.sqrt(np.diag(self.covariance))

    def index(self, joint: int) -> Int[Array, " p"]:
        """Positions of a joint's loss parameters."""
        return self.rank + self.per_joint * joint + np.arange(self.per_joint)

    def without_inertias(self, prior: Float[Array, "r r"]) -> JointEstimate:
        """The losses' estimate with the inertias held at the URDF's, which may be off as far as the prior says."""
        rank = self.rank
        own = np.linalg.inv(self.information[rank:, rank:])
        values = np.concatenate([np.zeros(rank), own @ self.score[rank:]])
        through, off = own @ self.information[rank:, :rank], np.linalg.inv(prior)
        covariance = np.zeros_like(self.covariance)
        covariance[:rank, :rank] = off
        covariance[rank:, rank:] = own + through @ off @ through.T
        covariance += np.diag(self.wandering)
        return replace(self, values=values, covariance=covariance)


# The normal equations under the present weights, and what they were made of.
Weighted = tuple[Array, Array, list[RunEffect]]


class JointProblem:
    """The data as the estimate needs them, and the weights found so far.

    Args:
        sums: Of all runs.
        prior: Information on the base parameters before any data, shape (r, r).
        offset: Whether a constant torque is a parameter.
        robust: Whether blocks that fit badly lose their pull.
    """

    def __init__(self, sums: BlockSums, prior: Float[Array, "r r"], offset: bool = False, robust: bool = False) -> None:
        self.rank, self.prior, self.robust = sums.rank, prior, robust
        self.per_joint = 4 if offset else 3
        first = sums.rank + LOSS_COLUMNS
        self.shared = sums.shared
        local = [*range(sums.rank + self.per_joint), *range(first, first + sums.shared)]
        gram, self.moment, self.square = sums.of(local)
        self.gram = np.ascontiguousarray(gram)  # picked columns lie apart in memory, and products of those are slow
        self.rows = sums.rows.astype(float)
        self.n = self.rows.shape[1]
        self.size = self.rank + self.n * self.per_joint + self.shared
        self.labels, self.run = np.unique(sums.run, return_inverse=True)
        self.friction = (self.rank + 1, self.rank + 2)

    def index(self, joint: int) -> Int[Array, " k"]:
        """Positions of all parameters that a joint's torque speaks of."""
        own = self.rank + self.per_joint * joint + np.arange(self.per_joint)
        return np.concatenate([np.arange(self.rank), own, np.arange(self.size - self.shared, self.size)])

    def solve(self) -> JointEstimate:
        """Estimate, weights and covariance."""
        weight = np.ones((len(self.run), self.n))
        noise, inflation = self._first_noise(), np.ones(self.n)
        spread = np.full((self.n, 2), USUAL_SPREAD)
        values, std = np.zeros(self.size), np.full(self.size, np.inf)
        sums = self._by_run(weight)
        for _ in range(MOST_PASSES):
            information, score, effects = self._weigh(sums, values, noise * inflation, spread)
            spread = np.array([effect.spread for effect in effects])
            bread = _inverse(self._with_prior(information))
            before, values = values, bread @ score
            if self.robust:
                weight = np.ones((len(self.run), self.n))
                for j, effect in enumerate(effects):
                    mean = np.sqrt(self._left(j, values, effect)[0] / np.maximum(self.rows[:, j], 1.0))
                    usual = np.median(mean[self.rows[:, j] > 0]) if np.any(self.rows[:, j] > 0) else 1.0
                    weight[:, j] = np.minimum(1.0, HUBER_KNEE * usual / np.maximum(mean, 1e-12))
                sums = self._by_run(weight)
            noise, inflation = self._noise(values, bread, effects, weight)
            std = np.sqrt(np.diag(bread))
            if np.all(np.abs(values - before) <= SETTLED_SHARE * std):
                break
        weighted = self._weigh(sums, values, noise * inflation, spread)
        return self._result(sums, weighted, values, noise)

    def _first_noise(self) -> Float[Array, " n"]:
        """Variance of what each joint's own least squares leave [N² m²]."""
        noise = np.ones(self.n)
        for j in range(self.n):
            gram, moment = self.gram[:, j].sum(axis=0), self.moment[:, j].sum(axis=0)
            scale = np.sqrt(np.diag(gram)) + 1e-12
            found = np.linalg.lstsq(gram / np.outer(scale, scale), moment / scale, rcond=1e-8)[0]
            left = self.square[:, j].sum() - found @ (moment / scale)
            noise[j] = max(left, 1e-12 * self.square[:, j].sum(), 1e-18) / max(1.0, self.rows[:, j].sum())
        return noise

    def _by_run(self, weight: Float[Array, "b n"]) -> list[RunSums]:
        gram, moment = (
            self._by_runs(part * weight.reshape(*weight.shape, *[1] * (part.ndim - 2)))
            for part in (self.gram, self.moment)
        )
        return [RunSums(gram[:, j], moment[:, j]) for j in range(self.n)]

    def _by_runs(self, blocks: Float[Array, "b ..."]) -> Float[Array, "g ..."]:
        """Sums of each run's blocks, which stand in the order of their runs."""
        return np.add.reduceat(blocks, np.searchsorted(self.run, np.arange(len(self.labels))))

    def _weigh(self, sums: list[RunSums], values: Array, noise: Array, spread: Array) -> Weighted:
        information, score = np.zeros((self.size, self.size)), np.zeros(self.size)
        present = np.stack([values[self.index(j)] for j in range(self.n)])
        effects = fit_run_effects(sums, present, self.friction, noise, spread)
        for j, (own, effect) in enumerate(zip(sums, effects, strict=True)):
            index = self.index(j)
            part, right = effect.weigh(own)
            information[np.ix_(index, index)] += part
            score[index] += right
        return information, score, effects

    def _with_prior(self, information: Array) -> Array:
        full = information.copy()
        full[: self.rank, : self.rank] += self.prior
        return full

    def _left(self, joint: int, values: Array, effect: RunEffect) -> tuple[Array, Array]:
        """Sum of squares and Xᵀe of each block that the parameters and the run's change leave."""
        own = values[self.index(joint)] + effect.change[self.run] @ effect.columns.T
        gram, moment = self.gram[:, joint], self.moment[:, joint]
        through = np.einsum("bpq,bq->bp", gram, own)
        squares = self.square[:, joint] - np.einsum("bp,bp->b", 2 * moment - through, own)
        return np.maximum(squares, 0.0), moment - through

    def _noise(
        self, values: Array, bread: Array, effects: list[RunEffect], weight: Array
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Residual variance of each joint, and rows that one independent row is worth.

        The latter is how much larger the blocks' scores Xᵀe are than those of independent rows. Of the scores the fit
        has taken a part: what is left of a block's is expected to have the covariance G − G C G in units of a row, C
        the covariance of the joint's parameters in that block's run (`RunEffect.covariance_of_run`).
        """
        noise, inflation = np.ones(self.n), np.ones(self.n)
        for j, effect in enumerate(effects):
            index, gram, count = self.index(j), self.gram[:, j], weight[:, j]
            squares, scores = self._left(j, values, effect)
            total, rows = self.square[:, j].sum(), max(1.0, (count * self.rows[:, j]).sum())
            noise[j] = max((count * squares).sum(), 1e-12 * total, 1e-18) / rows
            known = effect.covariance_of_run(bread[np.ix_(index, index)], self._by_runs(gram * count[:, None, None]))
            taken = np.einsum("bpq,bqp->bp", gram @ (known / effect.noise)[self.run], gram)
            alone = np.einsum("bpp->bp", gram)
            expected = noise[j] * (count[:, None] * np.maximum(alone - taken, 0.0)).sum(axis=0)
            most = noise[j] * (count[:, None] * alone).sum(axis=0)
            used = (most > LEAST_COLUMN * most.max(initial=0.0)) & (expected > LEAST_LEFT * most)
            ratio = ((count[:, None] * scores) ** 2).sum(axis=0)[used] / expected[used]
            inflation[j] = max(1.0, float(np.median(ratio))) if used.any() else 1.0
            # What the parameters themselves took out of the residual.
            worth = rows / inflation[j]
            noise[j] *= worth / max(worth - self.size / self.n, 0.1 * worth)
        return noise, inflation

    def _result(self, sums: list[RunSums], weighted: Weighted, values: Array, noise: Array) -> JointEstimate:
        information, score, effects = weighted
        by_runs = np.zeros((self.size, self.size))
        for j, effect in enumerate(effects):
            index = self.index(j)
            by_runs[np.ix_(index, index)] += effect.covariance_of_scores(sums[j])
        blocks = int(np.sum(self.rows.any(axis=1)))
        bread = _inverse(self._with_prior(information))
        # What friction that wanders over the session, and the runs' changes, add to each parameter, and their freedom.
        walk, dof_of_walk = np.zeros(self.size), np.ones(self.size)
        freedom = np.full(self.size, np.median([effect.dof for effect in effects]))
        for j, (effect, relative, dof) in enumerate(zip(effects, *wandering(effects), strict=True)):
            index = self.index(j)[list(self.friction)]
            walk[index] = effect.columns[list(self.friction)].diagonal() ** 2 * relative
            dof_of_walk[index], freedom[index] = dof, effect.dof
        # Degrees of freedom of each variance by those of its parts: noise, runs' changes, prior and walk.
        first = bread[:, : self.rank]
        parts = [np.diag(bread @ by_runs @ bread), np.diag(first @ self.prior @ first.T), walk]
        parts = [np.maximum(np.diag(bread) - parts[0] - parts[1], 0.0), *parts]
        total = sum(parts, np.full(self.size, 1e-300))
        free = (max(1.0, blocks - self.size / self.n), freedom, np.inf, dof_of_walk)
        shares = ((part / total) ** 2 / d for part, d in zip(parts, free, strict=True))
        return JointEstimate(
            values=values,
            covariance=bread + np.diag(walk),
            dof=1.0 / np.clip(sum(shares, np.zeros(self.size)), 1e-12, 1.0),
            information=information,
            score=score,
            wandering=walk,
            noise=np.sqrt(noise),
            spread=np.array([effect.spread for effect in effects]),
            rank=self.rank,
            per_joint=self.per_joint,
            blocks=blocks,
            runs=len(self.labels),
            shared=self.shared,
        )


def estimate(sums: BlockSums, prior: Float[Array, "r r"], offset: bool = False, robust: bool = False) -> JointEstimate:
    """All linear parameters of an arm with their covariance.

    Args:
        sums: One pass over the runs.
        prior: Information on the base parameters before any data.
        offset: Whether a constant torque is a parameter.
        robust: Whether blocks that fit badly lose their pull.
    """
    return JointProblem(sums, prior, offset, robust).solve()


def _inverse(matrix: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """Inverse of a positive definite matrix whose unknowns have different units; exactly symmetric."""
    size = np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)
    return 0.5 * (inverse + inverse.T)


def quantile(dof: Float[Array, "..."], level: float = 0.95) -> Float[Array, "..."]:
    """Half width of an interval in standard deviations, by Student's t."""
    return np.asarray(stdtrit(np.minimum(dof, 1e6), 0.5 + level / 2))


def require_parted(sums: BlockSums, named: Sequence[NamedLaw], joints: Sequence[str], where: str, losses: int) -> None:
    """Raises RecordingError where the recordings can't tell a named law from plain losses and the laws beside it."""
    first = sums.rank + LOSS_COLUMNS
    places = np.cumsum([first, *(law.size for law in named)])
    for joint in sorted({law.joint for law in named}):
        spans = zip(named, pairwise(places), strict=True)
        own = [k for law, (start, end) in spans if law.joint == joint for k in range(start, end)]
        columns = [*range(sums.rank, sums.rank + losses), *own]
        gram = sums.of(columns)[0][:, joint].sum(axis=0)
        size = np.sqrt(np.diag(gram))
        if np.any(size <= 0.0) or np.linalg.eigvalsh(gram / np.outer(size, size))[0] < LEAST_PARTED:
            laws = " and ".join(law.effect for law in named if law.joint == joint)
            what = f"its motions can't tell {laws} of {joints[joint]} from plain friction or an offset"
            raise RecordingError(where, what, "fit without --with (or --offset), or record motions that show it")


def require_motion(sums: BlockSums, joints: tuple[str, ...], where: str) -> None:
    """Raises RecordingError unless every joint moves enough to be fitted."""
    for name, rows in zip(joints, sums.rows.sum(axis=0), strict=True):
        if rows < LEAST_ROWS:
            raise RecordingError(
                where, f"{name} hardly moves: its loss can't be fitted", "add runs that move it, or lock it"
            )


# Dry friction below a filtered row's noise harms no row near a reversal more than that noise does.
# Real arms have up to 50 times as much at some joint.
HARMLESS = 1.0
# A joint surely has more where its value is so many standard deviations from zero; its upper bound is so many above it.
SURE, BOUND = 3.0, 2.0
# 99 % quantile of chi-square by the number of loss parameters: beyond it they are not zero together.
NOT_ZERO = {3: 11.345, 4: 13.277}
COULOMB = 2


def find_frictionless(
    found: JointEstimate, joints: int, through_reversals: Callable[[Bool[Array, " n"]], JointEstimate]
) -> tuple[Bool[Array, " n"], JointEstimate]:
    """Joints without dry friction, and the estimate with all their moving rows.

    Effort is of one kind at all joints: where one surely has dry friction, none is without.

    Args:
        found: The estimate clear of reversals.
        joints: How many there are.
        through_reversals: Makes the estimate anew with all moving rows of some joints.
    """
    chosen: Bool[Array, " n"] = np.full(joints, not _some_has_friction(found, joints))
    while np.any(chosen):
        with_all = through_reversals(chosen)
        value, std = _coulomb(with_all, joints)
        if _some_has_friction(with_all, joints):
            break
        kept = chosen & (value + BOUND * std < HARMLESS * with_all.noise)
        if np.array_equal(kept, chosen):
            return chosen, with_all
        chosen = kept
    return np.zeros(joints, dtype=bool), found


def _some_has_friction(found: JointEstimate, joints: int) -> bool:
    value, std = _coulomb(found, joints)
    return bool(np.any(value > np.maximum(SURE * std, HARMLESS * found.noise)))


def lossless_parameters(found: JointEstimate, frictionless: Bool[Array, " n"]) -> Int[Array, " z"]:
    """Positions of the losses of joints without friction, joint by joint, that are zero as far as can be determined."""
    zero: list[int] = []
    for joint in np.flatnonzero(frictionless):
        index = found.index(int(joint))
        values, covariance = found.values[index], found.covariance[np.ix_(index, index)]
        if values @ np.linalg.pinv(covariance, hermitian=True) @ values < NOT_ZERO[len(index)]:
            zero += index.tolist()
    return np.array(zero, dtype=int)


def _coulomb(found: JointEstimate, joints: int) -> tuple[Array, Array]:
    """Value and standard deviation of each joint's dry friction."""
    at = [int(found.index(joint)[COULOMB]) for joint in range(joints)]
    return found.values[at], found.std[at]
