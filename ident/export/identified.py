"""One identified arm: bodies, losses and effects, made from a diagnosis, a comparison or a model.
All formats take it.

Read from the JSON alone, so that a patch can be made where the recordings are not.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS
from ident.diagnosis.result import SCHEMA
from ident.effects.base import Effect, Interval
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.intervals import exactly
from ident.errors import InputError
from ident.export.bodies import Links, nearest_bodies
from ident.laws.acting import BODIES, KNOWN, link_change, turned_gravity
from ident.laws.acting import Effect as ModuleEffect
from ident.laws.carried import NamedLaw
from ident.laws.motion import Losses
from ident.model.bodies import is_consistent
from ident.model.hybrid import HybridModel
from ident.motion.settings import FOR_DIAGNOSIS
from ident.records import JsonRecord, JsonTable
from ident.results import files_of
from ident.robot.arm import ArmModel
from ident.safe_read import read_record, require_finite

COMPARISON = "ident.comparison/1"
# Keys of a parameter beside its value and its ends: which ends are open, and where they lie if the
# URDF may be off.
FURTHER_ENDS = {"open", "low_with_urdf", "high_with_urdf"}
# Ends of names of parameters that no body or gear has below zero.
POSITIVE = re.compile(
    "(stribeck_velocity_rad_s|displacement_rad|time_constant_s|gap_rad|limit_Nm|mass_kg|delay_s)$"
)
# A loss that a solver left just below zero is zero, in its own unit.
ROUNDING = 1e-9
# Least transition width of a diagnosis [rad/s].
LEAST_WIDTH = 1e-4
# Smallest transition width, where a model's friction turns round at once [rad/s].
SHARPEST = 1e-6
# A base is level where gravity leans by less [rad].
LEVEL_ENOUGH = 1e-9


@dataclass(frozen=True, eq=False)
class Change:
    """One identified effect."""

    effect: str  # its id
    joint: int  # index of its joint; -1 for the whole arm
    joints: tuple[str, ...]  # names of the joints where it shows
    parameters: Mapping[str, Interval]  # the reported parameters with their intervals
    # Coefficients and shape of its law where the parameters leave them open.
    law: JsonTable | None = None
    kind: Effect | None = None  # the effect itself; None where it is none of those that are known
    probability: float = 1.0  # that it acts

    @property
    def has_law(self) -> bool:
        """Whether the written module knows its torque."""
        return self.effect in KNOWN or (self.kind is not None and self.kind.law is not None)

    def part(self, form: str) -> str:
        """Which part of a file (`urdf`, `mjcf`) carries it, as its row says; "" for none."""
        expression = None if self.kind is None else self.kind.formats.get(form)
        return expression.part if expression else ""

    @property
    def of_the_bodies(self) -> bool:
        """Whether it goes with the arm's bodies, gravity or zeros: then it is no joint's own."""
        return self.joint < 0 or self.effect in BODIES

    @property
    def values(self) -> dict[str, float]:
        """The parameters' values, and what the law needs besides and follows from them."""
        values = {name: interval.value for name, interval in self.parameters.items()}
        if self.kind is not None:
            law = self.law or {"coefficients": (), "shape": {}}
            coefficients = tuple(map(float, law["coefficients"]))
            values |= self.kind.law_figures(values, coefficients, law["shape"])
        return values


# A tuned baseline: losses, and change of the URDF's inertial numbers, shape (n, 10).
Tuning = tuple[Losses, Float[Array, "n 10"]]


def untuned(n: int) -> Tuning:
    """No losses, the URDF's own inertias: what a diagnosis without a baseline leaves to assume."""
    zero = np.zeros(n)
    none = Losses(zero, zero, zero, np.full(n, 0.01), zero)
    return none, freeze(np.zeros((n, len(LINK_KEYS))))


