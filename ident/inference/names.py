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
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import SessionContext
from ident.regression.design import Group
from ident.regression.gram import Evidence


@dataclass(frozen=True, eq=False)
class Names:
    """The candidates with their priors."""

    groups: tuple[Group, ...]  # all candidates
    deviation: Mapping[Group, Float[Array, " k"]]  # of each scaled coefficient beforehand
    log_odds: Mapping[Group, float]  # of each candidate beforehand [nats]

    @classmethod
    def of(cls, evidence: Evidence, session: SessionContext) -> Names:
        """The candidates of a session's sums, with prior deviations and prior log odds.

        The prior odds of an effect are shared evenly by its places and its grid's points.

        Args:
            evidence: The sums; the candidates are its layout's groups.
            session: The runs.
        """
        groups = evidence.layout.groups
        power = np.zeros(evidence.layout.size + 1)
        for local, sums in zip(evidence.layout.local, evidence.free, strict=True):
            power[local] += np.abs(sums.diagonal())
        points = Counter(group.key for group in groups)
        places = Counter(key[0] for key in points)
        deviation, log_odds = {}, {}
        for group in groups:
            deviation[group] = _deviation(group, evidence, session, power)
            count = len(places) * places[group.effect.id] * points[group.key]
            log_odds[group] = -float(np.log(count * group.effect.screens))
        return cls(groups, deviation, log_odds)


def _deviation(
    group: Group, evidence: Evidence, session: SessionContext, power: Float[Array, " P"]
) -> Float[Array, " k"]:
    """Standard deviation of a candidate's scaled coefficients beforehand."""
    width, scale = len(group.columns), evidence.scale[group.columns]
    if group.prior is not None:
        return np.asarray(group.prior.deviation[:width] * scale)
    largest = group.effect.prior_scale(session, group.joint, group.variant)
    if largest is not None and len(largest) >= width:
        return np.asarray(0.5 * np.asarray(largest, dtype=float)[:width] * scale)
    rows = evidence.samples
    seen = float(rows[group.joint] if group.effect.rows == "own" else rows.sum())
    return np.sqrt(max(seen, 1.0) / np.maximum(power[group.columns], 1e-12))
