"""Effects that are the same torque in every motion: only another set-up of the arm tells them apart.

A payload at the flange and a wrong last link are one body; torque readings that are all too large by a share and masses
that are all too large by it give the same log, since friction is fitted anyway.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ident.arrays import Array, Float
from ident.effects.base import Effect, SessionContext, Variant
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.effect_info import KNOWN_MASS
from ident.effects.sensing import TorqueGainError

# Motion that would take longer than this to tell two effects apart does not tell them apart [min].
LONGEST_MINUTES = 30.0


class AllMasses(Effect):
    """Every link heavier by one share."""

    id = "all_masses"
    scope, rows, inertia_like = "arm", "all", True
    figures, prior = ("share",), (0.2,)
    summary = "all links are heavier or lighter by one share"
    set_ups: ClassVar[Mapping[str, str]] = {TorqueGainError.id: KNOWN_MASS}

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.rigid[:, :, None] for run in session.runs]


class AllGains(Effect):
    """Every joint's torque reads too high by one share; all else is as of the error of one gain."""

    id = TorqueGainError.id
    scope, rows = "arm", "all"
    summary = "all torque readings are too large or small by one share"

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.total[:, :, None] for run in session.runs]


def widen(ids: Sequence[str], catalogue: Sequence[Effect] = CATALOGUE) -> list[Effect]:
    """Effects by their ids; beside `all_masses`, which no catalogue names, a gain error is one of all joints."""
    special: dict[str, Effect] = {one.id: one for one in (AllMasses(), AllGains())} if AllMasses.id in ids else {}
    return [special.get(name) or find_effect(name, tuple(catalogue)) for name in ids]
