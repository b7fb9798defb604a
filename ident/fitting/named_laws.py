"""What a diagnosis names: laws of joints that a model can carry, and what else, in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ident.errors import InputError
from ident.laws.carried import KINDS, NamedLaw
from ident.model.carried import CarriedEffect
from ident.records import JsonTable
from ident.robot.arm import ArmModel
from ident.safe_read import read_record

DIAGNOSIS_SCHEMA = "ident.diagnosis/1"


@dataclass(frozen=True)
class NamedLaws:
    """What a diagnosis names."""

    laws: tuple[NamedLaw, ...] = ()  # laws of joints that a model can carry, not fitted yet
    left_out: tuple[str, ...] = ()  # what else it names, in words, with the reason
    # What is carried with the parameters that the diagnosis gave it.
    carried: tuple[CarriedEffect, ...] = ()

    def within(self, joints: int) -> NamedLaws:
        """Those of the first joints; laws of joints that a lumped model has not are left out."""
        laws = tuple(law for law in self.laws if law.joint < joints)
        foreign = tuple(
            f"{law.effect}: the lumped model has no joint {law.joint + 1}"
            for law in self.laws
            if law.joint >= joints
        )
        carried = tuple(effect for effect in self.carried if effect.joint < joints)
        return NamedLaws(laws, (*self.left_out, *foreign), carried)


def read_named_laws(path: Path, arm: ArmModel) -> NamedLaws:
    """Takes the laws of a diagnosis's JSON.

    Args:
        path: What `ident diagnose --json` wrote.
        arm: The arm that is to be fitted, with the joints of the model.

    Raises:
        InputError: Not a diagnosis, one of another robot, damaged, or one that names nothing.
    """
    record = read_record(path, DIAGNOSIS_SCHEMA, "give the JSON of `ident diagnose`")
    try:
        named = take_laws(record, arm, path)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"it is damaged ({type(error).__name__}: {error})"
        raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None
    if not named.laws and not named.left_out:
        what = f"nothing to take: its verdict is {record.get('verdict')!r} and no effect is named"
        raise InputError(path, what, "fit without --with, or give a diagnosis with findings")
    return named


def take_laws(record: JsonTable, arm: ArmModel, path: Path) -> NamedLaws:
    """The laws of joints in a diagnosis's record, and what else it names.

    Args:
        record: As `ident diagnose --json` writes it.
        arm: The arm that is to be fitted.
        path: Where it is from, for messages.

    Raises:
        InputError: It is of another robot.
    """
    foreign = [name for name in record["joints"] if name not in arm.joint_names]
    if record["robot"] != arm.name or len(foreign) == len(record["joints"]):
        what = f"it is of the robot {record['robot']!r}, not of {arm.name!r}"
        raise InputError(path, what, "give a diagnosis of this robot")
    laws = []
    left_out = []
    for finding in record["findings"]:
        effect = finding["effect"]
        joint = finding["joints"][0]
        if effect not in KINDS:
            reason = "a fitted model carries friction alone; `ident patch` writes this"
            left_out.append(f"{effect} of {joint}: {reason}")
        elif joint in foreign:
            left_out.append(f"{effect} of {joint}: the model has no such joint")
        else:
            shape = _shape_of(record, finding)
            laws.append(NamedLaw(effect, arm.joint_names.index(joint), shape))
    return NamedLaws(tuple(laws), tuple(left_out))


def _shape_of(record: JsonTable, finding: JsonTable) -> dict[str, float]:
    """What bends a finding's law: as is usual, as the finding says, as its baseline states."""
    effect = finding["effect"]
    shape = dict(KINDS[effect].usual)
    for name, figure in finding["parameters"].items():
        shape[name] = float(figure["value"])
    joint = record.get("baseline", {}).get(finding["joints"][0], {})
    law = joint.get("laws", {}).get(effect, {"shape": {}})
    for name, value in law["shape"].items():
        shape[name] = float(value)
    return shape
