"""The regression of two sets of runs: a shared baseline, and sums of every candidate change.

The baseline holds every law in all runs alike: hundreds of columns, of which short or slow
recordings determine only some. Without a prior the others would fit the noise, and predict unseen
runs badly: so each law's coefficients have a prior of their largest plausible size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.change.candidates import CHANGES, points
from ident.diagnosis.change.gain_uncertainty import STATED, GainUncertainty
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.learnt_prior import learn_prior, measure_block_dispersion
from ident.diagnosis.change.paired_sums import PairedSums, Sides, pair_sums, partition_sides
from ident.diagnosis.change.permuted_sets import PermutedSets
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.change.static_joints import StaticJoint
from ident.effects import optional
from ident.effects.base import Effect, SessionContext
from ident.effects.session_context import rated_torque
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.design import Grid, Group, NotTestable, find_grids, layout_of
from ident.regression.discrepancy import unusual_torque
from ident.regression.dwells import HeldFriction
from ident.regression.gather import gather
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.noise import Whitening
from ident.regression.run_spread import estimate_held, estimate_run_spread
from ident.regression.runs import build_session, leftover_torque
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class EarlierEstimates:
    """What an earlier design estimated."""

    # Between-run standard deviation of each joint's friction, as a share.
    spread: Float[Array, " n"]
    whitening: Whitening  # noise model
    held: tuple[float, ...]  # each joint's static friction [N m]
    dispersion: Float[Array, " n"]  # variance inflation of each joint's block scores
    finer: Sequence[Grid] = ()  # finer grids about the changes that were found with it


@dataclass(frozen=True, eq=False)
class PairedDesign:
    """Two sets of runs with a shared baseline."""

    baseline: Baseline  # tuned on the larger set
    session: SessionContext  # the runs of both sets
    sides: Sides  # the set of each run
    sums: PairedSums  # block sums of all columns
    held: tuple[float, ...]  # each joint's static friction [N m]
    untestable: tuple[NotTestable, ...]  # effects that cannot be tested in any of these runs
    gain_uncertainty: GainUncertainty = STATED  # prior of the gains
    effects: tuple[Effect, ...] = ()  # all effects that may have changed
    still: tuple[StaticJoint, ...] = ()  # joints that stand still in one of the sets
    seed: int = 0  # seed of the permutations of runs
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each set

    @property
    def estimates(self) -> EarlierEstimates:
        """The variances that a further design need not estimate again."""
        evidence = self.sums.evidence
        return EarlierEstimates(evidence.spread, evidence.whitening, self.held, evidence.dispersion)

    @cached_property
    def later_session(self) -> SessionContext:
        """The runs of the later set, in which changes act."""
        return _only_later(self.session, self.sides.later)

    @property
    def joints_with_rows(self) -> list[int]:
        """Indices of the joints that have rows in the regression."""
        return [int(j) for j in np.flatnonzero(self.sums.evidence.samples)]

    @cached_property
    def moves_once(self) -> Bool[Array, " n"]:
        """Which joints move in one run of either side at most: their between-run variance is
        unknown.
        """
        samples = np.array([run.motion.moving.sum(axis=0) for run in self.session.runs])
        moves = samples >= LEAST_MOVING
        runs_later = moves[self.sides.later].sum(axis=0)
        runs_earlier = moves[~self.sides.later].sum(axis=0)
        return np.maximum(runs_later, runs_earlier) <= 1

    @cached_property
    def permuted(self) -> PermutedSets:
        """Sums of the runs permuted between the two sets, by the design's seed."""
        return PermutedSets.of(self.sums, self.sides, self.seed)

    @cached_property
    def prior(self) -> Prior:
        """Prior with the estimated variances of the URDF's error and of the shared laws."""
        return _learnt_prior(self.sums, self.session, self.baseline)[0]


def loose_prior(sums: PairedSums, session: SessionContext, baseline: Baseline) -> Prior:
    """Prior with the largest plausible variances of the baseline's coefficients.

    Those of a law have the variance (`CHANGE.shared_laws` · size · scale)², the size its largest
    plausible one and the scale what its column was divided by.

    Args:
        sums: Block sums of all columns.
        session: The runs of both sets; sizes hang on their arm.
        baseline: Its prior of the base parameters is taken over.
    """
    layout = sums.evidence.layout
    scale = sums.evidence.scale
    largest = [_largest(group, session) for group in sums.common]
    sizes = np.concatenate([*largest, np.zeros(0)])
    std = CHANGE.shared_laws * sizes * scale[layout.tuned - layout.further : layout.tuned]
    return replace(Prior.of(sums.evidence, baseline.prior), further=1.0 / std**2)


