"""One estimate of all that is linear: base inertial parameters, rotor inertia, friction, offsets and named laws.

The regression is the diagnosis' own (`ident.regression`), with offsets and the laws that were given as further columns
of the model: whitened rows clear of reversals, friction that varies from run to run, the URDF as prior. What is said of
the parameters is the covariance of that model, as much wider as blocks of time vary more than it says.

Joints whose effort holds no friction: torque sensors behind the gear, or a model's torque.

Rows near reversals are left out of an estimate because dry friction there depends on what was before. Where there is
none, they are as good as any other, and in some recordings the larger half. Effort without dry friction is torque at
the link, to which neither viscous friction nor the rotor belongs: where the recordings agree, they are zero too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int
from ident.command_options import FitOptions
from ident.effects.base import Variant
from ident.effects.states_effect import StatesEffect
from ident.errors import RecordingError
from ident.laws.carried import NamedLaw
from ident.model.inertia import PRIOR_SHARE
from ident.model.linearisation import LEAST_MOVING, Sliding
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.design import LOSS_PARAMETERS, Grid, layout_of
from ident.regression.gram import Evidence, gather
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import estimate_run_spread, squares_left, worth_of_rows
from ident.regression.runs import build_session
from ident.robot.arm import ArmModel

# A joint with a smaller share of its moving samples clear of reversals is fitted where it moves at all.
LEAST_SETTLED = 0.1
# Weights are found anew so many times at the most.
PASSES = 3
# Robust weights: blocks whose residual is beyond this many medians of all blocks' lose their pull (Huber's k).
HUBER_KNEE = 1.345
# Least eigenvalue of the columns of a joint's friction, scaled to length one, at which they count as distinguished.
LEAST_PARTED = 1e-7


@dataclass(frozen=True, eq=False)
class FitSums:
    """One pass over the training runs: sums of all columns that a fit may ask for."""

    motions: Sequence[Motion]
    baseline: Baseline  # the arm near its URDF, about which laws by the load are linear
    evidence: Evidence  # the sums; its layout's groups are offsets, joint by joint, then laws
    options: FitOptions  # what is fitted
    laws: tuple[NamedLaw, ...]  # laws of joints whose coefficients are parameters, too
    through_reversals: tuple[str, ...]  # joints for which samples near reversals had to be used too

    @classmethod
    def gather(
        cls,
        motions: Sequence[Motion],
        nominal: ArmModel,
        options: FitOptions,
        laws: Sequence[NamedLaw] = (),
        widths: Float[Array, " n"] | None = None,
    ) -> FitSums:
        """Goes through the runs.

        Args:
            motions: Training runs; known payloads are part of the model.
            nominal: The arm as its URDF describes it.
            options: What is fitted.
            laws: Laws of joints.
            widths: Speed over which each joint's friction turns round [rad/s]; not at all if None.

        Raises:
            RecordingError: A joint hardly moves in any run, or its laws can't be told from plain friction.
        """
        share = PRIOR_SHARE.get(options.inertia, PRIOR_SHARE["consistent"])
        # Clear of reversals the direction is a plain sign unless runs left out say over which speed it turns round.
        speed = np.zeros(nominal.n) if widths is None else np.where(widths > TRANSITION_GRID[0], widths, 0.0)
        baseline = fit_baseline(motions, nominal, share, sliding=Sliding(np.zeros(nominal.n), speed))
        if widths is not None:
            baseline = replace(baseline, loss=replace(baseline.loss, transition_speed=widths))
        pairs = ((motion.moving.sum(axis=0), motion.settled.sum(axis=0)) for motion in motions)
        moving, settled = np.sum([*pairs], axis=0)
        few = np.asarray(settled < np.maximum(LEAST_MOVING, LEAST_SETTLED * moving))
        evidence = _sums(motions, baseline, options.offset == "on", laws, few)
        names = tuple(name for name, all_of_it in zip(nominal.joint_names, few, strict=True) if all_of_it)
        found = cls(motions, baseline, evidence, options, tuple(laws), names)
        found._require_parted()
        return found

    def through(self, joints: Bool[Array, " n"]) -> FitSums:
        """The same with all moving rows of some joints."""
        also = np.isin(self.baseline.nominal.joint_names, self.through_reversals)
        evidence = _sums(self.motions, self.baseline, self.options.offset == "on", self.laws, joints | also)
        return replace(self, evidence=evidence)

    def only(self, laws: Sequence[NamedLaw]) -> FitSums:
        """The same with some of the laws: no column is made anew."""
        first, layout = len(self.evidence.layout.groups) - len(self.laws), self.evidence.layout
        kept = [group for group, law in zip(layout.groups[first:], self.laws, strict=True) if law in laws]
        evidence = replace(self.evidence, layout=replace(layout, groups=(*layout.groups[:first], *kept)))
        return replace(self, evidence=evidence, laws=tuple(law for law in self.laws if law in laws))

    def _require_parted(self) -> None:
        """Raises RecordingError where the recordings can't tell a law from plain losses and the laws beside it."""
        layout, joints = self.evidence.layout, self.baseline.nominal.joint_names
        for joint in sorted({law.joint for law in self.laws}):
            own = [group.columns for group in layout.groups if group.joint == joint]
            losses = layout.rank + LOSS_PARAMETERS * joint + np.arange(LOSS_PARAMETERS)
            sums = self.evidence.gram()
            columns = np.concatenate([losses, *own])
            gram = sums[np.ix_(columns, columns)]
            size = np.sqrt(np.diag(gram))
            if np.any(size <= 0.0) or np.linalg.eigvalsh(gram / np.outer(size, size))[0] < LEAST_PARTED:
                laws = " and ".join(law.effect for law in self.laws if law.joint == joint)
                what = f"its motions can't tell {laws} of {joints[joint]} from plain friction or an offset"
                remedy = "fit without --with (or --offset), or record motions that show it"
                raise RecordingError(self.motions[0].name, what, remedy)


