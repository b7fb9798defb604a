"""What a diagnosis says, in the terms of a patch: named effects with their figures, and the tuned baseline.

Read from the JSON alone, so that a patch can be made where the recordings are not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Float, freeze
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS
from ident.diagnosis.result import SCHEMA
from ident.effects.base import Effect, Interval
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.motion.settings import FOR_DIAGNOSIS
from ident.patches.standalone.chain import Array
from ident.patches.standalone.laws import KNOWN
from ident.patches.standalone.motion import Losses
from ident.robot.arm import ArmModel
from ident.untrusted_files import read_record, require_finite

WHOLE_ARM = -1
# Ends of names of figures that no body or gear has below zero.
POSITIVE = (
    "stribeck_velocity_rad_s",
    "displacement_rad",
    "time_constant_s",
    "gap_rad",
    "limit_Nm",
    "mass_kg",
    "delay_s",
)
# A loss that a solver left just below zero is zero, in its own unit.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Change:
    """One named effect.

    Attributes:
        effect: Its id.
        joint: Index of its joint; -1 for the whole arm.
        joints: Names of the joints where it shows.
        figures: The reported figures with their intervals.
        law: Coefficients and shape of a law that has more figures than are reported, or None.
        kind: The effect itself, or None where it is none of those that are known.
    """

    effect: str
    joint: int
    joints: tuple[str, ...]
    figures: Mapping[str, Interval]
    law: Mapping[str, Any] | None = None
    kind: Effect | None = None

    @property
    def has_law(self) -> bool:
        """Whether the written module knows its torque."""
        return self.effect in KNOWN or (self.kind is not None and self.kind.law is not None)

    @property
    def of_the_log(self) -> bool:
        """Whether it is one of the log alone."""
        return self.kind is not None and self.kind.of_the_log

    @property
    def values(self) -> dict[str, float]:
        """The figures' values, and what the law needs besides and follows from them."""
        found = {name: figure.value for name, figure in self.figures.items()}
        if self.kind is not None:
            told = self.law or {"coefficients": (), "shape": {}}
            found |= self.kind.law_figures(found, tuple(map(float, told["coefficients"])), told["shape"])
        return found


@dataclass(frozen=True, eq=False)
class Tuning:
    """The tuned baseline.

    Attributes:
        losses: Rotor inertia, viscous and Coulomb friction.
        links: Change of the URDF's inertial numbers, shape (n, 10).
    """

    losses: Losses
    links: Float[Array, "n 10"]

    @classmethod
    def none(cls, n: int) -> Tuning:
        """No losses, the URDF's own inertias: what a diagnosis without a baseline leaves to assume."""
        zero = np.zeros(n)
        return cls(Losses(zero, zero, zero, np.full(n, 0.01), zero), freeze(np.zeros((n, len(LINK_KEYS)))))

    def with_losses_of(self, other: Tuning, joints: set[int]) -> Losses:
        """These losses, but those of another tuning at some joints."""
        names = ("motor_inertia", "viscous", "coulomb", "transition", "range")
        mask = np.isin(np.arange(len(self.losses.viscous)), sorted(joints))
        return Losses(*(np.where(mask, getattr(other.losses, name), getattr(self.losses, name)) for name in names))


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """A diagnosis as a patch needs it.

    Attributes:
        path: Its file.
        joints: Joints of the diagnosed arm.
        verdict: Its verdict.
        changes: The named effects.
        tuned: The baseline tuned together with them.
        alone: The baseline tuned without them.
        urdf: Losses tuned without them and with the URDF's own link inertias.
        has_baseline: Whether the file says how the baseline was tuned.
        cutoff: Corner of the common filter that it was made with [Hz].
    """

    path: Path
    joints: tuple[str, ...]
    verdict: str
    changes: tuple[Change, ...]
    tuned: Tuning
    alone: Tuning
    urdf: Tuning
    has_baseline: bool
    cutoff: float

    @classmethod
    def load(cls, path: Path, catalogue: Sequence[Effect] = CATALOGUE) -> Diagnosed:
        """Reads the JSON that `ident diagnose --json` writes.

        Args:
            path: Its file.
            catalogue: The effects that may be named in it.

        Raises:
            InputError: No such file, not a diagnosis, or one that names nothing.
        """
        record = read_record(path, SCHEMA, "give the JSON of `ident diagnose`")
        return cls.of_record(record, catalogue, path)

    @classmethod
    def of_record(
        cls,
        record: dict[str, Any],
        catalogue: Sequence[Effect] = CATALOGUE,
        path: Path = Path("diagnosis"),
        needed: bool = True,
    ) -> Diagnosed:
        """Takes the record of a diagnosis that was never a file, or was read already.

        Args:
            record: The record.
            catalogue: The effects that may be named in it.
            path: Where it comes from, for messages.
            needed: Whether it must name an effect; else tuning alone will do.

        Raises:
            InputError: It is damaged, or names nothing that is needed.
        """
        try:
            return cls._of(path, record, {effect.id: effect for effect in catalogue}, needed)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            what = f"it is damaged ({type(error).__name__}: {error})"
            raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None

    @classmethod
    def _of(cls, path: Path, record: dict[str, Any], known: Mapping[str, Effect], needed: bool) -> Diagnosed:
        joints = tuple(record["joints"])
        if not joints or not all(isinstance(name, str) for name in joints):
            raise ValueError(f"its joints are {joints!r}")
        tuned = record.get("baseline", {})
        changes = tuple(_change(one, joints, tuned, known.get(one["effect"])) for one in record["findings"])
        if needed and not changes:
            what = f"nothing to write: its verdict is {record['verdict']!r} and no effect is named"
            raise InputError(path, what, "give a diagnosis with findings")
        has_baseline = "baseline" in record
        keys = ("baseline", "baseline_alone", "baseline_urdf")
        tuning, alone, urdf = (
            _tuning(record[key], joints) if key in record else Tuning.none(len(joints)) for key in keys
        )
        urdf = Tuning(urdf.losses, freeze(np.zeros_like(urdf.links)))
        return cls(path, joints, record["verdict"], changes, tuning, alone, urdf, has_baseline, _cutoff(record))

    def fit_to(self, arm: ArmModel) -> ArmModel:
        """The arm with the joints that the diagnosis does not know locked.

        Raises:
            InputError: The diagnosis is one of another arm.
        """
        foreign = [name for name in self.joints if name not in arm.joint_names]
        if foreign:
            remedy = f"give the --robot that it was made with; {arm.name} has {', '.join(arm.joint_names)}"
            raise InputError(self.path, f"its joint {foreign[0]!r} is none of {arm.name}", remedy)
        return arm.keeping(self.joints)


