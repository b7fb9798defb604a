"""What to record next: rules of thumb from the findings; `plan excite` computes the motion itself."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import SHOWINGS, describe_motion, family_for, setup_for

# Words in reasons for "not testable" that no motion removes: they lie in the arm, its URDF or the sensors.
NOT_OF_MOTION = ("gear ratio", "no other joint", "no torque depends", "noisy", "noise hides", "noise of", "tolerance")
# Words in reasons that a longer recording of any motion removes, and the advice to record more.
SHORT = "the session lasts"
MORE = "more"
# Length of a recording after a change of set-up, for which any motion over many poses will do [min].
SETUP_MINUTES = 4.0


def next_experiment(
    findings: Sequence[Mapping[str, Any]],
    not_testable: Sequence[Mapping[str, Any]],
    known: Sequence[Effect] = CATALOGUE,
    robot: str = "tm5-900",
    loudest: str | None = None,
) -> dict[str, Any] | None:
    """The next motion to record.

    It distinguishes the effects of the first class with more than one, or else shows most of the effects that were not
    testable, each at the joint of the largest gap first. If that joint has neither a likely finding nor an untestable
    effect, the motion is its path in many poses.

    Args:
        findings, not_testable: Entries of `ident.diagnosis/1`, in their order.
        known: The effects that were tested.
        robot: Argument of `--robot`, so that the command can be run as it is shown.
        loudest: The joint of the largest gap.

    Returns:
        `separates`, `motion` and `minutes`; None if no motion would help.
    """
    here = [one for one in findings if loudest is None or loudest in joints_shown(one)]
    tied = sorted((one for one in findings if len(one["class"]) > 1), key=lambda one: loudest not in one["joints"])
    if tied and here:
        joint = str(loudest) if loudest in tied[0]["joints"] else tied[0]["joints"][0]
        return _for_tied(list(tied[0]["class"]), joint, known, robot)
    open_to = [one for one in not_testable if not any(words in one["reason"] for words in NOT_OF_MOTION)]
    unseen = [one for one in open_to if one["joints"]]
    there = [{**one, "joints": [loudest]} for one in unseen if loudest in one["joints"]]
    likely = loudest is None or any(one.get("probability", 1.0) >= 0.5 for one in here)
    return _for_unseen(there or unseen, known, robot) if there or likely else _advise([], "poses", str(loudest), robot)


def joints_shown(finding: Mapping[str, Any]) -> set[str]:
    """The joints that a finding affects: its own, and those whose error falls by it."""
    return {*finding["joints"], *(finding.get("heldout") or {}).get("rms_before_Nm", ())}


def _for_tied(effects: list[str], joint: str, known: Sequence[Effect], robot: str) -> dict[str, Any]:
    """Advice for effects that are not distinguished: a change of set-up where one helps, else a motion."""
    advice = setup_for(effects, known)
    if advice is not None:
        motion = f"Motion alone hardly tells these apart. {advice[0].upper()}{advice[1:]}"
        return {"separates": effects, "motion": motion, "minutes": SETUP_MINUTES}
    return _advise(effects, family_for(effects, known), joint, robot)


def _for_unseen(entries: Sequence[Mapping[str, Any]], known: Sequence[Effect], robot: str) -> dict[str, Any] | None:
    """Advice for untestable effects: the kind of motion that shows most of them, at the joint that lacks it most."""
    shown_by = {effect.id: effect.shown_by for effect in known}
    shown_by |= {one["effect"]: MORE for one in entries if SHORT in one["reason"]}
    families = {one["effect"]: shown_by[one["effect"]] for one in entries if one["effect"] in shown_by}
    if not families:
        return None
    family = Counter(families.values()).most_common(1)[0][0]
    effects = [effect for effect, own in families.items() if own == family]
    joints = Counter(joint for one in entries if one["effect"] in effects for joint in one["joints"])
    return _advise([] if family == MORE else effects, family, joints.most_common(1)[0][0], robot)


def _advise(effects: Sequence[str], family: str, joint: str, robot: str) -> dict[str, Any]:
    """The advice for a kind of motion, with the command that computes it."""
    words = describe_motion(family, joint)
    separate = f" --separate {','.join(effects)}" if effects else ""
    words = words if words.startswith(joint) else words[0].upper() + words[1:]
    command = f"plan excite --robot {shlex.quote(robot)}{separate} --joint {shlex.quote(joint)} --out next_motion"
    motion = f"{words}; `{command}` works it out and writes it"
    return {"separates": list(effects), "motion": motion, "minutes": SHOWINGS[family]["minutes"]}
