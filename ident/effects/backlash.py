"""Play of a gear: narrow gaps by their coefficient, wide ones by a grid of widths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, RunContext, SessionContext, Variant
from ident.effects.gear_twist import FINE_FACTORS, deflect, felt_torque, mean_inertia
from ident.effects.typical_sizes import rated_torque

# Full widths of play [rad]. The link is through a narrow gap before the filter sees it: what is left is proportional
# to the width. It falls through a wide one for so long that each width looks different.
NARROW_GAPS = (0.0005, 0.002)
WIDE_GAPS = tuple(float(gap) for gap in np.geomspace(0.0025, 0.06, 15))
# Of the wide ones those go on to the search that look most like what the tuned model leaves.
WIDE_KEPT = 2
# Play of a gear that is worn but still turns; new ones have some mrad [rad].
LARGEST_PLAY = 0.06
# Stiffness of the gear in contact, in rated torques a radian, and its damping ratio: tooth contact hardly rebounds.
CONTACT_STIFFNESS = 150.0
CONTACT_DAMPING_RATIO, FINE_CONTACT_RATIOS = 0.3, (0.3, 0.6, 1.0)
WIDE_CONTACT_RATIO = 1.0
# Load to either side of zero that counts, as a share of the rated torque.
LEAST_LOAD_SHARE = 0.002
FINE_WIDE_FACTORS = (0.82, 0.88, 0.92, 0.96, 1.0, 1.04, 1.08, 1.13, 1.2)


@dataclass(frozen=True)
class Backlash(Effect):
    """Play of width b: no torque passes while the link crosses from one flank to the other.

    The columns are the difference of two integrations, with and without the gap, per width. That of a narrow gap is
    proportional to its width, which is then its coefficient; a wide one is a point of the grid (`screened`).

    Attributes:
        widths: Wide gaps of each joint that look most like what the tuned model leaves [rad].
        screens: Number of wide gaps that were looked at for each that is kept.
    """

    widths: tuple[tuple[float, ...], ...] = ()
    screens: int = 1

    id = "backlash"

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> Backlash:
        some = session.surveyed(leftover)
        found = tuple(
            () if self.untestable(session, joint) else _widths(session.survey, some, joint)
            for joint in range(session.n)
        )
        return replace(self, widths=found, screens=len(WIDE_GAPS) // WIDE_KEPT)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        least = LEAST_LOAD_SHARE * rated_torque(session, joint)
        low = min(float(run.link[:, joint].min()) for run in session.runs)
        high = max(float(run.link[:, joint].max()) for run in session.runs)
        if low > -least or high < least:
            return f"load of {session.joint_names[joint]} never changes sign ({low:.2f} to {high:.2f} N m)"
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        narrow = _contact(session, joint, CONTACT_DAMPING_RATIO)
        wide = _contact(session, joint, WIDE_CONTACT_RATIO)
        widths = self.widths[joint] if self.widths else ()
        return (
            *(Variant(shape={"gap_rad": gap, **narrow}) for gap in NARROW_GAPS),
            *(Variant({"gap_rad": gap}, shape=wide) for gap in widths),
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        contacts = [_contact(session, joint, ratio) for ratio in FINE_CONTACT_RATIOS]
        if variant.inner:
            wide = [factor * variant.inner["gap_rad"] for factor in FINE_WIDE_FACTORS]
            return tuple(Variant({"gap_rad": gap}, shape=contact) for contact in contacts for gap in wide)
        narrow = [factor * variant.shape["gap_rad"] for factor in FINE_FACTORS]
        return tuple(Variant(shape={**contact, "gap_rad": gap}) for contact in contacts for gap in narrow)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        gap = variant.inner.get("gap_rad", variant.shape.get("gap_rad", 0.0))
        contact = variant.shape["stiffness_Nm_rad"], variant.shape["damping_Nms_rad"]
        return [next(_knock(run, joint, contact, (gap,), unit=gap))[:, :, None] for run in session.runs]


def _contact(session: SessionContext, joint: int, ratio: float) -> dict[str, float]:
    """Stiffness and damping of the teeth."""
    stiffness = CONTACT_STIFFNESS * rated_torque(session, joint)
    damping = 2 * ratio * float(np.sqrt(stiffness * mean_inertia(session, joint)))
    return {"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping}


def _knock(
    run: RunContext,
    joint: int,
    contact: tuple[float, float],
    gaps: Sequence[float],
    rows: slice = slice(None),
    unit: float = 1.0,
) -> Iterator[Float[Array, "T k"]]:
    """What all joints, or some of them, feel of play, for each width, in units of one [N m]."""
    same_gear = "without play", joint, contact
    if same_gear not in run.kept:
        run.kept[same_gear] = deflect(run, joint, *contact, 0.0)
    tight = run.kept[same_gear]
    for gap in gaps:
        loose = deflect(run, joint, *contact, gap)
        yield felt_torque(run, joint, loose[0] - tight[0], loose[1] - tight[1], rows, unit)


def _widths(session: SessionContext, leftover: Sequence[Float[Array, "t n"]], joint: int) -> tuple[float, ...]:
    """The wide gaps whose torque looks most like what is left at a joint, by differences from sample to sample."""
    stiffness = _contact(session, joint, WIDE_CONTACT_RATIO)
    contact = stiffness["stiffness_Nm_rad"], stiffness["damping_Nms_rad"]
    along, power = np.zeros(len(WIDE_GAPS)), np.zeros(len(WIDE_GAPS))
    for run, left in zip(session.runs, leftover, strict=True):
        counts = (left[1:, joint] != 0.0) & (left[:-1, joint] != 0.0)
        steps = np.diff(left[:, joint])[counts]
        felt = list(_knock(run, joint, contact, WIDE_GAPS, rows=slice(joint, joint + 1)))
        change = np.diff(run.motion.filtered_together(felt), axis=0)[counts]
        along += steps @ change
        power += np.sum(change**2, axis=0)
    score = np.where(along > 0.0, along**2 / np.maximum(power, 1e-300), 0.0)
    best = np.argsort(-score, kind="stable")[:WIDE_KEPT]
    return tuple(sorted(WIDE_GAPS[k] for k in best if score[k] > 0.0))