@dataclass(frozen=True, eq=False)
class IdentifiedArm:
    """An arm as it was identified."""

    nominal: ArmModel  # as its URDF describes it; joints that were not recorded are locked
    losses: Losses  # rotor inertia and friction of its joints, fitted beside the effects
    links: Links  # change of its links against the URDF, each link a body that can exist
    changes: tuple[Change, ...] = ()  # its identified effects

    @classmethod
    def tuned_to(
        cls, nominal: ArmModel, tuning: Tuning, changes: Sequence[Change] = ()
    ) -> IdentifiedArm:
        """An arm from a tuning and effects; links that no body could be become the nearest bodies.

        An identified error is reported as a change of one link, given the tuning as it is written.
        Where that alone leaves no body, the links together give its torque.
        """
        tuned, missed = nearest_bodies(nominal, tuning[1])
        numbers = nominal.inertial_parameters.reshape(nominal.n, 10) + tuned
        named = np.zeros((nominal.n, 10))
        for change in changes:
            if change.part("urdf") == "inertial":
                named[change.joint] += link_change(numbers[change.joint], change.values)
        if named.any():
            whole, missed = nearest_bodies(nominal, tuning[1] + named)
            named = whole - tuned
        return cls(nominal, tuning[0], Links(freeze(tuned), freeze(named), missed), tuple(changes))

    @classmethod
    def as_urdf(cls, nominal: ArmModel) -> IdentifiedArm:
        """The URDF as it is: its bodies, damping and friction."""
        none, _ = untuned(nominal.n)
        model = nominal.model
        losses = replace(none, viscous=model.damping, coulomb=model.friction)
        return cls.with_losses(nominal, losses)

    @staticmethod
    def losses_of(model: HybridModel) -> Losses:
        """Losses of a fitted model; friction that turns at once does so over the least width."""
        loss = model.loss
        widths = np.where(loss.transition_speed > 0.0, loss.transition_speed, SHARPEST)
        still = np.zeros(model.nominal.n)
        return Losses(loss.motor_inertia, loss.viscous, loss.coulomb, widths, still)

    @classmethod
    def of_model(cls, model: HybridModel, nearest: bool = False) -> IdentifiedArm:
        """A fitted model, its net, offsets and shared shafts aside; if asked for, links as the
        nearest bodies.

        Raises:
            InputError: Links that no body could be.
        """
        nominal = model.nominal
        n = nominal.n
        given = nominal.inertial_parameters.reshape(n, 10)
        fitted = model.arm.inertial_parameters.reshape(n, 10)
        wrong = []
        for link, row, given_row in zip(nominal.links, fitted, given, strict=True):
            # A link that the URDF itself leaves without extent is written as it is.
            if not is_consistent(row) and not np.array_equal(row, given_row):
                wrong.append(link)
        change = fitted - given
        missed = 0.0
        if wrong and not nearest:
            what = f"its {', '.join(wrong)} could be no real body"
            remedy = "give --nearest to write the nearest bodies, or fit with --inertia consistent"
            raise InputError("the model", what, remedy)
        if wrong:
            change, missed = nearest_bodies(nominal, change)
        links = Links(freeze(change), freeze(np.zeros((n, 10))), missed, tuple(wrong))
        changes = tuple(_carried(law, nominal) for law in model.named)
        return cls(nominal, cls.losses_of(model), links, changes)

    @classmethod
    def of_models(cls, model: HybridModel, nearest: bool = False) -> dict[str, IdentifiedArm]:
        """The arms that could be written of a model, by name; tuned without its laws, where it has
        any (`of_model`).

        Returns:
            "given" (the URDF as it is), "tuned" (where the model has laws), "after" (the whole
            model).
        """
        arms = {"given": cls.as_urdf(model.nominal)}
        if model.alone is not None:
            arm, loss = model.alone
            without = replace(model, arm=arm, loss=loss, named=())
            arms["tuned"] = cls.of_model(without, nearest)
        arms["after"] = cls.of_model(model, nearest)
        return arms

    @classmethod
    def with_losses(cls, nominal: ArmModel, losses: Losses) -> IdentifiedArm:
        """The URDF's bodies with losses, and no effect."""
        none = freeze(np.zeros((nominal.n, 10)))
        return cls(nominal, losses, Links(none, none, 0.0))

    @property
    def tuned(self) -> ArmModel:
        """The arm with tuned links, without the identified link errors."""
        numbers = self.nominal.inertial_parameters + self.links.tuned.ravel()
        return self.nominal.with_inertial_parameters(numbers)

    @property
    def whole(self) -> ArmModel:
        """The arm with all that was identified of its links."""
        numbers = self.nominal.inertial_parameters + self.links.total.ravel()
        return self.nominal.with_inertial_parameters(numbers)

    @property
    def gravity(self) -> Float[Array, " 3"]:
        """Gravity in the base as it is mounted, turned by a tilt that was identified [m/s²]."""
        gravity = np.array(self.nominal.model.gravity.linear)
        for change in self.changes:
            if change.part("mjcf") == "level":
                gravity = turned_gravity(gravity, change.values)
        return gravity

    @property
    def is_level(self) -> bool:
        """Whether gravity pulls along the base's -z axis: it is neither mounted otherwise nor
        tilted.
        """
        pull = self.gravity
        return bool(np.linalg.norm(pull[:2]) < LEVEL_ENOUGH * -pull[2])


