"""Names beside a discrepancy: what a flexible function of the state still sees, and what a law is worth beside it.

With R the whitened sums of a joint's discrepancy columns D and its torque y after the baseline and the names (a Schur
complement), D w with w ~ N(0, S) adds to the log evidence

    L(S) = ½ gᵀ (G + S⁻¹)⁻¹ g − ½ log |I + S^½ G S^½|,    G = R_DD, g = R_Dy,

and S, one variance a block, is where L is greatest. L is near zero where names and baseline explain a joint down to its
noise; beside a law that stands in for another cause it is not. A law is worth what it adds to the evidence of a
discrepancy alone, gain + L beside it − L in its place: names that a flexible function explains as cheaply are none.

Source: Kennedy and O'Hagan 2001 (discrepancy); Searle, Casella and McCulloch 1992 (variance components); MacKay 1992.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular

from ident.arrays import Array, Float, Int
from ident.effects.base import SessionContext
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.design import Group, layout_of
from ident.regression.discrepancy import BLOCKS, Discrepancy
from ident.regression.dwells import HeldFriction
from ident.regression.gram import Evidence, gather
from ident.regression.least_squares import Prior, Projection, factorise, project
from ident.regression.partition import build_partition

# Variances of a block that are tried, in squares of the whitened noise: decades from none to a thousand times its
# deviation, then half a decade about the best. Where noise is strongly coloured, less than a thousandth of it shows.
DECADES, HALVES = np.concatenate([[0.0], 10.0 ** np.arange(-7.0, 6.1)]), 10.0 ** np.array([-0.5, 0.5])
MOST_ROUNDS = 4
KINDS = tuple(Discrepancy(block) for block in BLOCKS)
# Mean square of a joint's whitened rows from which on it is looked into: noise itself is one.
LOUD = 1.5


@dataclass(frozen=True, eq=False)
class LeftAtJoint:
    """What a discrepancy sees at a joint beside a model."""

    evidence: float  # its log Bayes factor against no discrepancy [nats]
    kind: str | None  # the block that explains most of it: state, memory, time or coupling; None where there is none
    share: float  # share of the model's mean square that it explains, what its freedom would explain of noise taken off


@dataclass(frozen=True, eq=False)
class Beside:
    """What one law is worth beside a discrepancy at the joints where it acts."""

    gain: float  # log likelihood that it gains without a discrepancy [nats]
    left: float  # log evidence of a discrepancy beside it [nats]
    instead: float  # log evidence of a discrepancy in its place, without the law's own columns [nats]

    @property
    def log_bayes_factor(self) -> float:
        """What the law adds to the evidence of a discrepancy alone [nats]: little where that explains it as cheaply."""
        return self.gain + self.left - self.instead


@dataclass(frozen=True, eq=False)
class Posterior:
    """Names at their best points and discrepancies at some joints, in sums of their own."""

    evidence: Evidence  # sums of the baseline, the names and the discrepancies
    prior: Prior  # the URDF's tolerance
    names: Mapping[Group, Group]  # the named effects at their points, and the same among these sums' columns
    blocks: tuple[tuple[Int[Array, " m"], ...], ...]  # for each joint the columns of its discrepancy's blocks

    @classmethod
    def gather(
        cls,
        session: SessionContext,
        baseline: Baseline,
        known: Evidence,
        error: UrdfError,
        names: Sequence[Group] = (),
    ) -> Posterior:
        """One more pass over the recordings, for names and discrepancies alone.

        Args:
            session: The runs.
            baseline: The tuned model.
            known: Sums of the first pass: their noise, and how much friction varies from run to run.
            error: By how much the URDF is believed to be off.
            names: The named effects at their points.
        """
        grids = [(group.effect, group.joint, [group.variant]) for group in names]
        for j in range(session.n):
            inputs = KINDS[0].variants(session, j)
            grids += [(kind, j, list(inputs)) for kind in KINDS]
        layout = layout_of(session, baseline.base.rank, grids, beside=(HeldFriction(),))
        # Sums over all time are enough: blocks as long as friction keeps its level, one fold.
        settings = baseline.settings
        partition = build_partition(session, settings.but(shortest_block_s=settings.stretch_s, folds=1))
        evidence = gather(session, baseline, layout, known.whitening, partition, rest=True).with_dwells()
        flexible = [group.columns for group in layout.groups[len(names) :]]
        blocks = tuple(tuple(flexible[k : k + len(KINDS)]) for k in range(0, len(flexible), len(KINDS)))
        prior = Prior.believing(evidence, baseline, error)
        found = cls(evidence, prior, dict(zip(names, layout.groups, strict=False)), blocks)
        return found.revised(known, baseline, error)

    def revised(self, known: Evidence, baseline: Baseline, error: UrdfError) -> Posterior:
        """The same with the between-run variation of friction and the dispersion of other sums, and another prior.

        Args:
            known: These sums.
            baseline, error: The tuned model, and by how much the URDF is believed to be off.
        """
        evidence = self.evidence.with_run_spread(known.spread).with_dispersion(known.dispersion)
        return replace(self, evidence=evidence, prior=Prior.believing(evidence, baseline, error))

    def left_at(self, joint: int, names: Sequence[Group]) -> LeftAtJoint:
        """What a discrepancy sees at a joint beside the baseline and some names."""
        model = project(self.evidence.gram(), self.evidence, self.prior, names)
        sums = self._part(model, np.concatenate(self.blocks[joint]))
        found = estimate_variances(sums, _sizes(self.blocks[joint]))
        if not found.variances.any():
            return LeftAtJoint(0.0, None, 0.0)
        before, after = self._squares(joint, model, found, self.evidence.plain[joint].over())
        free = float(self.evidence.samples[joint]) / self._free_samples(joint, found)
        share = max(0.0, 1.0 - free * max(after, 0.0) / max(before, 1e-300))
        return LeftAtJoint(found.evidence, found.kind, share)

    def law(self, group: Group, others: Sequence[Group], joints: Sequence[int]) -> Beside:
        """What an effect is worth beside a discrepancy at some joints, and beside other effects.

        Args:
            group, others: The effect, and the other effects.
            joints: Where it acts.
        """
        flexible = [columns for j in joints for columns in self.blocks[j]]
        seen = np.concatenate([group.columns, *flexible, np.array([self.evidence.layout.size])])
        model = project(self.evidence.gram(), self.evidence, self.prior, others, seen)
        width, gain, left, instead = len(group.columns), 0.0, 0.0, 0.0
        for j in joints:  # a joint's discrepancy explains its own rows: their evidence adds up
            sums = self._part(model, np.concatenate([group.columns, *self.blocks[j]]))
            own, across, alone = sums[:width, :width], sums[:width, width:], sums[width:, width:]
            own = own + 1e-6 * np.diag(np.diag(own))
            with_it = alone - across.T @ np.linalg.solve(own, across)
            gain += 0.5 * float(alone[-1, -1] - with_it[-1, -1])
            kept = [kind.replaces(group.effect, size) for kind, size in zip(KINDS, _sizes(self.blocks[j]), strict=True)]
            rivals = np.append(np.flatnonzero(np.concatenate(kept)), len(alone) - 1)
            views = with_it, alone[np.ix_(rivals, rivals)]
            sizes = _sizes(self.blocks[j]), [int(one.sum()) for one in kept]
            found = [estimate_variances(*one) for one in zip(views, sizes, strict=True)]
            # Each from where the other ended, too: the evidence has several maxima.
            left += max(found[0].evidence, estimate_variances(views[0], sizes[0], found[1].variances).evidence)
            instead += max(found[1].evidence, estimate_variances(views[1], sizes[1], found[0].variances).evidence)
        return Beside(gain, left, instead)

    def _part(self, model: Projection, columns: Int[Array, " c"]) -> Float[Array, "c c"]:
        """Sums of some columns and the torque after a model.

        Encoder noise was taken off them: a column that is mostly noise may come out below zero, and gets as much back.
        """
        sums = model.rest(np.append(columns, self.evidence.layout.size))
        sums[np.arange(len(columns)), np.arange(len(columns))] += self.evidence.noise_power[columns]
        return _nonnegative(sums)

    def dispersion(self, joint: int) -> float:
        """Mean square of whitened rows that the baseline and a discrepancy leave at a joint, one at the least.

        What not even a flexible function explains there is noise to whatever else is estimated.
        """
        model = project(self.evidence.gram(), self.evidence, self.prior)
        found = estimate_variances(self._part(model, np.concatenate(self.blocks[joint])), _sizes(self.blocks[joint]))
        _, after = self._squares(joint, model, found, self.evidence.total[joint].over())
        return max(1.0, after / self._free_samples(joint, found))

    def _squares(
        self, joint: int, model: Projection, found: Variances, sums: Float[Array, "p p"]
    ) -> tuple[float, float]:
        """Squares that a model leaves of a joint's rows without and with a discrepancy.

        Beside a discrepancy the model itself is another: it no longer makes up for what the discrepancy explains.
        """
        columns, local = np.concatenate(self.blocks[joint]), self.evidence.layout.local[joint]
        beside = model.weights - model.left_of(columns) @ found.weights
        before, after = (float(one[local] @ sums @ one[local]) for one in (model.weights, beside))
        return before, after

    def _free_samples(self, joint: int, found: Variances) -> float:
        count = max(float(self.evidence.samples[joint]), 1.0)
        return max(count - found.freedom, 0.1 * count)


def measure_dispersion(posterior: Posterior) -> Float[Array, " n"]:
    """By how much more than whitened noise each joint leaves that not even a discrepancy explains."""
    evidence = posterior.evidence
    weights = project(evidence.gram(), evidence, posterior.prior).weights
    loud = [count > 0 and evidence.misfit(j, weights) > LOUD for j, count in enumerate(evidence.samples)]
    return np.array([posterior.dispersion(j) if one else 1.0 for j, one in enumerate(loud)])


@dataclass(frozen=True, eq=False)
class Variances:
    """Variances of a discrepancy's blocks where its evidence is greatest."""

    evidence: float  # log Bayes factor against no discrepancy [nats]
    variances: Float[Array, " b"]  # of each block, in squares of the whitened noise
    weights: Float[Array, " m"]  # mean of the columns' coefficients
    freedom: float  # number of parameters that the coefficients are worth
    kinds: Float[Array, " b"]  # what each block explains of the torque, whitened squares

    @property
    def kind(self) -> str | None:
        """The block that explains most."""
        return BLOCKS[int(np.argmax(self.kinds)) % len(BLOCKS)] if self.variances.any() else None