def _learnt_prior(
    sums: PairedSums, session: SessionContext, baseline: Baseline
) -> tuple[Prior, Float[Array, " P"]]:
    """The prior with estimated variances, every change beside it, and the residual weights of its
    model.

    Args:
        sums: Block sums of all columns.
        session: The runs of both sets; sizes hang on their arm.
        baseline: Its prior is where the variances start.
    """
    scale = sums.evidence.scale
    later = []
    with_law = [group for group in sums.evidence.layout.groups if not group.borrows]
    for group in _first_points(with_law):
        size = CHANGE.shared_laws * _largest(group, session) * scale[group.columns]
        later.append((group.columns, size**-2.0))
    widths = [len(group.columns) for group in sums.common]
    return learn_prior(sums.evidence, loose_prior(sums, session, baseline), widths, later)


def build_design(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    earlier: EarlierEstimates | None = None,
    effects: tuple[Effect, ...] | None = None,
    one_clock: bool = True,
) -> PairedDesign:
    """Tunes the baseline and sums all columns over blocks.

    In this order: the baseline on the larger set, the columns of all changes, the sums over blocks
    with what holds and turns tell, static friction, friction's spread from run to run, and the
    dispersion that all of it leaves; each takes those before it as given.

    Args:
        before, after: The runs of both sets.
        arm: The user's arm.
        earlier: What an earlier design estimated; estimated here if None.
        effects: All effects that may have changed; the catalogue's if None.
        one_clock: Whether the clock continues from run to run of the later set.
    """
    # The larger set comes first, and the arm is tuned on it.
    swapped = len(after) > len(before)
    larger = after if swapped else before
    smaller = before if swapped else after
    motions = [replace(motion, state_noise=None) for motion in (*larger, *smaller)]
    is_later = (np.arange(len(motions)) >= len(larger)) ^ swapped
    baseline = fit_baseline(larger, arm, CHANGE.urdf_share, still=_still_joints(larger, arm))
    session = build_session(baseline, motions, common_clock=False)
    later_session = replace(_only_later(session, is_later), common_clock=one_clock)
    if effects is None:
        effects = _screened_changes(later_session)
    finer = () if earlier is None else earlier.finer
    untestable, grids = _all_grids(effects, session, later_session, finer)
    layout = layout_of(session, baseline.base.rank, grids, untestable)
    sides = partition_sides(session, is_later)
    evidence = gather(
        session,
        baseline,
        layout,
        None if earlier is None else earlier.whitening,
        sides.partition,
        alike=len(larger),
        rest=True,
    )
    finer_points = [point for _, _, of_grid in finer for point in of_grid]
    sums = pair_sums(evidence, sides, finer_points)
    if earlier is None:
        sums, held = _with_variances(sums, sides, session, baseline)
    else:
        held = earlier.held
        sums = _with_earlier(sums, earlier)
    return PairedDesign(
        baseline=baseline,
        session=session,
        sides=sides,
        sums=sums,
        held=held,
        untestable=tuple(untestable),
        effects=effects,
    )


def _all_grids(
    effects: Sequence[Effect],
    session: SessionContext,
    later_session: SessionContext,
    finer: Sequence[Grid],
) -> tuple[list[NotTestable], list[Grid]]:
    """Grids of all columns: of every change, of finer points, and of held friction, in this order.

    Args:
        effects: What may have changed.
        session: The runs of both sets.
        later_session: Those of the later set, in which some changes act alone.
        finer: Grids about changes that an earlier design has found.

    Returns:
        Effects that cannot be tested in any of these runs, and the grids.
    """

    def session_of(effect: Effect) -> SessionContext:
        return later_session if effect.as_change.later_alone else session

    untestable, grids = find_grids(effects, session_of, points)
    grids += finer
    _, of_held_friction = find_grids((HeldFriction(),), lambda _: session, points)
    grids += of_held_friction
    return untestable, grids