def _cutoff(record: dict[str, Any]) -> float:
    cutoff = float(record.get("provenance", {}).get("settings", {}).get("cutoff_hz", FOR_DIAGNOSIS.cutoff_hz))
    if not 0.0 < cutoff < np.inf:
        raise ValueError(f"its cutoff_hz is {cutoff:g}")
    return cutoff


def _change(finding: dict[str, Any], joints: tuple[str, ...], baseline: dict[str, Any], kind: Effect | None) -> Change:
    effect, where = finding["effect"], tuple(finding["joints"])
    figures = {name: _interval(effect, name, value) for name, value in finding["parameters"].items()}
    law = baseline.get(where[0], {}).get("laws", {}).get(effect)
    whole = kind is not None and kind.scope == "arm"
    return Change(effect, WHOLE_ARM if whole else joints.index(where[0]), where, figures, law, kind)


def _interval(effect: str, name: str, value: dict[str, Any]) -> Interval:
    """A figure with its interval; what the law can't take is refused here."""
    if not isinstance(value, dict) or set(value) != {"value", "low", "high"}:
        raise ValueError(f"{name} of {effect} is {value!r}, not a value with low and high")
    found = Interval(**{key: require_finite(one, f"{name} of {effect}") for key, one in value.items()})
    if found.low > found.high:
        raise ValueError(f"{name} of {effect}: its interval begins above its end")
    if found.value < 0.0 and name.endswith(POSITIVE):
        raise ValueError(f"{name} of {effect} is {found.value:g}, which can't be negative")
    return found


def _tuning(record: dict[str, Any], joints: tuple[str, ...]) -> Tuning:
    losses = [
        np.array([_no_less_than_zero(record[joint][key], f"{key} of {joint}") for joint in joints])
        for key in (*LOSS_KEYS, "transition_rad_s")
    ]
    links = [
        [require_finite(record[joint]["link_change"][key], f"{key} of {joint}") for key in LINK_KEYS]
        for joint in joints
    ]
    losses[-1] = np.maximum(losses[-1], 1e-4)
    ranges = [record[joint].get("sliding_range_rad", 0.0) for joint in joints]
    losses.append(np.array([_no_less_than_zero(one, "sliding_range_rad") for one in ranges]))
    return Tuning(Losses(*losses), freeze(np.array(links)))


def _no_less_than_zero(value: Any, name: str) -> float:
    """A loss figure. Tuning leaves rounding of zero at most; a negative one would drive the arm."""
    found = require_finite(value, name)
    if found < -ROUNDING:
        raise ValueError(f"{name} is {found:g}: a loss can't be negative")
    return max(found, 0.0)
