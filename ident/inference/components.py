"""Variance components that every model has: friction's levels, the URDF's error, discrepancies,
dispersion.

For a set of effects, each is where the log evidence of the session is greatest beside the others:

    discrepancy   variance of each block of a joint's flexible function, by its analytic gradient
    urdf          scales of the URDF's error, on a grid with a prior
    friction      relative spread of each joint's friction level from stretch to stretch
    dispersion    mean square of whitened rows that all of it leaves, one at the least

A discrepancy is a nuisance beside every model: its columns are integrated out of a joint's sums,
after which sets of effects are compared without it.

Source: Kennedy and O'Hagan 2001 (discrepancy); MacKay 1992 (evidence of a scale).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from ident.arrays import Array, Float, Int
from ident.inference.evidence import factorise
from ident.inference.names import LEAST_DEVIATION, Names
from ident.inference.sums import SessionSums, without_negative_directions
from ident.inference.variances import Components, WeighedResidual, log_prior_of
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.design import Group
from ident.regression.least_squares import Prior, ridge_of


class ModelSums:
    """All joints' sums given variance components, discrepancies integrated out.

    A joint's rows are X β + Z ζ + e with its discrepancy's columns Z, ζ ~ N(0, V): beside any β its
    sums are XᵀX − XᵀZ (ZᵀZ + V⁻¹)⁻¹ ZᵀX.

    Attributes:
        sums, names, components: The session's sums, the candidates, and the variance components.
        whole: For each joint XᵀX of its rows' columns, torque last, with friction's levels
            integrated out and divided by its dispersion.
        reduced: The same with its discrepancy integrated out: XᵀX − XᵀZ (ZᵀZ + V⁻¹)⁻¹ ZᵀX, Z the
            discrepancy's columns and V their variances. Its own columns are still there, and not
            read again.
        gram: The reduced sums of all joints together, shape (P, P); the torque last.
        last: Number of the torque's column in `gram`.
        log_determinants: For each joint −½ log |I + V^½ ZᵀZ V^½| [nats].
        fixed_nats: What of the log evidence hangs on dispersion and friction alone [nats].
    """

    def __init__(
        self, sums: SessionSums, names: Names, baseline: Baseline, components: Components
    ) -> None:
        self.sums = sums
        self.names = names
        self.baseline = baseline
        self.components = components
        layout = sums.evidence.layout
        spread = components.friction.tolist()
        walk = components.walk.tolist()
        self.whole = []
        self.friction_nats = np.zeros(layout.n)
        for j in range(layout.n):
            of_joint, nats = sums.of_joint(j, spread[j], walk[j])
            self.whole.append(of_joint / components.dispersion[j])
            self.friction_nats[j] = nats
        # The discrepancies' columns come last, before the torque.
        first_columns = []
        for blocks in layout.flexible:
            first_columns += [group.columns[0] for group in blocks]
        self.last = int(min(first_columns, default=layout.size))
        samples = sums.evidence.samples
        self.fixed_nats = -0.5 * float(samples @ np.log(components.dispersion))
        self.fixed_nats += float(self.friction_nats.sum())
        self._reduce()

    def _reduce(self) -> None:
        """Integrates every joint's discrepancy out of `whole`, and adds the joints up."""
        layout = self.sums.evidence.layout
        self.gram = np.zeros((self.last + 1, self.last + 1))
        self.log_determinants = np.zeros(layout.n)
        self.reduced = []
        for j, variances in enumerate(self.components.discrepancy):
            reduced, nats = self._without_discrepancy(j, variances)
            self._add(j, reduced)
            self.reduced.append(reduced)
            self.log_determinants[j] = nats

    def _named(self, joint: int) -> tuple[Int[Array, " q"], Int[Array, " q"]]:
        """Where a joint's columns that are no discrepancy stand: in its rows, and in `gram`."""
        layout = self.sums.evidence.layout
        local = layout.local[joint]
        every = np.arange(len(local))
        named = np.setdiff1d(every, layout.flexible_places[joint])
        return named, np.minimum(local[named], self.last)

    def _add(self, joint: int, sums: Float[Array, "p p"]) -> None:
        """Adds a joint's sums, without its discrepancy's columns, to those of all joints."""
        named, columns = self._named(joint)
        self.gram[np.ix_(columns, columns)] += sums[np.ix_(named, named)]

    def with_discrepancy(self, changed: Mapping[int, Float[Array, " b"]]) -> ModelSums:
        """A copy with other variances of the discrepancies of some joints.

        Args:
            changed: For each of these joints, by index, the variances of its blocks.
        """
        other = copy(self)
        other.gram = self.gram.copy()
        other.reduced = list(self.reduced)
        other.log_determinants = self.log_determinants.copy()
        variances = self.components.discrepancy.copy()
        for joint, of_blocks in changed.items():
            variances[joint] = of_blocks
            reduced, nats = self._without_discrepancy(joint, of_blocks)
            other._add(joint, reduced - self.reduced[joint])
            other.reduced[joint] = reduced
            other.log_determinants[joint] = nats
        other.components = replace(self.components, discrepancy=variances)
        return other

    def with_friction(self, changed: Mapping[int, tuple[float, float]]) -> ModelSums:
        """A copy in which the friction of some joints varies otherwise.

        Args:
            changed: For each of these joints, by index, the relative spread of its friction level
                and the share of it that walks.
        """
        other = copy(self)
        friction = self.components.friction.copy()
        walk = self.components.walk.copy()
        other.whole = list(self.whole)
        other.friction_nats = self.friction_nats.copy()
        for joint, (spread, share) in changed.items():
            friction[joint] = spread
            walk[joint] = share
            of_joint, other.friction_nats[joint] = self.sums.of_joint(joint, spread, share)
            other.whole[joint] = of_joint / self.components.dispersion[joint]
        other.components = replace(self.components, friction=friction, walk=walk)
        other.fixed_nats += float((other.friction_nats - self.friction_nats).sum())
        variances = self.components.discrepancy
        return other.with_discrepancy({joint: variances[joint] for joint in changed})

    def with_urdf(self, error: UrdfError) -> ModelSums:
        """A copy whose components have another belief in how far the URDF may be off."""
        other = copy(self)
        other.components = replace(self.components, urdf=error)
        return other

    def with_dispersion(self, dispersion: Float[Array, " n"]) -> ModelSums:
        """A copy with other dispersions of the joints' rows: factors of their noise variance."""
        other = copy(self)
        before = self.components.dispersion
        other.components = replace(self.components, dispersion=dispersion)
        other.whole = []
        for sums, old, new in zip(self.whole, before, dispersion, strict=True):
            other.whole.append(sums * (old / new))
        rows = self.sums.evidence.samples
        ratio = np.log(before / dispersion)
        other.fixed_nats = self.fixed_nats + 0.5 * float(rows @ ratio)
        other._reduce()
        return other

    @property
    def nats(self) -> float:
        """Log determinants of discrepancies and friction, and priors of the components [nats]."""
        return self.fixed_nats + float(self.log_determinants.sum())

    def _without_discrepancy(
        self, joint: int, variances: Float[Array, " b"]
    ) -> tuple[Float[Array, "p p"], float]:
        """A joint's sums with its discrepancy integrated out, and −½ log |I + V^½ ZᵀZ V^½| [nats].

        Args:
            joint: Index of the joint.
            variances: V of each block of its discrepancy.
        """
        whole = self.whole[joint]
        deviation = self._deviations(joint, variances)
        used = np.flatnonzero(deviation)
        if len(used) == 0:
            return whole, 0.0
        places = self.sums.evidence.layout.flexible_places[joint][used]
        scale = deviation[used]
        inner = scale[:, None] * whole[np.ix_(places, places)] * scale
        inner[np.diag_indices(len(inner))] += 1.0
        factor = factorise(inner)
        across = scale[:, None] * whole[places]
        half = solve_triangular(factor, across, lower=True, check_finite=False)
        log_root = np.log(np.diag(factor)).sum()
        return whole - half.T @ half, -float(log_root)

    def _deviations(self, joint: int, variances: Float[Array, " b"]) -> Float[Array, " m"]:
        """V^½ of each column of a joint's discrepancy, from the variances of its blocks."""
        groups = self.sums.evidence.layout.flexible[joint]
        sizes = [len(group.columns) for group in groups]
        return np.repeat(np.sqrt(variances), sizes)

    def prior(self, error: UrdfError | None = None) -> Prior:
        """The URDF's tolerance as a prior of the base parameters, in the columns' scale.

        Args:
            error: Scales of the URDF's error; those of the components if None.
        """
        if error is None:
            error = self.components.urdf
        return Prior.believing(self.sums.evidence, self.baseline, error)

    def information(
        self, chosen: Sequence[Group], prior: Prior
    ) -> tuple[Int[Array, " z"], Float[Array, "z z"]]:
        """Columns of the baseline and some effects, and the information on their coefficients.

        Args:
            chosen: The effects.
            prior: What the URDF says of the baseline's base parameters.

        Returns:
            Indices of the z columns in `gram`, the baseline's first, then each effect's in the
            given order; and their sums with the inverse prior variances added, shape (z, z).
        """
        tuned = np.arange(self.sums.evidence.layout.tuned)
        inside = np.concatenate([tuned, *(group.columns for group in chosen)])
        inside = inside.astype(int)
        information = self.gram[np.ix_(inside, inside)].copy()
        self._add_priors(information, chosen, prior)
        return inside, information

    def _add_priors(
        self, information: Float[Array, "z z"], chosen: Sequence[Group], prior: Prior
    ) -> None:
        """Adds the inverse prior variances of the baseline and of some effects, in place.

        Args:
            information: Sums of their columns, in the order of `information`.
            chosen: The effects.
            prior: What the URDF says of the baseline's base parameters.
        """
        layout = self.sums.evidence.layout
        prior.add_to(information, layout)
        tuned = np.arange(layout.tuned)
        information[tuned, tuned] += ridge_of(self.gram, self.sums.evidence, tuned)
        if chosen:
            deviation = self._prior_deviations(chosen)
            of_effects = np.arange(layout.tuned, len(information))
            information[of_effects, of_effects] += deviation**-2.0

    def _prior_deviations(self, chosen: Sequence[Group]) -> Float[Array, " k"]:
        """Prior deviations of the scaled coefficients of some effects, none of them zero."""
        deviation = np.concatenate([self.names.deviation[group] for group in chosen])
        return np.maximum(deviation, LEAST_DEVIATION)

    def log_evidence(self, chosen: Sequence[Group], error: UrdfError | None = None) -> float:
        """Log evidence of the session beside a set of effects, priors of all components included
        [nats].

        Args:
            chosen: The effects.
            error: Scales of the URDF's error; those of the components if None.
        """
        if error is None:
            error = self.components.urdf
        prior = self.prior(error)
        inside, information = self.information(chosen, prior)
        factor = factorise(information)
        target = self.gram[inside, -1]
        half = solve_triangular(factor, target, lower=True, check_finite=False)
        nats = 0.5 * float(half @ half - self.gram[-1, -1])
        nats -= float(np.log(np.diag(factor)).sum())
        _, log_determinant = np.linalg.slogdet(prior.base)
        nats += 0.5 * float(log_determinant)
        if chosen:
            deviation = self._prior_deviations(chosen)
            nats -= float(np.log(deviation).sum())
            nats += sum(self.names.log_odds[group] for group in chosen)
        return nats + self.nats + log_prior_of(error)

    def residual(self, chosen: Sequence[Group]) -> WeighedResidual:
        """What the baseline, some effects and the discrepancies leave."""
        layout = self.sums.evidence.layout
        samples = self.sums.evidence.samples
        inside, information = self.information(chosen, self.prior())
        factor = factorise(information)
        estimate = cho_solve((factor, True), self.gram[inside, -1], check_finite=False)
        weights = np.zeros(layout.size + 1)
        weights[inside] = -estimate
        weights[-1] = 1.0
        mean_square = np.ones(layout.n)
        by_block = np.zeros((layout.n, len(layout.flexible[0])))
        for j, local in enumerate(layout.local):
            of_joint = weights[local].copy()
            discrepancy = self._follow(j, of_joint)
            by_block[j] = self._power_of_blocks(j, discrepancy)
            of_joint[layout.flexible_places[j]] = discrepancy
            square = float(of_joint @ self.whole[j] @ of_joint)
            mean_square[j] = square / max(float(samples[j]), 1.0)
        return WeighedResidual(weights, mean_square, by_block)

    def smooth_share(self, chosen: Sequence[Group]) -> Float[Array, " n"]:
        """Share, from 0 to 1, of each joint's squares beside some effects that its discrepancy
        explains.
        """
        nothing = np.zeros(self.components.discrepancy.shape[1])
        none = dict.fromkeys(range(len(self.whole)), nothing)
        before = self.with_discrepancy(none).residual(chosen).mean_square
        after = self.residual(chosen).mean_square
        left = after / np.maximum(before, 1e-300)
        return np.clip(1.0 - left, 0.0, 1.0)

    def _follow(self, joint: int, weights: Float[Array, " p"]) -> Float[Array, " m"]:
        """Weights of a joint's discrepancy where the other columns have theirs.

        −(ZᵀZ + V⁻¹)⁻¹ ZᵀX w, also for V = 0.

        Args:
            joint: Index of the joint.
            weights: w, of the joint's columns and the torque; those of its discrepancy are 0.
        """
        deviation = self._deviations(joint, self.components.discrepancy[joint])
        places = self.sums.evidence.layout.flexible_places[joint]
        whole = self.whole[joint]
        inner = deviation[:, None] * whole[np.ix_(places, places)] * deviation
        inner[np.diag_indices(len(inner))] += 1.0
        target = deviation * (whole[places] @ weights)
        solved = np.linalg.solve(inner, target)
        return np.asarray(-deviation * solved)

    def _power_of_blocks(self, joint: int, weights: Float[Array, " m"]) -> Float[Array, " b"]:
        """Whitened squares ζᵀ ZᵀZ ζ of each block's torque.

        Args:
            joint: Index of the joint.
            weights: ζ of its discrepancy.
        """
        groups = self.sums.evidence.layout.flexible[joint]
        places = self.sums.evidence.layout.flexible_places[joint]
        whole = self.whole[joint][np.ix_(places, places)]
        power = []
        start = 0
        for group in groups:
            block = slice(start, start + len(group.columns))
            of_block = weights[block]
            power.append(float(of_block @ whole[block, block] @ of_block))
            start = block.stop
        return np.array(power)

    def beside(self, joint: int, chosen: Sequence[Group]) -> Float[Array, "k k"]:
        """Sums of a joint's discrepancy columns and the torque after a set of effects.

        With A the sums of the model's columns (with their priors), B those between these and the
        joint's discrepancy Z and the torque y of all joints, and D those of Z and y,

            D − Bᵀ A⁻¹ B,    B = [XᵀZ  Xᵀy],    D = [ZᵀZ  Zᵀy; yᵀZ  yᵀy].

        Returns:
            D − Bᵀ A⁻¹ B with the torque last, shape (k, k), without negative eigenvalues.
        """
        prior = self.prior()
        inside, _ = self.information(chosen, prior)
        sums = self._with_discrepancy_of(joint, inside)
        width = len(inside)
        information = sums[:width, :width].copy()
        self._add_priors(information, chosen, prior)
        factor = factorise(information)
        across = sums[:width, width:]
        half = solve_triangular(factor, across, lower=True, check_finite=False)
        after = sums[width:, width:] - half.T @ half
        return without_negative_directions(after)

    def _with_discrepancy_of(self, joint: int, inside: Int[Array, " z"]) -> Float[Array, "z+k z+k"]:
        """Sums of some columns of `gram`, a joint's discrepancy and the torque, in this order.

        Other joints' discrepancies stay integrated out, that of this joint is not.

        Args:
            joint: Index of the joint.
            inside: Columns of `gram`, without the torque.
        """
        smooth = self.sums.evidence.layout.flexible_places[joint]
        whole = self.whole[joint]
        width = len(inside)
        size = width + len(smooth) + 1
        sums = np.zeros((size, size))
        in_gram = np.append(inside, self.last)
        in_sums = np.append(np.arange(width), size - 1)
        sums[np.ix_(in_sums, in_sums)] = self.gram[np.ix_(in_gram, in_gram)]
        # Which of the joint's columns are among them: their places in its rows, and here.
        place_of = dict(zip(in_gram.tolist(), in_sums.tolist(), strict=True))
        named, columns = self._named(joint)
        here = []
        there = []
        for place, column in zip(named.tolist(), columns.tolist(), strict=True):
            if column in place_of:
                here.append(place_of[column])
                there.append(place)
        change = whole - self.reduced[joint]
        sums[np.ix_(here, here)] += change[np.ix_(there, there)]
        between = np.arange(width, size - 1)
        sums[np.ix_(between, between)] = whole[np.ix_(smooth, smooth)]
        sums[np.ix_(between, here)] = whole[np.ix_(smooth, there)]
        sums[np.ix_(here, between)] = whole[np.ix_(there, smooth)]
        return sums
