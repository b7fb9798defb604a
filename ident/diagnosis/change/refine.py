"""A body that came or went, modelled once more with it in the model.

A first design takes a body's torque as it adds to that of the arm without it. Its load also makes gears rub more, and
its inertia is that of a point near the flange. With the body found carried by the runs that have it, a second one shows
what is still missing of it, and parameters are the sum of both. Gains that both sets share are left out of that design,
and whatever can pass for one: they would scale the body with the arm, and only a known mass could tell; a body is as
heavy as the readings are right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import CARRIED, COMMON_GAIN, IN_THE_BASELINE, MASS
from ident.diagnosis.change.laws import EvenLoadFriction
from ident.diagnosis.change.paired_design import PairedDesign, build_design
from ident.diagnosis.regression.design import Group
from ident.diagnosis.selection.intervals import Estimate
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel

# What both sets share of a gain, and what holds one; friction by load comes back as a law that holds none.


@dataclass(frozen=True, eq=False)
class Refinement:
    """What the second design sees."""

    design: PairedDesign  # the runs, the body carried
    groups: tuple[Group, ...]  # the named changes, in the order in which they were given
    added: tuple[Float[Array, " k"], ...]  # for each of them what of its coefficients is carried already


def refine_bodies(
    first: PairedDesign,
    estimates: Sequence[Estimate],
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
) -> Refinement | None:
    """A second design with the body carried; None where none was named.

    Args:
        first: The first design.
        estimates: The named changes as it saw them.
        before, after: The runs of both sets.
        arm: The user's arm.
    """
    body = next((one for one in estimates if one.group.effect.id == CARRIED), None)
    if body is None:
        return None
    mass = body.parameters[MASS].value
    x, y, z = (body.parameters[f"com_{axis}_m"].value for axis in "xyz")
    load = Payload(abs(mass), (x, y, z))
    if mass > 0.0:
        after = [_carrying(motion, load) for motion in after]
    else:
        before = [_carrying(motion, load) for motion in before]
    apart = IN_THE_BASELINE | COMMON_GAIN
    design = build_design(before, after, arm, apart, first.known, (EvenLoadFriction(),), first.asked, first.still)
    design = replace(design, doubt=first.doubt, seed=first.seed)
    groups = tuple(_same(first, design, one.group) for one in estimates)
    added = tuple(one.coefficients if one is body else np.zeros(len(one.coefficients)) for one in estimates)
    return Refinement(design, groups, added)


def _carrying(motion: Motion, load: Payload) -> Motion:
    """The same run with a further body at the flange."""
    known = motion.payload
    if known is None or known.mass_kg == 0.0:
        return replace(motion, payload=load)
    mass = known.mass_kg + load.mass_kg
    centre = (known.mass_kg * np.array(known.com_m) + load.mass_kg * np.array(load.com_m)) / mass
    return replace(motion, payload=Payload(mass, (float(centre[0]), float(centre[1]), float(centre[2]))))


def _same(first: PairedDesign, second: PairedDesign, group: Group) -> Group:
    """A change of the first design in the second: that of the same place among those of its name."""
    mates, others = (
        [one for one in each.sums.evidence.layout.groups if one.key == group.key] for each in (first, second)
    )
    return others[mates.index(group)]
