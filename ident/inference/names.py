"""The candidates of a session: every effect at every joint and grid point, how large each is
expected to be, its odds.

Each effect is as likely as any other beforehand, at any joint and any point of its grid: with m
effects, p places of an effect and g points at a place, a name has the log odds −log (m p g). Its
coefficients are normal about zero, with half the largest plausible size as their deviation; an
effect that states none has that of one row's information. Of bodies more is known: by how much
their size is likelier than by such a normal is added where sets are weighed (`search`).

Source: Kass and Wasserman 1995 (unit information prior).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import SessionContext
from ident.inference.evidence import LOG_TWO
from ident.regression.design import Group
from ident.regression.gram import Evidence

# Prior standard deviations of scaled coefficients are no smaller: it keeps their inverse finite.
LEAST_DEVIATION = 1e-12


@dataclass(frozen=True, eq=False)
class Batch:
    """Candidates of equally many columns."""

    slots: list[int]  # their numbers among all candidates
    columns: Int[Array, "m w"]  # their columns in R
    deviation: Float[Array, "m w"]  # of each scaled coefficient beforehand
    signed: Bool[Array, "m w"]  # coefficients that can't be negative
    known: Float[Array, " m"]  # log odds of the name, and log 2 for each of these [nats]
    sized: Bool[Array, " m"]  # whether more is known of the size than a deviation

    @classmethod
    def of(cls, names: Names, slots: list[int]) -> Batch:
        """Some candidates of equally many columns, by their numbers."""
        groups = [names.groups[k] for k in slots]
        columns = np.stack([group.columns - names.first for group in groups])
        places = np.arange(columns.shape[1])
        signed = np.stack([np.isin(places, group.signed) for group in groups])
        odds = np.array([names.log_odds[group] for group in groups])
        return cls(
            slots=slots,
            columns=columns,
            deviation=np.stack([names.deviation[group] for group in groups]),
            signed=signed,
            known=odds + LOG_TWO * signed.sum(axis=1),
            sized=np.array([group.prior is not None for group in groups]),
        )

    def part(self, taken: Sequence[bool]) -> Batch:
        """Those of the candidates that are taken, of all candidates by number."""
        numbered = enumerate(self.slots)
        inside = np.array([k for k, slot in numbered if taken[slot]], dtype=int)
        return Batch(
            slots=[self.slots[k] for k in inside],
            columns=self.columns[inside],
            deviation=self.deviation[inside],
            signed=self.signed[inside],
            known=self.known[inside],
            sized=self.sized[inside],
        )


@dataclass(frozen=True, eq=False)
class Names:
    """The candidates with their priors."""

    groups: tuple[Group, ...]  # all candidates
    deviation: Mapping[Group, Float[Array, " k"]]  # of each scaled coefficient beforehand
    log_odds: Mapping[Group, float]  # of each candidate beforehand [nats]
    first: int  # number of the first column after the baseline's
    joints: int  # number of joints

    @classmethod
    def of(cls, evidence: Evidence, session: SessionContext) -> Names:
        """The candidates of a session's sums, with prior deviations and prior log odds.

        The prior odds of an effect are shared evenly by its places and its grid's points.

        Args:
            evidence: The sums; the candidates are its layout's groups.
            session: The runs.
        """
        layout = evidence.layout
        groups = layout.groups
        power = np.zeros(layout.size + 1)
        for local, sums in zip(layout.local, evidence.free, strict=True):
            power[local] += np.abs(sums.diagonal())
        points = Counter(group.key for group in groups)
        places = Counter(key[0] for key in points)
        deviation = {}
        log_odds = {}
        for group in groups:
            deviation[group] = _deviation(group, evidence, session, power)
            count = len(places) * places[group.effect.id] * points[group.key]
            log_odds[group] = -float(np.log(count * group.effect.screens))
        return cls(
            groups=groups,
            deviation=deviation,
            log_odds=log_odds,
            first=layout.tuned,
            joints=layout.n,
        )

    @cached_property
    def batches(self) -> dict[int | None, list[Batch]]:
        """Candidates by number of columns: for each joint those that act there; for None all."""
        slots_of_width: dict[int, list[int]] = {}
        for slot, group in enumerate(self.groups):
            slots_of_width.setdefault(len(group.columns), []).append(slot)
        whole = [Batch.of(self, slots) for slots in slots_of_width.values()]
        batches: dict[int | None, list[Batch]] = {None: whole}
        for joint in range(self.joints):
            near = [group.effect.rows == "all" or group.joint == joint for group in self.groups]
            parts = [batch.part(near) for batch in whole]
            batches[joint] = [batch_there for batch_there in parts if batch_there.slots]
        return batches


def _deviation(
    group: Group, evidence: Evidence, session: SessionContext, power: Float[Array, " P"]
) -> Float[Array, " k"]:
    """Standard deviation of a candidate's scaled coefficients beforehand."""
    width = len(group.columns)
    scale = evidence.scale[group.columns]
    if group.prior is not None:
        return np.asarray(group.prior.deviation[:width] * scale)
    largest = group.effect.prior_scale(session, group.joint, group.variant)
    if largest is not None and len(largest) >= width:
        sizes = np.asarray(largest, dtype=float)[:width]
        return np.asarray(0.5 * sizes * scale)
    rows = evidence.samples
    seen = float(rows[group.joint] if group.effect.rows == "own" else rows.sum())
    of_columns = np.maximum(power[group.columns], 1e-12)
    return np.sqrt(max(seen, 1.0) / of_columns)