def _still_joints(motions: Sequence[Motion], arm: ArmModel) -> list[int]:
    """Joints that hardly move in some runs."""
    moving = sum(motion.moving.sum(axis=0) for motion in motions)
    return np.flatnonzero(moving < LEAST_MOVING).tolist()


def _only_later(session: SessionContext, later: Bool[Array, " R"]) -> SessionContext:
    """The runs of the later set alone."""
    pairs = zip(session.runs, later, strict=True)
    return replace(session, runs=[run for run, is_later in pairs if is_later])


def _screened_changes(later_session: SessionContext) -> tuple[Effect, ...]:
    """All effects that may have changed; those of the later set alone at unusual torque there."""
    unusual = unusual_torque(later_session, leftover_torque(later_session))
    effects = []
    for effect in CHANGES:
        if effect.as_change.later_alone:
            effects.append(optional.screened(effect, later_session, unusual))
        else:
            effects.append(effect)
    return tuple(effects)


def _with_earlier(sums: PairedSums, earlier: EarlierEstimates) -> PairedSums:
    """The sums with variances that an earlier design estimated."""
    evidence = sums.evidence.with_held(earlier.held).with_dwells()
    evidence = evidence.with_run_spread(earlier.spread)
    return replace(sums, evidence=evidence.with_dispersion(earlier.dispersion))


def _with_variances(
    sums: PairedSums, sides: Sides, session: SessionContext, baseline: Baseline
) -> tuple[PairedSums, tuple[float, ...]]:
    """The sums with all variances estimated, and each joint's static friction [N m].

    Static friction is first that of each joint's dwells, then what the model of all changes leaves
    of them; then come friction's spread over the runs and the dispersion of blocks.
    """
    by_dwells = tuple(dwell.friction for dwell in sums.evidence.dwells)
    without_dwells = sums.evidence.with_held(by_dwells)
    sums = replace(sums, evidence=without_dwells.with_dwells())
    prior = loose_prior(sums, session, baseline)
    held = estimate_held(sums.evidence, without_dwells.dwells, _with_all(sums, prior))
    sums = replace(sums, evidence=without_dwells.with_held(held).with_dwells())
    spread = _spread(sums, sides, prior)
    sums = replace(sums, evidence=sums.evidence.with_run_spread(spread))
    _, weights = _learnt_prior(sums, session, baseline)
    dispersion = measure_block_dispersion(sums.evidence, weights)
    return replace(sums, evidence=sums.evidence.with_dispersion(dispersion)), held


def _spread(sums: PairedSums, sides: Sides, prior: Prior) -> Float[Array, " n"]:
    """Between-run standard deviation of each joint's friction within either set, as a share.

    With a single run a side it cannot be estimated and is taken to be large.
    """
    wide = np.full(sums.evidence.layout.n, sums.evidence.settings.wide_spread)
    runs = len(sides.later)
    if runs <= 2:
        return wide
    model = _with_all(sums, prior)
    evidence = sums.evidence.with_run_spread(wide)
    of_one_session = estimate_run_spread(evidence, model.weights)
    # Each set has a mean of its own, which costs one more degree of freedom than a single session.
    spread = of_one_session * np.sqrt((runs - 1) / (runs - 2))
    return np.minimum(spread, wide)


def _with_all(sums: PairedSums, prior: Prior) -> Projection:
    """The model with every change that has a law, each at one grid point.

    Friction may vary much.
    """
    evidence = sums.evidence
    evidence = evidence.with_run_spread(np.full(evidence.layout.n, evidence.settings.wide_spread))
    changes = _first_points(evidence.layout.groups)
    free = [group for group in changes if group.effect.id != UNLISTED]
    return project(evidence.gram(), evidence, prior, free)


def _first_points(groups: Sequence[Group]) -> list[Group]:
    """The first point of each change's grid."""
    first = {group.key: group for group in reversed(groups)}
    return list(first.values())


def _largest(group: Group, session: SessionContext) -> Float[Array, " k"]:
    """Largest plausible size of a law's coefficients.

    The joint's rated torque if the law has no prior.
    """
    sizes = group.effect.prior_scale(session, group.joint, group.variant)
    if sizes is None:
        return np.full(len(group.columns), rated_torque(session, group.joint))
    return np.broadcast_to(sizes, len(group.columns))
