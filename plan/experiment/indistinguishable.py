"""Effects that are the same torque in every motion: only another set-up of the arm tells them apart.

A payload at the flange and a wrong last link are one body; torque readings that are all too large by a share and masses
that are all too large by it give the same log, since friction is fitted anyway.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant, linear_interval
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.effect_info import KNOWN_MASS, Typical
from ident.effects.sensing import TorqueGainError

# Motion that would take longer than this to tell two effects apart does not tell them apart [min].
LONGEST_MINUTES = 30.0
LARGEST_SHARE = 0.2


class _Share(Effect):
    """A torque that grows by one share on all joints."""

    scope = "arm"
    rows = "all"
    inertia_like = True
    figure: ClassVar[str] = "share"

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {self.figure: linear_interval(np.ones(1), coefficients, covariance)}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_SHARE])


class AllMasses(_Share):
    """Every link heavier by one share."""

    id = "all_masses"
    summary = "all links are heavier or lighter by one share"
    set_ups: ClassVar[Mapping[str, str]] = {TorqueGainError.id: KNOWN_MASS}

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.rigid[:, :, None] for run in session.runs]


class AllGains(_Share):
    """Every joint's torque reads too high by one share."""

    id = TorqueGainError.id
    typical = Typical("gain", 0.25)
    figure: ClassVar[str] = "gain"
    summary = "all torque readings are too large or small by one share"

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.total[:, :, None] for run in session.runs]


def widen(ids: Sequence[str], catalogue: Sequence[Effect] = CATALOGUE) -> list[Effect]:
    """Effects by their ids; beside `all_masses`, which no catalogue names, a gain error is one of all joints."""
    if AllMasses.id not in ids:
        return [find_effect(name, tuple(catalogue)) for name in ids]
    special: dict[str, Effect] = {AllMasses.id: AllMasses(), AllGains.id: AllGains()}
    return [special.get(name) or find_effect(name, tuple(catalogue)) for name in ids]