def _sums(
    motions: Sequence[Motion], baseline: Baseline, offset: bool, laws: Sequence[NamedLaw], through: Bool[Array, " n"]
) -> Evidence:
    session = build_session(baseline, motions, common_clock=False)
    grids: list[Grid] = [(StatesEffect(law.effect), law.joint, (Variant(shape=law.shape),)) for law in laws]
    if offset:
        from ident.effects.sensing import TorqueOffset

        grids = [(TorqueOffset(), joint, (Variant(),)) for joint in range(session.n)] + grids
    return gather(session, baseline, layout_of(session, baseline.base.rank, grids), through=through)


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """All parameters: r changes of base parameters, three losses a joint, offsets if any, coefficients of laws."""

    values: Float[Array, " m"]  # the parameters, shape (m,)
    covariance: Float[Array, "m m"]  # their covariance, shape (m, m)
    dof: Float[Array, " m"]  # degrees of freedom behind each standard deviation
    # Weighted normal equations of the data alone, without prior.
    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    noise: Float[Array, " n"]  # root mean square of what is left of each joint's torque, not whitened [N m]
    spread: Float[Array, " n"]  # relative spread of each joint's friction from run to run
    rank: int  # number r of base parameters
    offset: bool  # whether each joint has an offset

    @property
    def std(self) -> Float[Array, " m"]:
        return np.sqrt(np.diag(self.covariance))

    @property
    def per_joint(self) -> int:
        """Number of loss parameters a joint."""
        return LOSS_PARAMETERS + self.offset

    @property
    def first_law(self) -> int:
        """Where laws' coefficients begin."""
        return self.rank + len(self.noise) * self.per_joint

    def index(self, joint: int) -> Int[Array, " p"]:
        """Positions of a joint's loss parameters: rotor inertia, viscous and Coulomb friction, offset."""
        own = self.rank + LOSS_PARAMETERS * joint + np.arange(LOSS_PARAMETERS)
        return np.append(own, self.rank + LOSS_PARAMETERS * len(self.noise) + joint) if self.offset else own

    def without_inertias(self, prior: Float[Array, "r r"]) -> JointEstimate:
        """The losses' estimate with the inertias held at the URDF's, which may be off as far as the prior says."""
        rank = self.rank
        own = np.linalg.inv(self.information[rank:, rank:])
        values = np.concatenate([np.zeros(rank), own @ self.score[rank:]])
        through, off = own @ self.information[rank:, :rank], np.linalg.inv(prior)
        covariance = np.zeros_like(self.covariance)
        covariance[:rank, :rank] = off
        covariance[rank:, rank:] = own + through @ off @ through.T
        return replace(self, values=values, covariance=covariance)


