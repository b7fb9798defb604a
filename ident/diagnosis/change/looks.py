"""Two looks for what changed: on coarse grids of every law, then on fine ones about the changes.

Bodies are laid out anew about the place at which they were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ident.diagnosis.change.body_places import place_bodies
from ident.diagnosis.change.candidates import CARRIED, OF_FRICTION, finer_grids
from ident.diagnosis.change.change_sets import ChangeSet, choose_set
from ident.diagnosis.change.gain_uncertainty import BODIES, STATED, GainUncertainty
from ident.diagnosis.change.paired_design import EarlierEstimates, PairedDesign, build_design
from ident.diagnosis.change.static_joints import StaticJoint
from ident.effects.base import Effect
from ident.effects.rigid_body import LinkInertialError
from ident.motion.motion import Motion
from ident.regression.design import Key
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class TwoSets:
    """Two sets of runs of one arm."""

    before: Sequence[Motion]
    after: Sequence[Motion]
    arm: ArmModel  # the user's, without payload
    still: tuple[StaticJoint, ...] = ()  # joints that stand still in one of the sets
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each set
    gain_uncertainty: GainUncertainty = STATED  # prior of the gains
    seed: int = 0  # seed of the permutations of runs

    def design(
        self, earlier: EarlierEstimates | None = None, effects: tuple[Effect, ...] | None = None
    ) -> PairedDesign:
        """The regression of both sets.

        Args:
            earlier, effects: As `build_design` takes them.
        """
        one_clock = self.sessions[1] <= 1
        design = build_design(self.before, self.after, self.arm, earlier, effects, one_clock)
        return replace(
            design,
            still=self.still,
            gain_uncertainty=self.gain_uncertainty,
            seed=self.seed,
            sessions=self.sessions,
        )


def look_twice(sets: TwoSets, design: PairedDesign) -> ChangeSet:
    """The likeliest set of changes on fine grids.

    Args:
        sets: Both sets of runs.
        design: Their regression on coarse grids.
    """
    first = choose_set(design, hidden_changes(design))
    bodies = [group for group in first.chosen if group.effect.id in BODIES]
    finer = finer_grids(first.chosen, design.session, design.later_session)
    if not bodies and not finer:
        return first
    effects = design.effects
    if bodies:
        others = [group for group in first.chosen if group not in bodies]
        effects = place_bodies(first.search, others, design.session, effects)
    second = sets.design(replace(design.estimates, finer=finer), effects)
    return choose_set(second, hidden_changes(second), first.odds)


def hidden_changes(design: PairedDesign) -> frozenset[Key]:
    """Changes that these two sets can't show.

    Laws of friction at joints that move in one run a side at most, for how much it differs from run
    to run is open; and an error of the last link, where a load may have changed: between two sets
    of one arm it is one.
    """
    once = design.moves_once
    groups = design.sums.evidence.layout.groups
    of_friction = [group for group in groups if group.effect.id in OF_FRICTION]
    keys = {group.key for group in of_friction if once[group.joint]}
    if any(group.effect.id == CARRIED for group in groups):
        last = len(once) - 1
        of_links = [group for group in groups if group.effect.id == LinkInertialError.id]
        keys |= {group.key for group in of_links if group.joint == last}
    return frozenset(keys)
