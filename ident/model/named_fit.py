"""Laws that a diagnosis named, taken into a model: read from its JSON, and fitted beside everything else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.command_options import FitOptions
from ident.errors import InputError
from ident.laws.carried import KINDS, NamedLaw
from ident.model.identification import Identified, identify
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.safe_read import read_record

DIAGNOSIS_SCHEMA = "ident.diagnosis/1"


@dataclass(frozen=True)
class NamedLaws:
    """What a diagnosis names."""

    laws: tuple[NamedLaw, ...] = ()  # laws of joints that a model can carry, not fitted yet
    left_out: tuple[str, ...] = ()  # what else it names, in words, with the reason


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
        found = _take(record, arm, path)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"it is damaged ({type(error).__name__}: {error})"
        raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None
    if not found.laws and not found.left_out:
        what = f"nothing to take: its verdict is {record.get('verdict')!r} and no effect is named"
        raise InputError(path, what, "fit without --with, or give a diagnosis with findings")
    return found


def _take(record: Mapping[str, Any], arm: ArmModel, path: Path) -> NamedLaws:
    foreign = [name for name in record["joints"] if name not in arm.joint_names]
    if record["robot"] != arm.name or len(foreign) == len(record["joints"]):
        what = f"it is of the robot {record['robot']!r}, not of {arm.name!r}"
        raise InputError(path, what, "give a diagnosis of this robot")
    laws, left_out = [], []
    for finding in record["findings"]:
        effect, joint = finding["effect"], finding["joints"][0]
        if effect not in KINDS:
            left_out.append(f"{effect} of {joint}: no law of one joint's speed, load and angle")
        elif joint in foreign:
            left_out.append(f"{effect} of {joint}: the model has no such joint")
        else:
            reported = {name: float(figure["value"]) for name, figure in finding["parameters"].items()}
            law = record.get("baseline", {}).get(joint, {}).get("laws", {}).get(effect, {"shape": {}})
            stated = {name: float(value) for name, value in law["shape"].items()}
            shape = {**KINDS[effect].usual, **reported, **stated}
            laws.append(NamedLaw(effect, arm.joint_names.index(joint), shape))
    return NamedLaws(tuple(laws), tuple(left_out))


def identify_named(
    motions: Sequence[Motion], nominal: ArmModel, options: FitOptions, named: NamedLaws
) -> tuple[Identified, NamedLaws]:
    """Identifies an arm with named laws beside losses and inertias.

    Where friction grows with the load, a second pass takes the load from the identified arm. A law that would have to
    be below zero, so that friction drives the joint, is left out and the rest is fitted again.

    Returns:
        What was identified, and the laws with those that had to go told as left out.

    Raises:
        InputError: These recordings can't tell a law from plain friction.
    """
    names = nominal.joint_names
    laws = tuple(law for law in named.laws if law.joint < len(names))
    foreign = [law for law in named.laws if law.joint >= len(names)]
    left_out = (*named.left_out, *(f"{law.effect}: the lumped model has no joint {law.joint + 1}" for law in foreign))
    bearing: ArmModel | None = None
    while True:
        found = identify(motions, nominal, options, laws, bearing)
        gone = {(law.effect, law.joint) for law in found.named if law.vanishes}
        if gone:
            left_out += tuple(
                f"{effect} of {names[joint]}: these recordings have none" for effect, joint in sorted(gone)
            )
            laws = tuple(law for law in laws if (law.effect, law.joint) not in gone)
        elif bearing is None and any(law.bears_load for law in laws):
            bearing = found.inertia.arm
        else:
            return found, NamedLaws(found.named, left_out)
