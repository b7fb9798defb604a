"""The gates that a name must pass, and what came of the candidates.

1. Its log evidence, in which blocks of time count as far as they agree, pays for its coefficients, its grid and its
   place, and leaves some nats beyond.
2. On held-out runs the log score gains, or the squared torque error falls, by more than one standard error, at the
   joints where the effect acts (what is open at others says nothing of it). At one of them the error falls by 2 %, and
   by a tenth of what lies above the noise.
3. It closes some share of the gap that there was before anything was named: less may be what is left of a cause whose
   law is not quite the catalogue's. Beside a cause of seven times its size no other is named at the same joint.

An effect that acts like wrong inertias (a payload, another link's mass, a scaled torque) is no gap at all once every
inertia may be tuned: the tuned model explains it, by changes that are too large to be believed. Such an effect is
judged by the evidence, in which the URDF's tolerances count, and its size against the URDF fixed. What happens once
no other run foretells: it must explain what its own blocks of time have beyond usual ones.
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
class Gates:
    """What an effect showed when it was tested."""

    log_score: tuple[float, float]  # gain on held-out runs [nats], and its standard error
    closed: tuple[float, float]  # fall of the squared error on held-out runs, as a share, and its standard error
    rms_fall: float  # largest share by which a joint's held-out error falls
    # Share that goes of the mean square above the noise that was left; of what happens once, of what the blocks of
    # time in which it does have beyond usual ones.
    gap_fall: float
    own_share: float  # share of its joint's gap that it closes, of what there was before anything was named
    evidence: float  # log evidence [nats]
    absorbed: bool  # whether tuning absorbs it, so that held-out runs can't judge it
    least_nats: float = USUAL_SELECTION.least_nats  # least evidence that it needs
    event: bool = False  # whether it happened once
    settings: SelectionSettings = USUAL_SELECTION  # what it is held to

    @property
    def passed(self) -> bool:
        if self.evidence < self.least_nats:
            return False
        if self.event:
            return self.gap_fall >= self.settings.event_gap_fall
        held = self.settings
        foretells = any(gain > error for gain, error in (self.log_score, self.closed))
        large = self.rms_fall >= held.least_rms_fall and self.gap_fall >= held.least_gap_fall
        return self.own_share >= held.least_own_share and (self.absorbed or (foretells and large))

    @property
    def beyond_chance(self) -> bool:
        """Whether chance alone would hardly have made it so good, passed or not."""
        held = self.settings
        nats = self.least_nats if self.event else held.unlikely_nats
        foretells = self.log_score[0] > 0.0 and self.rms_fall >= held.least_hint_fall
        return self.passed or (self.evidence >= nats and foretells)


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was judged, at its best inner parameters."""

    group: Group  # the effect
    gates: Gates  # how it did
    before: HeldOutScore  # held-out scores without and with it, in the view in which it was judged
    after: HeldOutScore
    absorbed: bool = False  # whether tuning the inertias hides it, so that it was judged with the URDF fixed

    @property
    def shown(self) -> list[int]:
        """Joints at which it shows: its own, or those where the error falls by at least a third of the most.

        What happens once may happen at rest, where no error in N m is counted: there the whitened misfit says it.
        """
        if self.group.effect.rows == "own":
            return [self.group.joint]
        once = self.group.effect.event
        fall = (self.before.misfit - self.after.misfit).sum(axis=0) if once else self.after.fall_from(self.before)
        return [int(j) for j in np.flatnonzero(fall >= max(fall.max() / 3, 1e-6))] or [int(np.argmax(fall))]


def first_of_each_joint(items: Iterable[tuple[T, Collection[int]]]) -> list[T]:
    """Those of some items, given with the joints where they act, that share no joint with an earlier one that is kept.

    What goes at one joint says nothing of another: so all joints are looked after in one round.
    """
    taken, kept = set[int](), list[T]()
    for item, joints in items:
        if taken.isdisjoint(joints):
            taken.update(joints)
            kept.append(item)
    return kept


@dataclass(frozen=True, eq=False)
class SearchResults:
    """What the search found."""

    named: tuple[Named, ...]  # the effects, in the order in which they were found
    ladder: tuple[HeldOutScore, ...]  # held-out scores of the baseline and after each named effect
    refused: Named | None  # the best candidate that did not pass, or whose name a rival took, and what it showed

    @property
    def hint(self) -> Named | None:
        """The best candidate that got no name, if chance alone would hardly have made it so good."""
        return self.refused if self.refused and self.refused.gates.beyond_chance else None
