"""Names of recorded joints -> the robot's: equal ones, or such that differ in their beginning."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import product, takewhile

from ident.errors import RecordingError
from ident.recordings.recording import Session, TelemetryIssue
from ident.safe_read import toml_key


def match_joints(
    session: Session, joint_names: Sequence[str]
) -> tuple[Session, tuple[TelemetryIssue, ...]]:
    """Brings a session to the robot's joints, in the robot's order.

    Names that are equal match. If none is, names that differ only in what stands before a common
    ending match (`fer_joint1` is `panda_joint1`), provided that every joint of the robot finds its
    own.

    Returns:
        The session with the robot's joints that it has, and what was renamed, left out, or is
        missing. The caller locks the missing ones at their neutral positions.

    Raises:
        RecordingError: No joint of the robot is recorded.
    """
    issues: list[TelemetryIssue] = []
    if not set(session.joints) & set(joint_names):
        renamed = map_by_ending(session.joints, joint_names)
        if not renamed:
            old = session.joints[0]
            new = joint_names[0]
            example = (
                f"{toml_key(f'{old}/position')} = "
                f"{json.dumps(f'{new}/position', ensure_ascii=False)}"
            )
            what = (
                f"its joints ({', '.join(session.joints)}) are none of the robot's "
                f"({', '.join(joint_names)})"
            )
            remedy = (
                f"give another --robot, or name each joint in [columns] of session.toml: {example}"
            )
            raise RecordingError(session.path or session.name, what, remedy)
        joints = tuple(renamed.get(joint, joint) for joint in session.joints)
        session = session.replace(runs=[run.replace(joints=joints) for run in session.runs])
        pairs = ", ".join(f"{old} is {new}" for old, new in renamed.items())
        evidence = (
            f"{session.name}: recorded names differ from the robot's in their beginning: {pairs}"
        )
        issues.append(
            TelemetryIssue(
                "joints_renamed", tuple(renamed.values()), "note", evidence, "none needed"
            )
        )
    present = [name for name in joint_names if name in session.joints]
    missing = tuple(name for name in joint_names if name not in session.joints)
    extra = tuple(name for name in session.joints if name not in joint_names)
    if extra:
        evidence = f"{session.name}: the robot has no joint {', '.join(extra)}; left out"
        issues.append(TelemetryIssue("joints_left_out", extra, "note", evidence, "none needed"))
    if missing:
        evidence = (
            f"{session.name}: {', '.join(missing)} not recorded; locked at the neutral position"
        )
        remedy = "record every joint, or give a URDF in which they are fixed where they were"
        issues.append(TelemetryIssue("joints_locked", missing, "note", evidence, remedy))
    return session.replace(runs=[run.select(present) for run in session.runs]), tuple(issues)


def map_by_ending(recorded: Sequence[str], wanted: Sequence[str]) -> dict[str, str]:
    """Recorded -> wanted names, where one change of beginning turns recorded names into all wanted
    ones.

    Empty if there is none, or if several fit equally.
    """
    beginnings: dict[tuple[str, str], None] = {}
    for old, new in product(recorded, wanted):
        pairs = zip(reversed(old), reversed(new), strict=False)
        # letters of their endings
        common = len([*takewhile(lambda pair: pair[0] == pair[1], pairs)])
        if common:
            beginnings[old[: len(old) - common], new[: len(new) - common]] = None
    mappings: list[dict[str, str]] = []
    for before, after in beginnings:
        mapping = {
            old: after + old.removeprefix(before) for old in recorded if old.startswith(before)
        }
        mapping = {old: new for old, new in mapping.items() if new in wanted}
        if len(set(mapping.values())) == len(mapping) == len(wanted) and mapping not in mappings:
            mappings.append(mapping)
    return mappings[0] if len(mappings) == 1 else {}
