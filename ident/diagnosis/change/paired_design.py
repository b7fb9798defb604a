"""Two sets of runs in one regression: the baseline that both share, and the sums of every change that is tested.

The baseline holds every law in all runs alike, hundreds of columns, of which short or slow recordings tell a part. With
nothing known of the rest it takes any size, passes through every sample, and runs away on those that it has not seen:
so each law's coefficients have a prior of their largest plausible size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.change.candidates import CHANGES, LATER_ALONE, points
from ident.diagnosis.change.gain_uncertainty import STATED, GainUncertainty
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.learnt_prior import learn_prior, measure_block_dispersion
from ident.diagnosis.change.paired_sums import PairedSums, Sides, pair_sums, partition_sides
from ident.diagnosis.change.permuted_sets import PermutedSets
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.change.static_joints import StaticJoint
from ident.diagnosis.regression.baseline import Baseline, fit_baseline
from ident.diagnosis.regression.design import Group, NotTestable, find_grids, layout_of
from ident.diagnosis.regression.dwells import HeldFriction
from ident.diagnosis.regression.gram import gather
from ident.diagnosis.regression.least_squares import Prior, Projection, project
from ident.diagnosis.regression.noise import Whitening
from ident.diagnosis.regression.run_spread import estimate_held, estimate_run_spread
from ident.diagnosis.regression.runs import build_session, leftover_torque
from ident.effects.base import Effect, SessionContext
from ident.effects.session_context import rated_torque
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class EarlierEstimates:
    """What an earlier design found."""

    spread: Float[Array, " n"]  # friction's variation from run to run
    whitening: Whitening  # the noise
    held: tuple[float, ...]  # each joint's level of static friction [N m]
    dispersion: Float[Array, " n"]  # by how much each joint's blocks vary more than whitened noise


@dataclass(frozen=True, eq=False)
class PairedDesign:
    """Two sets of runs, seen through one baseline."""

    baseline: Baseline  # tuned on the larger set
    session: SessionContext  # the runs of both sets
    sides: Sides  # which runs are of which set
    sums: PairedSums  # the sums
    held: tuple[float, ...]  # each joint's level of static friction [N m]
    silent: tuple[NotTestable, ...]  # what can't be seen in any of these runs
    gain_uncertainty: GainUncertainty = STATED  # how well the gains are known
    effects: tuple[Effect, ...] = ()  # all that may have changed
    still: tuple[StaticJoint, ...] = ()  # joints of whose own torque nothing is known
    seed: int = 0  # of how runs are dealt into sets that are none

    @property
    def estimates(self) -> EarlierEstimates:
        """What a further design need not find again."""
        evidence = self.sums.evidence
        return EarlierEstimates(evidence.spread, evidence.whitening, self.held, evidence.dispersion)

    @cached_property
    def later_session(self) -> SessionContext:
        """The runs of the later set, in which what changed acts."""
        runs = [run for run, is_later in zip(self.session.runs, self.sides.later, strict=True) if is_later]
        return replace(self.session, runs=runs)

    @property
    def joints_with_rows(self) -> list[int]:
        """Joints of which there are rows."""
        return [int(j) for j in np.flatnonzero(self.sums.evidence.samples)]

    @cached_property
    def moves_once(self) -> Bool[Array, " n"]:
        """Which joints move in one run of either side at most: what their friction differs by is not known."""
        moves = np.array([run.motion.moving.sum(axis=0) >= LEAST_MOVING for run in self.session.runs])
        return np.maximum(moves[self.sides.later].sum(axis=0), moves[~self.sides.later].sum(axis=0)) <= 1

    @cached_property
    def permuted(self) -> PermutedSets:
        """The runs, dealt into other sets."""
        return PermutedSets.of(self.sums, self.sides, self.seed)

    @cached_property
    def prior(self) -> Prior:
        """How far off the URDF is, and how large the laws are that both sets share, as these runs show it."""
        return _learnt_prior(self.sums, self.session, self.baseline)[0]


def loose_prior(sums: PairedSums, session: SessionContext, baseline: Baseline) -> Prior:
    """What is known of the baseline beforehand."""
    layout, scale = sums.evidence.layout, sums.evidence.scale
    sizes = np.concatenate([*(_largest(group, session) for group in sums.common), np.zeros(0)])
    std = CHANGE.shared_laws * sizes * scale[layout.tuned - layout.further : layout.tuned]
    return replace(Prior.of(sums.evidence, baseline.prior), further=1.0 / std**2)


def _learnt_prior(sums: PairedSums, session: SessionContext, baseline: Baseline) -> tuple[Prior, Float[Array, " P"]]:
    """The prior that the recordings support, every change beside it, and the weights of what is then left."""
    scale = sums.evidence.scale
    first = {group.key: group for group in reversed(sums.evidence.layout.groups) if not group.borrows}
    sizes = [CHANGE.shared_laws * _largest(one, session) * scale[one.columns] for one in first.values()]
    later = [(one.columns, size**-2.0) for one, size in zip(first.values(), sizes, strict=True)]
    widths = [len(group.columns) for group in sums.common]
    return learn_prior(sums.evidence, loose_prior(sums, session, baseline), widths, later)


def build_design(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    earlier: EarlierEstimates | None = None,
    effects: tuple[Effect, ...] | None = None,
    still: tuple[StaticJoint, ...] = (),
    one_clock: bool = True,
) -> PairedDesign:
    """Tunes the baseline and sums all columns.

    Args:
        before, after: The runs of both sets.
        arm: The user's arm.
        known: What an earlier design found, if there was one.
        asked: All that may have changed; the catalogue's if None.
        still: Joints of whose own torque nothing is known.
        one_clock: Whether time goes on from run to run of the later set.
    """
    swapped = len(after) > len(before)
    first, second = (after, before) if swapped else (before, after)
    at_rest = [j for j in range(arm.n) if sum(motion.moving[:, j].sum() for motion in first) < LEAST_MOVING]
    motions = [*first, *second]
    later = (np.arange(len(motions)) >= len(first)) ^ swapped
    baseline = fit_baseline(first, arm, CHANGE.urdf_share, still=at_rest)
    session = build_session(baseline, motions, common_clock=False)
    own = replace(session, runs=[run for run, is_later in zip(session.runs, later, strict=True) if is_later])
    own = replace(own, common_clock=one_clock)
    if effects is None:
        left = leftover_torque(own)
        effects = tuple(one.screened(own, left) if one.id in LATER_ALONE else one for one in CHANGES)
    silent, grids = find_grids(effects, lambda effect: own if effect.id in LATER_ALONE else session, points)
    grids += find_grids((HeldFriction(),), lambda _: session, points)[1]
    layout = layout_of(session, baseline.base.rank, grids, silent)
    sides = partition_sides(session, later)
    whitening = None if earlier is None else earlier.whitening
    both = gather(session, baseline, layout, whitening, sides.partition, alike=len(first), rest=True)
    sums = pair_sums(both, sides)
    held = earlier.held if earlier else tuple(one.friction for one in sums.evidence.dwells)
    evidence = sums.evidence.with_held(held)
    sums = replace(sums, evidence=evidence.with_dwells())
    prior = loose_prior(sums, session, baseline)
    if earlier is not None:
        spread = earlier.spread
    else:
        held = estimate_held(sums.evidence, evidence.dwells, _with_all(sums, prior))
        sums = replace(sums, evidence=evidence.with_held(held).with_dwells())
        spread = _spread(sums, sides, prior)
    sums = replace(sums, evidence=sums.evidence.with_run_spread(spread))
    dispersion = (
        earlier.dispersion
        if earlier
        else measure_block_dispersion(sums.evidence, _learnt_prior(sums, session, baseline)[1])
    )
    sums = replace(sums, evidence=sums.evidence.with_dispersion(dispersion))
    return PairedDesign(baseline, session, sides, sums, held, tuple(silent), effects=effects, still=still)


def _spread(sums: PairedSums, sides: Sides, prior: Prior) -> Float[Array, " n"]:
    """By how much friction varies from run to run of either set, whatever changed between them.

    Of a single run a side nobody knows: then it is taken to vary much.
    """
    wide = np.full(sums.evidence.layout.n, sums.evidence.settings.wide_spread)
    runs = len(sides.later)
    if runs <= 2:
        return wide
    model = _with_all(sums, prior)
    # Each set has its own level: one degree of freedom more than a lone session takes.
    evidence = sums.evidence.with_run_spread(wide)
    found = estimate_run_spread(evidence, model) * np.sqrt((runs - 1) / (runs - 2))
    return np.minimum(found, wide)


def _with_all(sums: PairedSums, prior: Prior) -> Projection:
    """A model with every change that has a law, each at one point of its grid; friction may vary much."""
    evidence = sums.evidence
    evidence = evidence.with_run_spread(np.full(evidence.layout.n, evidence.settings.wide_spread))
    first = {group.key: group for group in reversed(evidence.layout.groups)}
    free = [group for group in first.values() if group.effect.id != UNLISTED]
    return project(evidence.gram(), evidence, prior, free)


def _largest(group: Group, session: SessionContext) -> Float[Array, " k"]:
    """Largest plausible size of a law's coefficients; of one of which nothing is known, what its joint can give."""
    sizes = group.effect.prior_scale(group.effect.asked(session), group.joint, group.variant)
    if sizes is None:
        return np.full(len(group.columns), rated_torque(session, group.joint))
    return np.broadcast_to(sizes, len(group.columns))
