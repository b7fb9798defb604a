"""The published list: which effects may be answered, what they mean, and their parameters as truths
hold them (`parameters.toml`).
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from ident.effects.catalogue import CATALOGUE
from ident.records import JsonRecord

TABLE_FILE = Path(__file__).with_name("parameters.toml")
MEANINGS: dict[str, dict[str, str]] = tomllib.loads(TABLE_FILE.read_text(encoding="utf-8"))


def published_effects() -> dict[str, JsonRecord]:
    """All effects by id: what happens, whether of a joint or the arm, parameters with units in
    their names and what each means, and other effects that no recording tells from it.

    An effect that `parameters.toml` lacks is answered without parameters.
    """
    listed: dict[str, JsonRecord] = {}
    for effect in CATALOGUE:
        means = MEANINGS.get(effect.id, {})
        listed[effect.id] = {
            "what": effect.summary,
            "scope": effect.scope,
            "parameters": sorted(means),
            "means": means,
            "same_as": list(effect.twins),
        }
    return listed