def _carried(law: NamedLaw, nominal: ArmModel) -> Change:
    """A law that a model carries: shape as parameters, coefficients with their intervals."""
    parameters = {name: exactly(value) for name, value in law.shape.items()}
    for index, figure in enumerate(law.figures):
        parameters[f"coefficient_{index}"] = Interval(*figure)
    known = {"coefficients": [value for value, _, _ in law.figures], "shape": dict(law.shape)}
    joints = (nominal.joint_names[law.joint],)
    return Change(law.effect, law.joint, joints, parameters, known, find_effect(law.effect))


def in_module(changes: Sequence[Change]) -> list[ModuleEffect]:
    """Effects as the module's laws take them; those without a law are left out."""
    return [(change.effect, change.joint, change.values) for change in changes if change.has_law]


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """A diagnosis, or a comparison, as a patch needs it."""

    path: Path  # its file
    joints: tuple[str, ...]  # of the diagnosed arm
    verdict: str
    changes: tuple[Change, ...]  # the identified effects
    tuned: Tuning  # the baseline tuned together with them
    alone: Tuning  # the baseline tuned without them
    urdf: Tuning  # losses tuned without them and with the URDF's own link inertias
    has_baseline: bool  # whether the file says how the baseline was tuned
    cutoff: float  # corner of the common filter that it was made with [Hz]
    # As it was found, or given, in the arm's base [m/s²]; the URDF's if None.
    gravity: tuple[float, ...] | None = None
    # Digest of the arm that it was made with (`ArmModel.content`); "" where the file does not say
    content: str = ""
    # First digits of the hashes of the files that it was made from.
    runs: frozenset[str] = frozenset()
    # The URDF's numbers beside those that were found, as its record has them.
    identified: JsonTable = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path, catalogue: Sequence[Effect] = CATALOGUE) -> Diagnosed:
        """Reads the JSON that `ident diagnose --json` or `ident compare --json` writes, of effects
        of a catalogue.

        Raises:
            InputError: No such file, not a diagnosis, or one of which nothing was identified.
        """
        remedy = "give the JSON of `ident diagnose` or `ident compare`"
        record = read_record(path, (SCHEMA, COMPARISON), remedy)
        return cls.of_record(record, catalogue, path)

    @classmethod
    def of_record(
        cls,
        record: JsonRecord,
        catalogue: Sequence[Effect] = CATALOGUE,
        path: Path = Path("diagnosis"),
        needed: bool = True,
    ) -> Diagnosed:
        """Takes the record of a diagnosis that was never a file, or was read already.

        `path` is where it comes from, for messages. Where something to write is `needed`, an effect
        or a tuned baseline has to be there.

        Raises:
            InputError: It is damaged, or holds nothing to write.
        """
        try:
            diagnosed = cls._of(path, record, {effect.id: effect for effect in catalogue})
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            what = f"it is damaged ({type(error).__name__}: {error})"
            raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None
        if needed and not diagnosed.changes and not diagnosed.has_baseline:
            verdict = record["verdict"]
            what = f"nothing to write: its verdict is {verdict!r} and nothing was identified"
            raise InputError(path, what, "give a diagnosis of recordings that are fit for one")
        return diagnosed

    @classmethod
    def _of(cls, path: Path, record: JsonRecord, known: Mapping[str, Effect]) -> Diagnosed:
        joints = tuple(record["joints"])
        if not joints or not all(isinstance(name, str) for name in joints):
            raise ValueError(f"its joints are {joints!r}")
        baseline = record.get("baseline", {})
        changes = []
        for finding in record["findings" if "findings" in record else "changes"]:
            change = _change(finding, joints, baseline, known.get(finding["effect"]))
            _ = change.values  # a law that lacks a parameter is told here, not by who writes it
            changes.append(change)
        urdf_losses, urdf_links = _tuning(record, "baseline_urdf", joints)
        origin = record.get("provenance", {})
        settings = origin.get("settings", {})
        cutoff = float(settings.get("cutoff_hz", FOR_DIAGNOSIS.cutoff_hz))
        if not 0.0 < cutoff < np.inf:
            raise ValueError(f"its cutoff_hz is {cutoff:g}")
        pull = settings.get("gravity_mps2")
        return cls(
            path=path,
            joints=joints,
            verdict=record["verdict"],
            changes=tuple(changes),
            tuned=_tuning(record, "baseline", joints),
            alone=_tuning(record, "baseline_alone", joints),
            urdf=(urdf_losses, freeze(np.zeros_like(urdf_links))),
            has_baseline="baseline" in record,
            cutoff=cutoff,
            gravity=None if pull is None else tuple(float(pull[k]) for k in range(3)),
            content=str(settings.get("arm_sha256", "")),
            runs=files_of(origin),
            identified=record.get("identified", {}),
        )

    def fit_to(self, arm: ArmModel) -> ArmModel:
        """The arm as it is mounted, with the joints that the diagnosis does not know locked.

        Raises:
            InputError: The diagnosis is one of another arm.
        """
        foreign = [name for name in self.joints if name not in arm.joint_names]
        if foreign:
            names = ", ".join(arm.joint_names)
            remedy = f"give the --robot that it was made with; {arm.name} has {names}"
            raise InputError(self.path, f"its joint {foreign[0]!r} is none of {arm.name}", remedy)
        diagnosed = arm.keeping(self.joints)
        if self.content and self.content != diagnosed.content:
            differ = "joints, lengths or inertias differ"
            what = f"it was made with another arm than {arm.name}: {differ}"
            remedy = (
                "give the --robot that it was made with, or diagnose with this one; a patch "
                "that was written into that file kept it beside, as before_…"
            )
            raise InputError(self.path, what, remedy)
        if self.gravity is None:
            return diagnosed
        return diagnosed.with_gravity(np.array(self.gravity))

    def candidates(self, arm: ArmModel) -> dict[str, IdentifiedArm]:
        """The arms that could be written, by name: without the effects, tuned to the same
        recordings, and with them.
        """
        arm = self.fit_to(arm)
        return {
            "given": IdentifiedArm.as_urdf(arm),
            "before": IdentifiedArm.tuned_to(arm, self.urdf),
            "tuned": IdentifiedArm.tuned_to(arm, self.alone),
            "after": IdentifiedArm.tuned_to(arm, self.tuned, self.changes),
        }


