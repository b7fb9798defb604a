"""Which of two names that explain the same: the one whose figures are the more usual.

A load and another mass of the last link, an offset and friction that differs between the directions have columns that
span (nearly) the same torque. Recordings can't tell them apart, and a penalty for each free figure is the same for
both; how large their figures would be is not. A last link of twice its own weight is hardly an error of the URDF: it is
a link that carries something. So twins are compared by their evidence with what is known of sizes beforehand,

    log p(y) ≈ ½ gain + log p(ĉ) + ½ k log 2π − ½ log|J|,

J the information about the k coefficients c.

Source: MacKay 1992 (Laplace's approximation of the evidence, Occam factor).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import project
from ident.diagnosis.selection.search import Search
from ident.effects.base import SessionContext


def more_usual_twin(
    search: Search, session: SessionContext, groups: Sequence[Group], slot: int, spare: float
) -> Group | None:
    """The twin of a name that has more evidence than it, sizes known beforehand counted; None if there is none.

    Args:
        search: The session's sums, its candidates and the belief about the URDF.
        session: The runs.
        groups: All names.
        slot: Which of them is asked about.
        spare: How many times the modelled variance the misfit has.
    """
    group = groups[slot]
    others = [other for k, other in enumerate(groups) if k != slot]
    taken = {other.key for other in groups} | search.barred
    rivals = [
        other
        for other in search.evidence.layout.groups
        if other.effect.id in group.effect.twins and other.key not in taken
    ]
    own = _evidence(search, session, group, others, spare)
    if own is None or not rivals:
        return None
    told = [
        (value, rival) for rival in rivals if (value := _evidence(search, session, rival, others, spare)) is not None
    ]
    value, best = max(told, key=lambda pair: pair[0], default=(-np.inf, group))
    return best if value > own else None


def _evidence(
    search: Search, session: SessionContext, group: Group, others: Sequence[Group], spare: float
) -> float | None:
    """Log evidence that a name adds, all names of its effect as likely as each other; None if no sizes are known."""
    evidence, gram = search.evidence, search.evidence.gram()
    view = project(gram, evidence, search.prior, others, np.append(group.columns, len(gram) - 1))
    gain, scaled = view.gain(replace(group, columns=np.arange(len(group.columns))))
    scale, asked = evidence.scale[group.columns], group.effect.asked(session)
    told = group.effect.log_prior(asked, group.joint, group.variant, scaled / scale)
    usual = group.effect.prior_scale(asked, group.joint, group.variant)
    if told is None or usual is None:
        return None
    information = scale[:, None] * view.rest[:-1, :-1] * scale / spare
    information += np.diag((2.0 / usual[: len(scale)]) ** 2)  # what they say nothing of is as wide as it was
    width = 0.5 * (len(scale) * np.log(2 * np.pi) - np.linalg.slogdet(information)[1])
    return float(0.5 * gain / spare + told + width - search.choices[group.effect.id])
