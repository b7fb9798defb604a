"""What can be wrong with the simulated arm, by the catalogue's id, and what no catalogue lists."""

from __future__ import annotations

from ident.errors import InputError
from ident.simulation.causes.arm import LOAD, SENSOR
from ident.simulation.causes.base import Cause, Circumstances
from ident.simulation.causes.joints import DRIVE, RUBBING
from ident.simulation.causes.unlisted import UNLISTED

CATALOGUE: dict[str, Cause] = {cause.id: cause for cause in (*RUBBING, *DRIVE, *LOAD, *SENSOR)}
"""The 21 effects of the catalogue."""

OUTSIDE: dict[str, Cause] = {cause.id: cause for cause in UNLISTED}
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
