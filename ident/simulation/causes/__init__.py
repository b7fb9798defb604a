"""What can be wrong with the simulated arm, by the catalogue's id, and what no catalogue lists."""

from __future__ import annotations

import tomllib
from pathlib import Path

from ident.errors import InputError

# The modules of causes enter what they do into one table.
from ident.simulation.causes import arm, joints, unlisted  # noqa: F401
from ident.simulation.causes.base import Cause, Circumstances

_ROWS = tomllib.loads(Path(__file__).with_name("causes.toml").read_text(encoding="utf-8"))

CATALOGUE: dict[str, Cause] = {name: Cause.of_row(name, **row) for name, row in _ROWS["catalogue"].items()}
"""The 21 effects of the catalogue."""

OUTSIDE: dict[str, Cause] = {name: Cause.of_row(name, **row) for name, row in _ROWS["outside"].items()}
"""Causes outside the catalogue."""

EVENTS = frozenset({"external_contact"})
"""Effects that no simulator of the arm can hold: a push that came once."""

ALIKE = (
    frozenset({"torque_offset", "asymmetric_friction"}),
    frozenset({"torque_gain_error", "payload", "link_inertial_error"}),
)
"""Effects whose torques are one and the same: with both, no truth could be told from another."""

__all__ = ["ALIKE", "CATALOGUE", "EVENTS", "OUTSIDE", "Cause", "Circumstances", "find_cause"]


def find_cause(name: str) -> Cause:
    """The cause of an id.

    Raises:
        InputError: No such id.
    """
    known = {**CATALOGUE, **OUTSIDE}
    if name not in known:
        raise InputError("--effect", f"unknown effect {name!r}", f"choose from: {', '.join(known)}")
    return known[name]