def estimate(sums: FitSums) -> JointEstimate:
    """All linear parameters of an arm with their covariance, from one pass over the runs."""
    given, n = sums.evidence, sums.baseline.nominal.n
    evidence = given.with_run_spread(np.full(n, given.settings.wide_spread))
    for _ in range(PASSES):
        model = _solved(evidence, sums)
        spread = estimate_run_spread(evidence, model.weights)
        worth = worth_of_rows(evidence, model)
        weighted = given.weighted(_huber_weights(given, model)) if sums.options.robust else given
        evidence = weighted.with_run_spread(spread).with_dispersion(worth)
    model, layout = _solved(evidence, sums), evidence.layout
    scale, inside = evidence.scale[model.inside], model.inside
    gram = evidence.gram()
    blocks, stretches = int(np.sum(evidence.rows.any(axis=1))), len(np.unique(evidence.friction.stretch))
    # Friction is known by as many repeats as there are runs, or stretches of long ones, all else by blocks.
    dof = np.full(len(inside), max(1.0, blocks - len(inside) / n))
    friction = layout.rank + LOSS_PARAMETERS * np.arange(n)[:, None] + np.arange(1, LOSS_PARAMETERS)
    dof[friction] = np.minimum(dof[friction], stretches - 1.0 + evidence.settings.usual_runs)
    return JointEstimate(
        values=model.estimate / scale,
        covariance=model.spread / np.outer(scale, scale),
        dof=dof,
        information=gram[np.ix_(inside, inside)] * np.outer(scale, scale),
        score=gram[inside, -1] * scale,
        noise=_plain_error(evidence, model.weights),
        spread=evidence.spread,
        rank=layout.rank,
        offset=sums.options.offset == "on",
    )


def _plain_error(evidence: Evidence, weights: Float[Array, " P"]) -> Float[Array, " n"]:
    """Root mean square of what a model leaves of each joint's torque [N m]."""
    squares = np.zeros(evidence.layout.n)
    for j, local in enumerate(evidence.layout.local):
        own = weights[local]
        squares[j] = own @ evidence.plain[j].over() @ own / max(float(evidence.weights[:, j].sum()), 1.0)
    return np.sqrt(np.maximum(squares, 0.0))


def _solved(evidence: Evidence, sums: FitSums) -> Projection:
    """The model of losses, inertias near the URDF's, offsets and laws; bounds come afterwards."""
    prior = Prior.of(evidence, sums.baseline.prior)
    return project(evidence.gram(), evidence, prior, evidence.layout.groups, signed=False)


def _huber_weights(evidence: Evidence, model: Projection) -> Float[Array, "B n"]:
    """Weight of each block and joint: one, or less where a model leaves more than is usual; friction's own level, too.

    Args:
        evidence: Sums in which friction is the same in all runs.
        model: The model.
    """
    mean = np.sqrt(np.maximum(squares_left(evidence, model).T, 0.0) / np.maximum(evidence.rows, 1e-9))
    mean = np.where(evidence.rows > 0.0, mean, np.nan)
    usual = np.nan_to_num(np.nanmedian(mean, axis=0), nan=1.0)
    return np.minimum(1.0, HUBER_KNEE * usual / np.maximum(np.nan_to_num(mean), 1e-12))


def quantile(dof: Float[Array, "..."], level: float = 0.95) -> Float[Array, "..."]:
    """Half width of an interval in standard deviations, by Student's t."""
    return np.asarray(stdtrit(np.minimum(dof, 1e6), 0.5 + level / 2))


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