def estimate_variances(
    sums: Float[Array, "m m"], sizes: Sequence[int], start: Float[Array, " b"] | None = None
) -> Variances:
    """Variances of blocks by marginal likelihood, one block after the other over a grid.

    Args:
        sums: Whitened sums of all blocks' columns and, last, the torque, after the model beside which they stand.
        sizes: Number of columns of each block.
        start: Variances to begin with; none if None.
    """
    matrix, target = sums[:-1, :-1], sums[:-1, -1]
    bounds = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    variances = np.zeros(len(sizes)) if start is None else start.copy()
    best = _log_evidence(matrix, target, _deviations(variances, sizes))
    for _ in range(MOST_ROUNDS):
        before = best
        for block, size in enumerate(sizes):
            along = _evidence_along(matrix, target, _deviations(variances, sizes), slice(*bounds[block : block + 2]))
            for grid in (DECADES, variances[block] * HALVES):
                values = along(grid / size)
                if values.max() > best:
                    best, variances[block] = float(values.max()), grid[int(np.argmax(values))]
        if best - before < 0.05:
            break
    deviations = _deviations(variances, sizes)
    inner = deviations[:, None] * matrix * deviations
    factor = factorise(inner + np.eye(len(matrix)))
    weights = deviations * factor.solve(deviations * target)
    freedom = float(np.trace(factor.solve(inner)))
    kinds = [float(weights[a:b] @ matrix[a:b, a:b] @ weights[a:b]) for a, b in pairwise(bounds)]
    return Variances(best, variances, weights, freedom, np.array(kinds))


