"""What to record next: a rule of thumb from what was found; `plan excite` works the motion itself out."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import SHOWINGS, describe_motion, family_for, setup_for

# Reasons for "not testable" that no motion mends: they lie in the arm, its URDF or the sensors.
NOT_OF_MOTION = (
    "gear ratio",
    "no other joint",
    "no torque depends",
    "too noisy",
    "noise hides",
    "noise of",
    "tolerance",
)
# After a change of set-up any motion over wide poses will do [min].
SETUP_MINUTES = 4.0


def next_experiment(
    findings: Sequence[Mapping[str, Any]],
    not_testable: Sequence[Mapping[str, Any]],
    known: Sequence[Effect] = CATALOGUE,
    robot: str = "tm5-900",
    nearest: Mapping[str, Any] | None = None,
    loudest: str | None = None,
) -> dict[str, Any] | None:
    """The motion that parts the first tied class, or shows what came nearest to a name; else most of the untested.

    A gap without a name is looked into at the joint where it is largest, if motion can show more there.

    Args:
        findings: Findings of `ident.diagnosis/1`, in their order.
        not_testable: Its effects that could not be tested.
        known: The effects that were tested.
        robot: What `--robot` takes for the arm: a command that is shown runs as it stands.
        nearest: What came near to a name and got none.
        loudest: The joint of the largest gap.

    Returns:
        `separates`, `motion` and `minutes`; None if nothing is open that a motion could settle.
    """
    for finding in findings:
        if len(finding["class"]) > 1:
            return _for_tied(list(finding["class"]), finding["joints"][0], known, robot)
    unseen = [
        one for one in not_testable if one["joints"] and not any(words in one["reason"] for words in NOT_OF_MOTION)
    ]
    if nearest is not None and (loudest is None or loudest in nearest["joints"]):
        return _for_tied([nearest["effect"]], loudest or nearest["joints"][0], known, robot)
    there = [{**one, "joints": [loudest]} for one in unseen if loudest in one["joints"]]
    return _for_unseen(there or unseen, known, robot)


def _for_tied(effects: list[str], joint: str, known: Sequence[Effect], robot: str) -> dict[str, Any]:
    advice = setup_for(effects, known)
    if advice is not None:
        motion = f"Motion alone hardly tells these apart. {advice[0].upper()}{advice[1:]}"
        return {"separates": effects, "motion": motion, "minutes": SETUP_MINUTES}
    family = family_for(effects, known)
    return {
        "separates": effects,
        "motion": f"{_sentence(family, joint)}; {_command(effects, joint, robot)}",
        "minutes": SHOWINGS[family].minutes,
    }


def _for_unseen(entries: Sequence[Mapping[str, Any]], known: Sequence[Effect], robot: str) -> dict[str, Any] | None:
    """The kind of motion that shows the most effects, and the joint that lacks it most."""
    shown_by = {effect.id: effect.shown_by for effect in known}
    families = {one["effect"]: shown_by[one["effect"]] for one in entries if one["effect"] in shown_by}
    if not families:
        return None
    family = Counter(families.values()).most_common(1)[0][0]
    effects = [effect for effect, own in families.items() if own == family]
    joints = Counter(joint for one in entries if one["effect"] in effects for joint in one["joints"])
    joint = joints.most_common(1)[0][0]
    return {
        "separates": effects,
        "motion": f"{_sentence(family, joint)}; {_command(effects, joint, robot)}",
        "minutes": SHOWINGS[family].minutes,
    }


def _sentence(family: str, joint: str) -> str:
    words = describe_motion(family, joint)
    return words if words.startswith(joint) else words[0].upper() + words[1:]


def _command(effects: Sequence[str], joint: str, robot: str) -> str:
    command = f"plan excite --robot {shlex.quote(robot)} --separate {','.join(effects)} --joint {shlex.quote(joint)}"
    return f"`{command} --out next_motion` works it out and writes it"
