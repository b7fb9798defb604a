"""Ranks the map's cells: joints by their error beyond noise, and of each joint the cells that stand out.

Joints whose whole torque is wrong by a factor come first, for every size that is estimated there is wrong by it, too.

A joint's error beyond noise is √(rms² − noise²) N m. Of the tuned model and the one with the URDF's inertias fixed the
smaller error counts, for tuning may raise the error of one joint to lower another's. To it is added the torque that
tuning hides of a reported cause, up to the larger error: that of an absorbed effect, of inertias beyond the URDF's
tolerance, or all of a torque that is wrong by a factor. Joints without a gap are not ranked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Float
from ident.diagnosis.gap.gap_map import Place, View, says_where
from ident.diagnosis.gap.settings import USUAL_MAP, MapSettings


@dataclass(frozen=True)
class ExcessError:
    """Error of a joint beyond its noise."""

    torque: float  # root mean square beyond noise [N m]
    view: View = "before"  # the model: `before` for the tuned one, `fixed` for that with the URDF's inertias fixed


@dataclass(frozen=True)
class ReportedCause:
    """What is reported of a gap: a finding, a torque that is wrong by a factor, or that no name explains it."""

    joints: tuple[str, ...]  # joints for which it is reported
    hidden_torque: Mapping[str, float]  # torque of it that tuning hides, by affected joint [N m]
    is_factor: bool = False  # whether it scales the whole torque


def measure_excess_errors(
    joints: Sequence[str],
    errors: Mapping[View, Float[np.ndarray, " n"]],
    tuned_away: Float[np.ndarray, " n"],
    noise: Float[np.ndarray, " n"],
    names: Sequence[ReportedCause],
    threshold: float,
) -> dict[str, ExcessError]:
    """Error beyond noise of every joint that has a gap, largest first, after joints whose torque is wrong by a factor.

    Args:
        joints, noise: Joint names, and noise floors [N m].
        errors: Held-out error of the tuned model, and of the model with the URDF's inertias fixed [N m].
        tuned_away: Torque that only inertias beyond the URDF's tolerance explain [N m].
        names: What is reported of joints.
        threshold: Least error over noise of a gap at a joint of which nothing is reported.
    """
    found: dict[str, ExcessError] = {}
    for j, joint in enumerate(joints):
        own = [one for one in names if joint in (*one.joints, *one.hidden_torque)]
        less, more = sorted(errors, key=lambda view: float(errors[view][j]))
        hidden = max([one.hidden_torque.get(joint, 0.0) for one in own], default=0.0)
        hidden = max(hidden, tuned_away[j] if tuned_away[j] > noise[j] else 0.0)
        error = min(float(np.hypot(errors[less][j], hidden)), float(errors[more][j]))
        if error > (1.0 if own else threshold) * noise[j]:
            beyond = error**2 - noise[j] ** 2
            found[joint] = ExcessError(float(np.sqrt(beyond)), more if 2.0 * hidden**2 > beyond else less)
    off = {joint for one in names if one.is_factor for joint in one.joints}
    return dict(sorted(found.items(), key=lambda one: (one[0] not in off, -one[1].torque)))


def rank_places(
    maps: Mapping[View, Sequence[Place]], excess_errors: Mapping[str, ExcessError], settings: MapSettings = USUAL_MAP
) -> tuple[Place, ...]:
    """The cells that stand out, joint by joint in the order of `excess_errors`; of each joint the densest, one an axis.

    A cell stands out if its density exceeds a factor and is significant. If no cell of a joint does, its densest one is
    taken.
    """
    found: list[Place] = []
    for joint, one in excess_errors.items():
        cells = [place for place in maps[one.view] if place.joint == joint and place.density > 1.0]
        cells = [place for place in cells if says_where(place.axis, place.low)]
        significant = [p for p in cells if p.p_value <= settings.significant and p.density >= settings.least_density]
        significant.sort(key=lambda p: (p.axis == "frequency", p.share_of_time - p.share_of_gap))
        best = {place.axis: place for place in reversed(significant)}
        chosen = [place for place in significant if best[place.axis] is place][: settings.places_each]
        chosen = chosen or sorted(cells, key=lambda p: (p.axis == "frequency", -p.density))[:1]
        found += [replace(place, beyond_noise_Nm=one.torque) for place in chosen]
    return tuple(found[: settings.places_told])
