"""Where the columns of a body are laid out: about the place at which it was found.

If the assumed place is wrong, a body's second moments are, and a second body elsewhere compensates
(`ident.effects.added_body`). So bodies are laid out again about the estimated place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Float
from ident.diagnosis.change.candidates import MASS
from ident.diagnosis.change.gain_uncertainty import BODIES
from ident.effects.added_body import centre_of
from ident.effects.base import Effect, SessionContext
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.inference.search import SetSearch
from ident.regression.design import Group, Key


def place_bodies(
    search: SetSearch, others: Sequence[Group], session: SessionContext, effects: Sequence[Effect]
) -> tuple[Effect, ...]:
    """All changes that are tested, each body laid out about the place at which it alone explains
    most.

    Args:
        search: Sums of a first design.
        others: Changes that act beside the body.
        session: The runs.
        effects: All effects that may have changed.

    Returns:
        The effects in their order, those of bodies with their places.
    """
    places: dict[str, dict[int, Float[np.ndarray, " 3"]]] = {name: {} for name in BODIES}
    arm = session.runs[0].arm
    for group in _best_bodies(search, others):
        coefficients = search.coefficients([*others, group])[group]
        place = _centre(group, session, coefficients)
        if place is not None:
            link = arm.n - 1 if group.effect.scope == "arm" else group.joint
            places[group.effect.id][link] = place
    payload = places[UnknownPayload.id]
    link_error = places[LinkInertialError.id]
    placed = {
        UnknownPayload.id: UnknownPayload(payload),
        LinkInertialError.id: LinkInertialError(link_error),
    }
    return tuple(placed.get(effect.id, effect) for effect in effects)


def _best_bodies(search: SetSearch, others: Sequence[Group]) -> list[Group]:
    """Of each body the candidate that adds most."""
    best: dict[Key, tuple[float, Group]] = {}
    for gain, group in zip(search.gains(others), search.names.groups, strict=True):
        if group.effect.id in BODIES and (group.key not in best or gain > best[group.key][0]):
            best[group.key] = float(gain), group
    return [group for _, group in best.values()]


def _centre(
    group: Group, session: SessionContext, coefficients: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " 3"] | None:
    """Estimated centre of mass of a body, no farther out than a tool's centre; None if its mass is
    zero.
    """
    arm = session.runs[0].arm
    certain = np.zeros((len(coefficients), len(coefficients)))
    estimates = group.effect.parameters(session, group.joint, group.variant, coefficients, certain)
    if group.effect.id == UnknownPayload.id:
        mass = abs(estimates[MASS].value)
        moment = mass * np.array([estimates[f"com_{axis}_m"].value for axis in "xyz"])
    else:
        mass = estimates["mass_change_kg"].value
        moment = np.array([estimates[f"moment_change_{axis}_kgm"].value for axis in "xyz"])
    return centre_of(arm, mass, moment)
