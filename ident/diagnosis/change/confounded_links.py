"""Confounded changes: effects and places that these recordings do not distinguish from a change.

A body on one link and one on the next act alike on all joints below them; only the joint between them and their inertia
distinguish them. Two non-nested models of as many columns are compared by the difference d of their misfits in each
block: Σ d / (√B std d) is a standard normal variable if both are equally far from the truth (Vuong's test). Log
evidence would be too certain here, for it takes the model's errors for noise.

The columns of a body are laid out about an assumed place; if that is wrong, their second moments are, and a second body
elsewhere compensates (`ident.effects.added_body`). So they are laid out again about the estimated place.

Source: Vuong 1989 (likelihood ratio tests for model selection and non-nested hypotheses).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import MASS
from ident.diagnosis.change.gain_uncertainty import BODIES
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.selection.candidates import Candidates
from ident.effects.added_body import centre_of
from ident.effects.base import Effect, SessionContext
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.regression.design import Group
from ident.regression.least_squares import project
from ident.regression.run_spread import squares_left


def find_confounded(search: Candidates, groups: Sequence[Group], slot: int) -> tuple[Group, ...]:
    """Effects that explain as much as a change, best first: the same one elsewhere, another at its joint, any body.

    Args:
        search, groups: The search that selected the changes, and all changes.
        slot: Index of the change.
    """
    own, evidence, gram = groups[slot], search.evidence, search.evidence.gram()
    others = [group for k, group in enumerate(groups) if k != slot]
    beside = project(gram, evidence, search.prior, others)
    best = search.best_by_key(beside, others)
    left = squares_left(evidence, project(gram, evidence, search.prior, groups)).sum(axis=0)
    least, found = CHANGE.near * best[own.key][0], []
    for score, rival in best.values():
        bodies = own.effect.id in BODIES and rival.effect.id in BODIES
        here = own.effect.scope == rival.effect.scope == "joint" and rival.joint == own.joint
        alike = bodies or here or (rival.effect.id == own.effect.id and rival.joint != own.joint)
        if rival.key == own.key or score <= max(least, 0.0) or not alike:
            continue
        there = squares_left(evidence, project(gram, evidence, search.prior, [*others, rival]))
        if not distinguished(there.sum(axis=0) - left):
            found.append((score, rival))
    return tuple(rival for _, rival in sorted(found, key=lambda pair: -pair[0]))


def distinguished(difference: Float[Array, " B"]) -> bool:
    """Whether one model's misfit exceeds another's significantly, by the differences of their blocks (Vuong's test)."""
    blocks = len(difference)
    return bool(difference.sum() > CHANGE.apart * np.sqrt(blocks) * difference.std(ddof=1))


def place_bodies(
    search: Candidates, others: Sequence[Group], session: SessionContext, effects: Sequence[Effect]
) -> tuple[Effect, ...]:
    """All changes that are tested, each body laid out about the place at which it alone explains most.

    Args:
        search, others: A search over a first design, and changes beside the body.
        session, effects: The runs, and all effects that may have changed.
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
    return tuple(placed.get(effect.id, effect) for effect in effects)


def _centre(group: Group, session: SessionContext, beta: Float[Array, " k"]) -> Float[Array, " 3"] | None:
    """Estimated centre of mass of a body, no farther out than a tool's centre; None if its mass is zero."""
    arm = session.runs[0].arm
    context = session
    estimates = group.effect.parameters(context, group.joint, group.variant, beta, np.zeros((len(beta), len(beta))))
    if group.effect.id == UnknownPayload.id:
        mass = estimates[MASS].value
        moment = abs(mass) * np.array([estimates[f"com_{axis}_m"].value for axis in "xyz"])
        mass = abs(mass)
    else:
        mass = estimates["mass_change_kg"].value
        moment = np.array([estimates[f"moment_change_{axis}_kgm"].value for axis in "xyz"])
    return centre_of(arm, mass, moment)