def _log_evidence(matrix: Float[Array, "m m"], target: Float[Array, " m"], deviations: Float[Array, " m"]) -> float:
    """L(S) of blocks with given standard deviations [nats]."""
    root = np.linalg.cholesky(deviations[:, None] * matrix * deviations + np.eye(len(matrix)))
    half = solve_triangular(root, deviations * target, lower=True, check_finite=False)
    return 0.5 * float(half @ half) - float(np.log(np.diag(root)).sum())


def _evidence_along(
    matrix: Float[Array, "m m"], target: Float[Array, " m"], deviations: Float[Array, " m"], block: slice
) -> Callable[[Float[Array, " v"]], Float[Array, " v"]]:
    """Log evidence as a function of variances of a block's coefficients, the other blocks' variances fixed."""
    used = deviations > 0.0
    used[block] = False
    scale, own = deviations[used], np.arange(len(target))[block]
    root = np.linalg.cholesky(scale[:, None] * matrix[np.ix_(used, used)] * scale + np.eye(len(scale)))
    beside = scale[:, None] * np.column_stack([matrix[np.ix_(used, own)], target[used]])
    half = solve_triangular(root, beside, lower=True, check_finite=False)
    rest = 0.5 * float(half[:, -1] @ half[:, -1]) - float(np.log(np.diag(root)).sum())
    values, vectors = np.linalg.eigh(matrix[np.ix_(own, own)] - half[:, :-1].T @ half[:, :-1])
    squares = (vectors.T @ (target[own] - half[:, :-1].T @ half[:, -1])) ** 2
    values = np.maximum(values, 0.0)

    def evidence(variances: Float[Array, " v"]) -> Float[Array, " v"]:
        grown = 1.0 + variances[:, None] * values
        return np.asarray(rest + 0.5 * (variances * ((1.0 / grown) @ squares) - np.log(grown).sum(axis=1)))

    return evidence


def _deviations(variances: Float[Array, " b"], sizes: Sequence[int]) -> Float[Array, " m"]:
    """Standard deviation of each column's coefficient."""
    return np.concatenate([np.full(size, np.sqrt(one / size)) for one, size in zip(variances, sizes, strict=True)])


def _sizes(blocks: Sequence[Int[Array, " m"]]) -> list[int]:
    return [len(block) for block in blocks]


def _nonnegative(sums: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """Sums that encoder noise was taken off, without directions that came out below zero."""
    values, vectors = np.linalg.eigh(0.5 * (sums + sums.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
