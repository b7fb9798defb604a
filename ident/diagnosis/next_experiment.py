"""What to record next, by rules of thumb; `plan excite` computes the motion itself."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence

from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import SHOWINGS, describe_motion, family_for, setup_for
from ident.records import JsonRecord, JsonTable

# Words in reasons for "not testable" that no motion removes: they lie in the arm, its URDF or the
# sensors.
NOT_OF_MOTION = (
    "gear ratio",
    "no other joint",
    "no torque depends",
    "noisy",
    "noise hides",
    "noise of",
    "tolerance",
)
# Words in reasons that a longer recording of any motion removes, and the advice to record more.
SHORT = "the session lasts"
MORE = "more"
# Length of a recording after a change of set-up, for which any motion over many poses will do
# [min].
SETUP_MINUTES = 4.0
# A name with a probability from here on is likelier than not.
LIKELY = 0.5

Record = JsonTable
"""An entry of `findings` or `not_testable` of a diagnosis's record."""


def next_experiment(
    findings: Sequence[Record],
    not_testable: Sequence[Record],
    known: Sequence[Effect] = CATALOGUE,
    robot: str = "tm5-900",
    loudest: str | None = None,
) -> JsonRecord | None:
    """The next motion to record.

    It distinguishes the effects of the first class with more than one, or else shows most of the
    effects that were not testable, each at the joint of the largest gap first. If that joint has
    neither a likely finding nor an untestable effect, the motion is its path in many poses.

    Args:
        findings, not_testable: Entries of `ident.diagnosis/1`, in their order.
        known: The effects that were tested.
        robot: Argument of `--robot`, so that the command can be run as it is shown.
        loudest: The joint of the largest gap.

    Returns:
        `separates`, `motion` and `minutes`; None if no motion would help.
    """
    here = list(findings)
    if loudest is not None:
        here = [finding for finding in findings if loudest in joints_shown(finding)]
    tied = [finding for finding in findings if len(finding["class"]) > 1]
    tied.sort(key=lambda finding: loudest not in finding["joints"])
    if tied and here:
        first = tied[0]
        joint = str(loudest) if loudest in first["joints"] else first["joints"][0]
        return _for_tied(list(first["class"]), joint, known, robot)
    unseen = [entry for entry in not_testable if entry["joints"] and _is_of_motion(entry)]
    there = [{**entry, "joints": [loudest]} for entry in unseen if loudest in entry["joints"]]
    if there:
        return _for_unseen(there, known, robot)
    if loudest is None or any(finding.get("probability", 1.0) >= LIKELY for finding in here):
        return _for_unseen(unseen, known, robot)
    return _advise([], "poses", str(loudest), robot)


def _is_of_motion(entry: Record) -> bool:
    """Whether another motion may show an effect that could not be tested."""
    return not any(words in entry["reason"] for words in NOT_OF_MOTION)


def joints_shown(finding: Record) -> set[str]:
    """Names of the joints that a finding affects: its own, and those whose error falls by it.

    Args:
        finding: A finding's record.
    """
    heldout = finding.get("heldout") or {}
    return {*finding["joints"], *heldout.get("rms_before_Nm", ())}


def _for_tied(effects: list[str], joint: str, known: Sequence[Effect], robot: str) -> JsonRecord:
    """Advice for effects that are not distinguished: a change of set-up where one helps, else a
    motion.
    """
    advice = setup_for(effects, known)
    if advice is not None:
        motion = f"Motion alone hardly tells these apart. {advice[0].upper()}{advice[1:]}"
        return {"separates": effects, "motion": motion, "minutes": SETUP_MINUTES}
    return _advise(effects, family_for(effects, known), joint, robot)


def _for_unseen(
    entries: Sequence[Record], known: Sequence[Effect], robot: str
) -> JsonRecord | None:
    """Advice for untestable effects: the kind of motion that shows most of them, at the joint that
    lacks it most; None where no motion shows any.
    """
    shown_by = {effect.id: effect.shown_by for effect in known}
    shown_by |= {entry["effect"]: MORE for entry in entries if SHORT in entry["reason"]}
    families = {}
    for entry in entries:
        if entry["effect"] in shown_by:
            families[entry["effect"]] = shown_by[entry["effect"]]
    if not families:
        return None
    family = Counter(families.values()).most_common(1)[0][0]
    effects = [effect for effect, motion in families.items() if motion == family]
    joints: Counter[str] = Counter()
    for entry in entries:
        if entry["effect"] in effects:
            joints.update(entry["joints"])
    lacking = joints.most_common(1)[0][0]
    return _advise([] if family == MORE else effects, family, lacking, robot)


def _advise(effects: Sequence[str], family: str, joint: str, robot: str) -> JsonRecord:
    """The advice for a kind of motion, with the command that computes it."""
    words = describe_motion(family, joint)
    separate = f" --separate {','.join(effects)}" if effects else ""
    if not words.startswith(joint):
        words = words[0].upper() + words[1:]
    asked = f"{separate} --joint {shlex.quote(joint)} --out next_motion"
    command = f"plan excite --robot {shlex.quote(robot)}{asked}"
    motion = f"{words}; `{command}` works it out and writes it"
    minutes = SHOWINGS[family]["minutes"]
    return {"separates": list(effects), "motion": motion, "minutes": minutes}