def _change(
    finding: JsonRecord, joints: tuple[str, ...], baseline: JsonRecord, kind: Effect | None
) -> Change:
    """A finding as an effect; a parameter that the law can't take is refused here."""
    effect = finding["effect"]
    where = tuple(finding["joints"])
    parameters = {}
    for name, value in finding["parameters"].items():
        if not isinstance(value, dict) or set(value) - FURTHER_ENDS != {"value", "low", "high"}:
            raise ValueError(f"{name} of {effect} is {value!r}, not a value with low and high")
        what = f"{name} of {effect}"
        middle = require_finite(value["value"], what)
        low = require_finite(value["low"], what)
        high = require_finite(value["high"], what)
        if low > high:
            raise ValueError(f"{what}: its interval begins above its end")
        if middle < 0.0 and POSITIVE.search(name):
            raise ValueError(f"{what} is {middle:g}, which can't be negative")
        parameters[name] = Interval(middle, low, high)
    law = baseline.get(where[0], {}).get("laws", {}).get(effect)
    place = -1 if kind is not None and kind.scope == "arm" else joints.index(where[0])
    sure = require_finite(finding.get("probability", 1.0), f"probability of {effect}")
    return Change(effect, place, where, parameters, law, kind, sure)


def _tuning(record: JsonRecord, name: str, joints: tuple[str, ...]) -> Tuning:
    """A baseline of a record by its name; none where the record has none.

    Raises:
        ValueError: A figure is no number, or a loss negative.
    """
    if name not in record:
        return untuned(len(joints))
    keys = (*LOSS_KEYS, "transition_rad_s", "sliding_range_rad")
    losses = np.zeros((len(keys), len(joints)))
    links = np.zeros((len(joints), len(LINK_KEYS)))
    for j, joint in enumerate(joints):
        row = {"sliding_range_rad": 0.0, **record[name][joint]}
        for k, key in enumerate(keys):
            loss = require_finite(row[key], f"{key} of {joint}")
            if loss < -ROUNDING:  # rounding of zero at most: a negative one would drive the arm
                raise ValueError(f"{key} of {joint} is {loss:g}: a loss can't be negative")
            losses[k, j] = loss
        change = row["link_change"]
        links[j] = [require_finite(change[key], f"{key} of {joint}") for key in LINK_KEYS]
    losses = np.maximum(losses, 0.0)
    losses[3] = np.maximum(losses[3], LEAST_WIDTH)
    return Losses(*losses), freeze(links)
