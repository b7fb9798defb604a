"""Ranks the map's cells.

Joints by their error beyond noise, and of each joint the cells that stand out.

Joints whose whole torque is wrong by a factor come first, for every size that is estimated there is
wrong by it, too.

A joint's error beyond noise is √(rms² − noise²) N m. Of the tuned model and the one with the URDF's
inertias fixed the smaller error counts, for tuning may raise the error of one joint to lower
another's. To it is added the torque that tuning hides of a reported cause, up to the larger error:
that of an absorbed effect, of inertias beyond the URDF's tolerance, or all of a torque that is
wrong by a factor. Joints without a gap are not ranked.
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
    # The model: `before` for the tuned one, `fixed` for that with the URDF's inertias fixed.
    view: View = "before"


@dataclass(frozen=True)
class ReportedCause:
    """What is reported of a gap.

    A finding, a torque that is wrong by a factor, or that no name explains it.
    """

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
    """Error beyond noise of every joint that has a gap, largest first.

    Joints whose torque is wrong by a factor come before the others.

    Args:
        joints, noise: Joint names, and noise floors [N m].
        errors: Held-out error of the tuned model, and of the model with the URDF's inertias fixed
            [N m].
        tuned_away: Torque that only inertias beyond the URDF's tolerance explain [N m].
        names: What is reported of joints.
        threshold: Least error over noise of a gap at a joint of which nothing is reported.

    Returns:
        By joint name.
    """
    excess_errors: dict[str, ExcessError] = {}
    for j, joint in enumerate(joints):
        causes = [cause for cause in names if joint in (*cause.joints, *cause.hidden_torque)]
        less, more = sorted(errors, key=lambda view: float(errors[view][j]))
        hidden = max([cause.hidden_torque.get(joint, 0.0) for cause in causes], default=0.0)
        if tuned_away[j] > noise[j]:
            hidden = max(hidden, tuned_away[j])
        with_hidden = float(np.hypot(errors[less][j], hidden))
        error = min(with_hidden, float(errors[more][j]))
        if error > (1.0 if causes else threshold) * noise[j]:
            beyond = error**2 - noise[j] ** 2
            view = more if 2.0 * hidden**2 > beyond else less
            excess_errors[joint] = ExcessError(float(np.sqrt(beyond)), view)
    off: set[str] = set()
    for cause in names:
        if cause.is_factor:
            off.update(cause.joints)

    def rank(item: tuple[str, ExcessError]) -> tuple[bool, float]:
        joint, error = item
        return joint not in off, -error.torque

    return dict(sorted(excess_errors.items(), key=rank))


def rank_places(
    maps: Mapping[View, Sequence[Place]],
    excess_errors: Mapping[str, ExcessError],
    settings: MapSettings = USUAL_MAP,
) -> tuple[Place, ...]:
    """The cells that stand out, joint by joint in the order of `excess_errors`.

    Of each joint the densest, one an axis. A cell stands out if its density exceeds a factor and is
    significant. If no cell of a joint does, its densest one is taken.
    """
    ranked: list[Place] = []
    for joint, error in excess_errors.items():
        of_joint = [cell for cell in maps[error.view] if cell.joint == joint]
        cells = [cell for cell in of_joint if cell.density > 1.0]
        cells = [cell for cell in cells if says_where(cell.axis, cell.low)]
        standing_out = _standing_out(cells, settings)
        best: dict[str, Place] = {}
        for cell in standing_out:
            best.setdefault(cell.axis, cell)
        chosen = [cell for cell in standing_out if best[cell.axis] is cell]
        chosen = chosen[: settings.places_each]
        if not chosen:
            cells.sort(key=lambda cell: (cell.axis == "frequency", -cell.density))
            chosen = cells[:1]
        ranked += [replace(cell, beyond_noise_Nm=error.torque) for cell in chosen]
    return tuple(ranked[: settings.places_told])


def _standing_out(cells: Sequence[Place], settings: MapSettings) -> list[Place]:
    """The cells that are dense and significant, frequencies last, the densest first."""
    standing_out = []
    for cell in cells:
        is_sure = cell.p_value <= settings.significant
        if is_sure and cell.density >= settings.least_density:
            standing_out.append(cell)
    standing_out.sort(
        key=lambda cell: (cell.axis == "frequency", cell.share_of_time - cell.share_of_gap)
    )
    return standing_out
