"""Where the gap lies, in order of harm: the joints by torque beyond their noise, and of each the cells that stand out.

Joints whose whole torque is off by a factor come before all others: every size that is found there is off by it, too.

A joint's harm is what its model errs by beyond noise, √(rms² − noise²) N m: of the tuned model and the one with the
URDF fixed, that which errs less, for what tuning to another joint's gap makes worse is no gap of this one. What tuning
hides of a cause that is reported is added, up to the error of the one that errs more: of a name that it absorbs, what
the name explains; of inertias beyond the URDF's tolerance, what only they do; of a torque that is off by a factor, for
which other masses make up, all. Joints without a gap have no place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Float
from ident.diagnosis.gap.gap_map import Place, View, says_where
from ident.diagnosis.gap.settings import USUAL_MAP, MapSettings


@dataclass(frozen=True)
class Harm:
    """What a joint's model errs by beyond noise."""

    torque: float  # root mean square beyond noise [N m]
    view: View = "before"  # the model: `before` for the tuned one, `fixed` for that with the URDF fixed


@dataclass(frozen=True)
class NamedPlace:
    """Where a cause acts that is reported: a name, or a torque that is off by a factor."""

    joints: tuple[str, ...]  # the joints that it is reported of
    hides: Mapping[str, float]  # by joint where it shows, the torque of it that tuning hides [N m]
    is_factor: bool = False  # whether it is a factor of the whole torque


def measure_harm(
    joints: Sequence[str],
    errors: Mapping[View, Float[np.ndarray, " n"]],
    tuned_away: Float[np.ndarray, " n"],
    noise: Float[np.ndarray, " n"],
    names: Sequence[NamedPlace],
    loud: float,
) -> dict[str, Harm]:
    """Harm of every joint that has a gap, in order of harm; first that of joints whose torque is off by a factor.

    Args:
        joints, noise: Their names, and noise floors [N m].
        errors: Held-out error of the tuned model, and of the model with the URDF fixed [N m].
        tuned_away: What only inertias beyond the URDF's tolerance explain [N m].
        names: Where what is reported acts.
        loud: Error over noise from which on a joint of which nothing is reported has a gap.
    """
    found: dict[str, Harm] = {}
    for j, joint in enumerate(joints):
        own = [one for one in names if joint in (*one.joints, *one.hides)]
        less, more = sorted(errors, key=lambda view: float(errors[view][j]))
        hidden = max([one.hides.get(joint, 0.0) for one in own], default=0.0)
        hidden = max(hidden, tuned_away[j] if tuned_away[j] > noise[j] else 0.0)
        error = min(float(np.hypot(errors[less][j], hidden)), float(errors[more][j]))
        if error > (1.0 if own else loud) * noise[j]:
            beyond = error**2 - noise[j] ** 2
            found[joint] = Harm(float(np.sqrt(beyond)), more if 2.0 * hidden**2 > beyond else less)
    off = {joint for one in names if one.is_factor for joint in one.joints}
    return dict(sorted(found.items(), key=lambda one: (one[0] not in off, -one[1].torque)))


def rank_places(
    maps: Mapping[View, Sequence[Place]], harm: Mapping[str, Harm], settings: MapSettings = USUAL_MAP
) -> tuple[Place, ...]:
    """The cells that stand out, joint by joint in the order of `harm`; of a joint the richest first, one an axis.

    A cell stands out where it is denser in gap than in time by a factor, and by more than chance. A joint whose gap is
    spread evenly has its densest cell alone.
    """
    found: list[Place] = []
    for joint, one in harm.items():
        cells = [place for place in maps[one.view] if place.joint == joint and place.density > 1.0]
        cells = [place for place in cells if says_where(place.axis, place.low)]
        sure = [p for p in cells if p.p_value <= settings.significant and p.density >= settings.least_density]
        sure.sort(key=lambda p: (p.axis == "frequency", p.share_of_time - p.share_of_gap))
        best = {place.axis: place for place in reversed(sure)}
        chosen = [place for place in sure if best[place.axis] is place][: settings.places_each]
        chosen = chosen or sorted(cells, key=lambda p: (p.axis == "frequency", -p.density))[:1]
        found += [replace(place, beyond_noise_Nm=one.torque) for place in chosen]
    return tuple(found[: settings.places_told])
