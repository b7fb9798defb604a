"""The published list: which effects may be answered, what they mean, and their parameters."""

from __future__ import annotations

from typing import Any

from ident.effects.catalogue import CATALOGUE


def published_effects() -> dict[str, dict[str, Any]]:
    """All effects by id: what happens, whether of a joint or the arm, parameters with units in
    their names, and other effects that no recording tells from it.
    """
    listed: dict[str, dict[str, Any]] = {}
    for effect in CATALOGUE:
        listed[effect.id] = {
            "what": effect.summary,
            "scope": effect.scope,
            "parameters": sorted({*effect.figures, *effect.defining}),
            "same_as": list(effect.twins),
        }
    return listed
