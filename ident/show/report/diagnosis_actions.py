"""What to do after a diagnosis: about each name, and first of all."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ident.effects.catalogue import CATALOGUE, OF_THE_ARM
from ident.effects.effect_info import setup_for
from ident.records import JsonTable
from ident.show.report.diagnosis_gap import (
    overtuned_joints,
    tuned_away_joints,
    varying_friction,
    wrong_link,
)
from ident.show.report.finding_words import BODIES, MOST_TIED, Finding, is_likely
from ident.show.report.leading_joint import (
    acts_on,
    in_order_of_joints,
    issues_of_kind,
    leading_joint,
    names_factor,
)
from ident.show.report.misread_torque import misread_torque
from ident.show.report.numbers import describe_numbers, is_mostly_friction
from ident.show.report.words import effect_name, sentence

# What the check of the recordings says of a body at the arm's end.
BODY = "body_differs"
# What to do about that first, of a mass too much in the URDF and of one that it lacks.
AT_THE_END = {
    False: "take the hand or tool that is not mounted out of the URDF; if all of it is",
    True: (
        "give what the arm carries at its end as [payload] of session.toml; if it carries nothing"
    ),
}
# What a motion's words begin with where it takes more than motion.
NO_MOTION = "Motion alone hardly tells these apart. "
OWN_INERTIAS = (
    "Give what the flange carries as [payload] of session.toml; if it carries nothing, fit the "
    "arm's own inertias (`ident fit`) and give them with `--model`."
)
RECORD_WIDER = (
    "Record this again, longer and wider: several minutes, each joint over its whole range, "
    "at all speeds."
)
PATCH = (
    "`ident patch why.json --robot … --out patched --into MINE.urdf`, or MINE.xml "
    "(why.json is what `--json why.json` writes here)."
)
WRITE_NUMBERS = f"Write these numbers into your model: {PATCH}"
# Verdicts of which no name tells what to do.
# Of an arm without a gap whose friction is not one number.
OF_VARYING_FRICTION = (
    "Find out when the friction of {} changes: `ident compare` tells earlier runs from later ones, "
    "in folders of their own; a cold arm is one cause."
)
WITHOUT_ACTION = ("not_testable", "none_of_catalogue")
# Verdicts after which no motion is asked for.
WITHOUT_MOTION = ("no_gap", "refused")
# Verdicts beside which the URDF's friction may be what is said first.
BESIDE_FRICTION = ("named", "partial", "none_of_catalogue")
# What to do about a small effect beside a mass at the arm's end that is not the URDF's.
AFTER_THE_BODY = "put the mass at the arm's end right first; act on this only if it is named again"


def leads_with_friction(record: JsonTable) -> bool:
    """Whether the URDF's friction is said before all else, as most of what the URDF errs by.

    A factor of the leading joint's torque and a mass at the arm's end come before: what friction is
    found with them wrong is not the arm's.
    """
    if record["verdict"] not in BESIDE_FRICTION or overtuned_joints(record):
        return False
    scale = misread_torque(record)
    if scale and leading_joint(record)[0] in ("", *scale["joints"]):
        return False
    return is_mostly_friction(record) and not is_of_the_end(record)


def first_action(record: JsonTable) -> str:
    """What to do first: about the URDF's friction where that is most of its error, else about the
    leading joint.

    Args:
        record: Of a diagnosis, `ident.diagnosis/1`.

    Returns:
        One or two sentences with their full stops; "" where there is nothing to do.
    """
    return WRITE_NUMBERS if leads_with_friction(record) else _action_at_the_lead(record)


def second_action(record: JsonTable) -> str:
    """What to do about the leading joint where the URDF's friction comes first; of an arm without a
    gap, about a link that is off by more than URDFs are, or else about friction that differs from
    run to run; else "".
    """
    if leads_with_friction(record):
        return _action_at_the_lead(record)
    if record["verdict"] != "no_gap":
        return ""
    _, of_link = wrong_link(record)
    if of_link:
        return f"{of_link}."
    joint, _ = varying_friction(record)
    return OF_VARYING_FRICTION.format(joint) if joint else ""


def _action_at_the_lead(record: JsonTable) -> str:
    """What to do about the leading joint: set its torque right if that is off by a factor."""
    scale = misread_torque(record)
    joint, beyond = leading_joint(record)
    if scale and not scale["bodily"] and joint in ("", *scale["joints"]):
        return f"At {scale['places']}: {scale['remedy']}."
    named = in_order_of_joints(record)
    if joint:
        named = [finding for finding in named if acts_on(finding, joint, record)]
    overtuned = overtuned_joints(record)
    hidden = tuned_away_joints(record)
    orders = (order_of(finding, record) for finding in named)
    action = next((order for order in orders if order), "")
    is_sound = any(map(is_likely, named)) or not (overtuned or hidden)
    if action and is_sound and record["verdict"] not in WITHOUT_ACTION:
        return f"{sentence(action)}."
    if overtuned:
        return RECORD_WIDER
    if is_of_the_end(record):
        return f"{sentence(str(issues_of_kind(record, BODY)[0]['remedy']))}; then diagnose again."
    if hidden and joint in hidden:
        return f"{beyond} at {joint} may be a load or wrong inertias. {OWN_INERTIAS}"
    if hidden:
        return OWN_INERTIAS
    if record["verdict"] == "no_gap":
        return WRITE_NUMBERS if describe_numbers(record) or wrong_link(record)[0] else ""
    motion = "" if record["verdict"] in WITHOUT_MOTION else _next_motion(record)
    if not motion:
        return ""
    is_unnamed = record.get("findings") and not named
    unnamed = f"{beyond} at {joint} are unexplained. " if is_unnamed else ""
    return f"{unnamed}Record this next: {motion}."


def is_of_the_end(record: JsonTable) -> bool:
    """Whether the gap of the leading joint is hidden in tuned inertias, and the check of the
    recordings has found what is wrong there: a mass at the arm's end.
    """
    joint = leading_joint(record)[0]
    return bool(issues_of_kind(record, BODY)) and joint in tuned_away_joints(record)


def is_beside_the_body(finding: Finding, record: JsonTable) -> bool:
    """Whether a name is of another joint than the leading one, whose gap is a mass at the arm's
    end that is not the URDF's.
    """
    if not record.get("findings") or not is_of_the_end(record):
        return False
    return not acts_on(finding, leading_joint(record)[0], record)


def order_of(finding: Finding, record: JsonTable) -> str:
    """What to do about a name; of tied ones that are less likely than not no single order."""
    names = finding.get("class", [])
    action = _with_joint_names(str(finding.get("action", "")), record)
    if action and is_beside_the_body(finding, record):
        return AFTER_THE_BODY
    scale = misread_torque(record) if record.get("findings") else None
    if action and scale and names_factor(finding, scale):
        what = "settle the factor above first; what is left of it with all masses tuned"
        return f"{what}: {action}"
    if action and is_at_the_end(finding, record):
        if finding["effect"] in OF_THE_ARM:  # nothing else than what the check has weighed
            return str(issues_of_kind(record, BODY)[0]["remedy"])
        return f"{AT_THE_END[adds_mass(finding)]}, {action}"
    if is_likely(finding) or not action or len(names) < 2:
        return action
    lead = leading_joint(record)[0]
    joint = lead if lead in finding["joints"] else finding["joints"][0]
    motion = _parting_motion(names[:2], joint, record)
    tied = " or ".join(effect_name(name) for name in names[:MOST_TIED])
    what = f"act on none yet, for it may be {tied} in {joint}"
    return f"{what}; record this to tell them apart: {motion}"


def _parting_motion(pair_of: Sequence[str], joint: str, record: JsonTable) -> str:
    """The change of set-up, or the motion, that tells two effects at a joint apart."""
    set_up = setup_for(pair_of, CATALOGUE)
    if set_up:
        return set_up
    motion = _next_motion(record)
    parted = set(pair_of) <= set((record.get("next_experiment") or {}).get("separates", ()))
    is_of_another = "--joint" in motion and f"--joint {joint} " not in f"{motion} "
    if parted and not is_of_another:
        return motion
    command = f"`plan excite --robot … --separate {pair_of[0]},{pair_of[1]} --joint {joint}`"
    return f"{command} works the motion out"


def _with_joint_names(text: str, record: JsonTable) -> str:
    """A sentence with the names of joints that an effect counts from the base."""
    joints = record.get("joints", ())

    def name(counted: re.Match[str]) -> str:
        number = int(counted[1])
        return str(joints[number - 1]) if 0 < number <= len(joints) else counted[0]

    return re.sub(r"joint number (\d+)", name, text)


def is_at_the_end(finding: Finding, record: JsonTable) -> bool:
    """Whether a mass is what the check of the recordings has found at the arm's end."""
    if finding["effect"] not in BODIES or _mass_of(finding) is None:
        return False
    checked: set[str] = set()
    for issue in issues_of_kind(record, BODY):
        checked.update(issue["joints"])
    if checked and finding["effect"] in OF_THE_ARM:
        return is_likely(finding, BODIES)
    places = set(finding["joints"])
    places.update(place["joint"] for place in finding.get("elsewhere", ()))
    may_be_carried = not BODIES.isdisjoint(finding.get("class", ())[1:])
    return bool(checked) and (may_be_carried or not checked.isdisjoint(places))


def adds_mass(finding: Finding) -> bool:
    """Whether a body weighs more than the URDF has it."""
    mass = _mass_of(finding)
    return mass is not None and mass > 0.0


def _mass_of(finding: Finding) -> float | None:
    """What a body weighs beyond the URDF [kg]; None of what is no mass."""
    parameters = finding.get("parameters", {})
    known = [parameters[key]["value"] for key in ("mass_change_kg", "mass_kg") if key in parameters]
    return float(known[0]) if known else None


def _next_motion(record: JsonTable) -> str:
    """The motion to record next, in words; "" where none is known."""
    motion = str((record.get("next_experiment") or {}).get("motion", ""))
    return motion.removeprefix(NO_MOTION)
