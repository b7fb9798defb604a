"""One look at two sets of runs: the shared baseline, and the sums of every change that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import IN_THE_BASELINE, changes, points
from ident.diagnosis.change.common_laws import common_information
from ident.diagnosis.change.readings import STATED, GainDoubt
from ident.diagnosis.change.still_joints import StillJoint, silent_of
from ident.diagnosis.change.switched import Sides, Switched, cut, switch
from ident.diagnosis.regression.baseline import Baseline, fit_baseline
from ident.diagnosis.regression.design import NotTestable, layout_of
from ident.diagnosis.regression.gram import Evidence, gather
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.regression.noise import Whitening
from ident.diagnosis.regression.run_spread import estimate_run_spread
from ident.diagnosis.regression.runs import build_session
from ident.effects.base import Effect, SessionContext, Variant
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Standard deviation of a URDF's numbers, as a share of each link's own: two sets of recordings need no good one.
LOOSE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Known:
    """What an earlier look found.

    Attributes:
        spread: Friction's variation from run to run.
        whitening: The noise.
    """

    spread: Float[Array, " n"]
    whitening: Whitening


@dataclass(frozen=True, eq=False)
class SharedLook:
    """Two sets of runs, seen through one baseline.

    Attributes:
        baseline: Tuned on the larger set.
        session: The runs of both sets.
        sides: Which runs are of which set.
        switched: The sums.
        silent: What can't be seen in any of these runs.
        doubt: How well the gains are known.
        asked: All that may have changed.
        still: Joints of whose own torque nothing is told.
    """

    baseline: Baseline
    session: SessionContext
    sides: Sides
    switched: Switched
    silent: tuple[NotTestable, ...]
    doubt: GainDoubt = STATED
    asked: tuple[Effect, ...] = ()
    still: tuple[StillJoint, ...] = ()

    @property
    def known(self) -> Known:
        """What a further look need not find again."""
        return Known(self.switched.evidence.spread, self.switched.evidence.whitening)

    @property
    def judged(self) -> list[int]:
        """Joints whose own torque counts."""
        at_rest = {one.joint for one in self.still}
        return [j for j in range(self.session.n) if j not in at_rest]

    @cached_property
    def prior(self) -> Prior:
        """The loose belief in the URDF, and how large the laws may be that both sets share."""
        return loose_prior(self.switched, self.session, self.baseline)


def loose_prior(switched: Switched, session: SessionContext, baseline: Baseline) -> Prior:
    """What is known of the baseline beforehand."""
    prior = Prior.of(switched.evidence, baseline.prior)
    return replace(prior, further=common_information(switched, session))


def look_at(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    apart: frozenset[str] = IN_THE_BASELINE,
    known: Known | None = None,
    shared: tuple[Effect, ...] = (),
    asked: tuple[Effect, ...] | None = None,
    still: tuple[StillJoint, ...] = (),
) -> SharedLook:
    """Tunes the baseline and sums all columns.

    Args:
        before, after: The runs of both sets.
        arm: The user's arm.
        apart: Effects that are not part of the baseline.
        known: What an earlier look found, if there was one.
        shared: Further effects of the baseline, that are not asked for as changes.
        asked: All that may have changed; the catalogue's if None.
        still: Joints of whose own torque nothing is told.
    """
    asked = changes() if asked is None else asked
    swapped = len(after) > len(before)
    first, second = (after, before) if swapped else (before, after)
    at_rest = {one.joint for one in still}
    first, second = ([motion.with_still(at_rest) for motion in side] for side in (first, second))
    motions = [*first, *second]
    later = (np.arange(len(motions)) >= len(first)) ^ swapped
    baseline = fit_baseline(first, arm, LOOSE_SHARE, still=at_rest)
    session = build_session(baseline, motions, common_clock=False)
    silent, grids = _grids(session, (*asked, *shared), still)
    layout = layout_of(session, baseline.base.rank, grids, silent)
    sides = cut(session, later)
    whitening = None if known is None else known.whitening
    sums = gather(session, baseline, layout, whitening, sides.partition, alike=len(first))
    switched = switch(sums, sides, apart, frozenset(effect.id for effect in shared))
    if known is not None:
        spread = known.spread
    elif enough(switched.evidence):
        spread = _spread(switched, sides, loose_prior(switched, session, baseline))
    else:
        spread = np.full(layout.n, switched.evidence.settings.wide_spread)
    switched = replace(switched, evidence=switched.evidence.with_run_spread(spread))
    return SharedLook(baseline, session, sides, switched, tuple(silent), asked=asked, still=still)


def enough(evidence: Evidence) -> bool:
    """Whether there are more samples than the baseline has figures; else nothing is known, least of all the noise."""
    return bool(evidence.samples.sum() > evidence.layout.tuned)


def _grids(
    session: SessionContext, effects: Sequence[Effect], still: Sequence[StillJoint]
) -> tuple[list[NotTestable], list[tuple[Effect, int, Sequence[Variant]]]]:
    """Every effect at every joint with its points, and what can't be seen."""
    silent = silent_of(still, effects)
    at_rest = {(one.effect.id, one.joint) for one in silent}
    grids: list[tuple[Effect, int, Sequence[Variant]]] = []
    for effect in effects:
        asked = effect.asked(session)
        for joint in range(session.n if effect.scope == "joint" else 1):
            if (effect.id, joint) in at_rest:
                continue
            if reason := effect.untestable(asked, joint):
                silent.append(NotTestable(effect, joint, reason))
            else:
                grids.append((effect, joint, points(effect, session, joint)))
    return silent, grids


def _spread(switched: Switched, sides: Sides, prior: Prior) -> Float[Array, " n"]:
    """By how much friction varies from run to run of either set, whatever changed between them.

    Of a single run a side nobody knows: then it is taken to vary much.
    """
    wide = np.full(switched.evidence.layout.n, switched.evidence.settings.wide_spread)
    runs = len(sides.later)
    if runs <= 2:
        return wide
    evidence = switched.evidence.with_run_spread(wide)
    first = {group.key: group for group in reversed(evidence.layout.groups)}
    free = [group for group in first.values() if group.effect.id != "unlisted_change"]
    model = project(evidence.gram(), evidence, prior, free)
    # Each set has its own level: one degree of freedom more than a lone session takes.
    found = estimate_run_spread(evidence, model) * np.sqrt((runs - 1) / (runs - 2))
    return np.minimum(found, wide)
