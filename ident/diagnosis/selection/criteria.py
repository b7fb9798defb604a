"""Acceptance criteria of a candidate effect, and the result records of the search.

A candidate is accepted if all of these hold:

1. Its log evidence, in which its coefficients, grid points and joints have their cost, exceeds a threshold.
2. On held-out runs the log score rises, or the squared torque error falls, by more than one standard error at the
   joints where the effect acts. At one of them the RMS error falls by 2 %, and its excess over the noise by a tenth.
3. It closes a least share of the joint's initial gap. No real law is exactly the catalogue's: a cause leaves a residual
   of up to 15 % of its torque, which must not be accepted as a second effect.

Inertia-like effects (payload, link inertia, torque gain) are absorbed by tuned inertias, so held-out error does not
show them: they need the log evidence, in which the URDF's prior counts, and their size is measured with the URDF's
inertias fixed. No other run predicts an event: it must explain the excess of its own blocks over usual ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.regression.cross_validation import HeldOutScore
from ident.regression.design import Group

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class AcceptanceCriteria:
    """Measured values of the acceptance criteria of one candidate."""

    log_score: tuple[float, float]  # gain on held-out runs [nats], and its standard error
    closed: tuple[float, float]  # fall of the squared error on held-out runs, as a share, and its standard error
    rms_fall: float  # largest share by which a joint's held-out error falls
    # Share of the remaining mean square above noise that it closes; of an event, of its blocks' excess over usual ones.
    gap_fall: float
    initial_gap_share: float  # share of the joint's gap before any effect was accepted that it closes
    log_evidence: float  # what it adds to the model's log evidence [nats]
    absorbed: bool  # whether tuned inertias absorb it, so that held-out error does not show it
    required_log_evidence: float = USUAL_SELECTION.least_nats  # threshold of the log evidence [nats]
    event: bool = False  # whether the effect occurs once and not throughout
    settings: SelectionSettings = USUAL_SELECTION  # thresholds of the other criteria

    @property
    def passed(self) -> bool:
        """Whether the candidate meets all criteria."""
        if self.log_evidence < self.required_log_evidence:
            return False
        if self.event:
            return self.gap_fall >= self.settings.event_gap_fall
        settings = self.settings
        predicts = any(gain > error for gain, error in (self.log_score, self.closed))
        large = self.rms_fall >= settings.least_rms_fall and self.gap_fall >= settings.least_gap_fall
        return self.initial_gap_share >= settings.least_own_share and (self.absorbed or (predicts and large))


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A candidate with its acceptance criteria, at its best grid point."""

    group: Group  # the effect and its columns
    criteria: AcceptanceCriteria  # measured values
    before: HeldOutScore  # held-out score without it; with the URDF's inertias fixed if it is absorbed
    after: HeldOutScore  # the same with it
    absorbed: bool = False  # whether tuned inertias absorb it, so that it was evaluated with the URDF's inertias fixed

    @property
    def affected_joints(self) -> list[int]:
        """Its own joint, or all joints where the held-out error falls by at least a third of the largest fall.

        Events may occur at rest, where torque error is not counted: there the whitened misfit is used.
        """
        if self.group.effect.rows == "own":
            return [self.group.joint]
        event = self.group.effect.event
        fall = (self.before.misfit - self.after.misfit).sum(axis=0) if event else self.after.fall_from(self.before)
        return [int(j) for j in np.flatnonzero(fall >= max(fall.max() / 3, 1e-6))] or [int(np.argmax(fall))]

    @property
    def named_joints(self) -> list[int]:
        """Where it is named: at its own joint, or of the whole arm where it closes a share of the mean square."""
        if self.group.effect.scope == "joint":
            return [self.group.joint]
        closed = 1.0 - (1.0 - self.after.fall_from(self.before)) ** 2
        shown = np.flatnonzero(closed >= self.criteria.settings.least_gap_fall)
        return sorted({*self.affected_joints, *map(int, shown)})


def first_of_each_joint(items: Iterable[tuple[T, Collection[int]]]) -> list[T]:
    """The items, in order, that share no joint with an item taken before: they can be changed in one round.

    Args:
        items: Items with the joints where each acts.
    """
    taken, kept = set[int](), list[T]()
    for item, joints in items:
        if taken.isdisjoint(joints):
            taken.update(joints)
            kept.append(item)
    return kept


@dataclass(frozen=True, eq=False)
class SearchResults:
    """Accepted effects of a search."""

    accepted: tuple[Evaluated, ...]  # in the order in which they were accepted
    ladder: tuple[HeldOutScore, ...]  # held-out scores of the baseline and after each accepted effect
