"""Bodies with the inertia that they have where they were found, whatever the link on which they sit.

What a body's second moments lack about a place known beforehand, a second body elsewhere makes up for, and is then told
beside the true one (`ident.effects.added_body`). Between two sets nothing of that is hidden by the model's own errors.
So each body is laid out once more about the place that a first look found for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import MASS, changes
from ident.diagnosis.change.readings import BODIES
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import project
from ident.diagnosis.selection.search import Search
from ident.effects.added_body import centre_of
from ident.effects.base import Effect, SessionContext
from ident.effects.rigid_body import LinkInertialError, UnknownPayload


def place_bodies(search: Search, others: Sequence[Group], session: SessionContext) -> tuple[Effect, ...]:
    """All changes that are asked for, each body about the place at which it alone would explain most.

    Args:
        search: A search over a first look.
        others: What changed beside the body.
        session: The runs.
    """
    model = project(search.evidence.gram(), search.evidence, search.prior, others)
    best = [group for _, group in search.best_by_key(model).values() if group.effect.id in BODIES]
    places: dict[str, dict[int, Float[Array, " 3"]]] = {name: {} for name in BODIES}
    arm = session.runs[0].arm
    for group in best:
        _, scaled = model.gain(group)
        beta = scaled / search.evidence.scale[group.columns]
        place = _centre(group, session, beta)
        if place is not None:
            link = arm.n - 1 if group.effect.scope == "arm" else group.joint
            places[group.effect.id][link] = place
    payload, link_error = places[UnknownPayload.id], places[LinkInertialError.id]
    placed = {UnknownPayload.id: UnknownPayload(payload), LinkInertialError.id: LinkInertialError(link_error)}
    return tuple(placed.get(effect.id, effect) for effect in changes())


def _centre(group: Group, session: SessionContext, beta: Float[Array, " k"]) -> Float[Array, " 3"] | None:
    """Where a body is by its estimate, no farther out than a tool's centre; None of what weighs nothing."""
    arm = session.runs[0].arm
    asked = group.effect.asked(session)
    figures = group.effect.parameters(asked, group.joint, group.variant, beta, np.zeros((len(beta), len(beta))))
    if group.effect.id == UnknownPayload.id:
        mass = figures[MASS].value
        moment = abs(mass) * np.array([figures[f"com_{axis}_m"].value for axis in "xyz"])
        mass = abs(mass)
    else:
        mass = figures["mass_change_kg"].value
        moment = np.array([figures[f"moment_change_{axis}_kgm"].value for axis in "xyz"])
    return centre_of(arm, mass, moment)
