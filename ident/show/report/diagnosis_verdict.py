"""A diagnosis in words: its verdict, what to do first, what is not known.

One order holds for all words, that of the map: the joint of its first place leads, one whose whole torque is off by a
factor, else of the largest gap. The first line begins with it, what to do first is about it, and of the names those
that show there come first. A factor of a joint that has no gap is said after the verdict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ident.checks.report import MISREAD
from ident.diagnosis.heldout_gain import in_linear_units
from ident.diagnosis.next_experiment import joints_shown
from ident.diagnosis.settings import USUAL_VERDICT
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import setup_for
from ident.errors import join_words, plural
from ident.show.report.numbers import MOST_NAMED, describe_numbers
from ident.show.report.words import TABLES, effect_name, fixed, pair, percent, sentence, significant, with_units

# Tuned on other runs a model that errs by so many times what it does untuned has learned what does not carry over.
OVERTUNED = 2.0
BODIES = {effect.id for effect in CATALOGUE if effect.as_change.body}
GAINS = {effect.id for effect in CATALOGUE if effect.as_change.exact and effect.as_change.common_gain}
OF_THE_ARM = {effect.id for effect in CATALOGUE if effect.scope == "arm"}
# A joint that reads a factor, and the factor, in what the telemetry check says.
READS = re.compile(r"(\S+) reads (-?\d+\.\d+)")
ELSEWHERE = {effect.id for effect in CATALOGUE if effect.rows == "all"}  # they act on other joints' torque, too


# A first line that is longer says less, step by step [characters].
LONGEST_HEADLINE = 200


class Most(NamedTuple):
    """How much a first line has in it at most."""

    names: int
    tied: int  # of a name that is less likely than not, those that it may be
    rest: bool = False  # whether it says what the names leave
    others: bool = True  # whether it names the joints, but the first, whose torque is off by a factor


# From a whole line to the shortest.
FEWER = (
    *(Most(names, MOST_NAMED, rest=True) for names in range(MOST_NAMED, 0, -1)),
    *(Most(1, tied) for tied in range(MOST_NAMED, 0, -1)),
    Most(1, 1, others=False),
)


def diagnosis_headline(record: Mapping[str, Any]) -> str:
    """The leading joint's gap if no effect of its own explains it, the verdict, and a factor of a torque elsewhere.

    As many names, and as many that they can't be told from, as one line holds; all stand in the list below it.
    """
    line = ""
    for most in FEWER:
        line = _headline_of(record, most)
        if len(line) <= LONGEST_HEADLINE:
            return line
    return line


def _headline_of(record: Mapping[str, Any], most: Most) -> str:
    """The first line with so much in it at most."""
    scale, (joint, beyond), shown = _misread(record), leading_joint(record), in_order_of_joints(record)
    if scale and not most.others and len(scale["joints"][1:]) > 1:
        scale = {**scale, "others": f"; off as well: {plural(len(scale['joints']) - 1, 'joint')}"}
    key, size, lead, elsewhere = verdict_key(record), f"{beyond} beyond noise", "", ""
    misread = scale is not None and joint in scale["joints"]
    # A likely body at the joint itself is said first: it may be why the torque reads a factor.
    first = bool(scale and misread and scale["bodily"] and joint in shown[0]["joints"])
    if scale and first:
        elsewhere = f"{scale['reading']}{scale['others']}: the body may be why."
    elif scale and misread:
        lead = f"{scale['reading']}{f' ({size})' * bool(record.get('where'))}{scale['others']}."
    elif scale:
        elsewhere = f"{scale['reading']}{scale['others']}."
        if joint and not scale["bodily"]:  # else it is what to do first
            elsewhere += f" {sentence(scale['remedy'])}."
    if not misread and shown and joint not in ("", *shown[0]["joints"]) and key != "mostly":  # which says it itself
        acts = _acts_on(shown[0], joint, record)
        there = "where a cause elsewhere is felt" if acts else "and is unexplained there"
        lead = f"The gap is largest at {joint}, {size}, {there}."
    # A gain of a joint that reads a factor is only another name of it.
    other = [one for one in shown if not (scale and misread and _names_factor(one, scale))]
    listed = other or shown
    has = "has a name" if any(map(is_likely, listed[:1])) else "may have a name"
    words = str(TABLES["headlines"].get(key, key.replace("_", " ")))
    size = "" if misread or not joint else f": {joint} is off by {size}"
    rest = _largest_rest(record) if most.rest else ""
    names = _first_names(listed, most, record)
    words = words.format(has=has, named=names, size=size, rest=rest)
    if key == "no_gap":
        words = _headline_without_gap(words, record, misread)
    if scale and misread and scale["bodily"] and not first:
        may_be = MAY_BE_A_BODY.get(key)
        words = f"{may_be}: {names}{rest}." if may_be else f"A load or a link's wrong mass may be why. {words}"
    elif misread and not first and (other or not shown):
        words = f"Beyond that, {words[:1].lower()}{words[1:]}"
    return " ".join(filter(None, (lead, words, elsewhere)))


def _headline_without_gap(words: str, record: Mapping[str, Any], misread: bool) -> str:
    """The verdict where nothing is left once numbers of the URDF are right.

    Args:
        words: The verdict of an arm whose numbers are right.
        record: The diagnosis.
        misread: Whether the leading joint's torque reads a factor.
    """
    wrong = describe_numbers(record)
    joint, share = likeliest_doubt(record)
    doubt = ""
    if joint:
        doubt = f" With {percent(share)} an unnamed cause is left at {joint}."
    if not wrong:
        return f"{words}{doubt}"
    if misread:
        return f"{wrong}{doubt}"
    if joint:
        return f"{wrong} Put right, nothing is left, or with {percent(share)} an unnamed cause at {joint}."
    return f"{wrong} {RIGHTED}"


def _first_names(listed: Sequence[Mapping[str, Any]], most: Most, record: Mapping[str, Any]) -> str:
    """The first names with their joints, the leading one first, and how many more there are."""
    lead = leading_joint(record)[0]
    names = []
    for finding in listed[: most.names]:
        at_the_end = is_likely(finding) and _is_at_the_end(finding, record)
        names.append(MASS_AT_THE_END[_adds_mass(finding)] if at_the_end else called(finding, lead, most.tied))
    joined = "; ".join(names) if " and " in "".join(names) else join_words(names)
    left = len(listed) - most.names
    return f"{joined}, and {left} more" if left > 0 else joined


def _acts_on(finding: Mapping[str, Any], joint: str, record: Mapping[str, Any]) -> bool:
    """Whether a name is felt at a joint: it shows there, or is a body that the joint carries."""
    order = list(record.get("joints", ()))
    carries = finding["effect"] in BODIES and {joint, *finding["joints"]} <= {*order}
    behind = carries and any(order.index(one) > order.index(joint) for one in finding["joints"])
    return behind or joint in joints_shown(finding)


def _names_factor(finding: Mapping[str, Any], off: Mapping[str, Any]) -> bool:
    """Whether a name is a gain, of joints alone that read a factor, and as they do: too much or too little."""
    reads = {joint: float(factor) for joint, factor in READS.findall(off["evidence"])}
    gain = finding.get("parameters", {}).get("gain", {}).get("value")
    alike = all(
        gain is None or joint not in reads or (gain > 0.0) == (reads[joint] > 1.0) for joint in finding["joints"]
    )
    return finding["effect"] in GAINS and {*finding["joints"]} <= {*off["joints"]} and alike


def _largest_rest(record: Mapping[str, Any]) -> str:
    """Where the names leave most beyond noise, and how much."""
    after, gap = (record.get("heldout") or {}).get("rms_after_Nm", {}), record.get("gap", {})
    left = {joint: rms**2 - gap[joint]["noise_floor_Nm"] ** 2 for joint, rms in after.items() if joint in gap}
    joint = max(left, key=left.__getitem__, default="")
    if not joint or left[joint] <= 0.0:
        return ""
    size = in_units_of([joint], record, f"{significant(math.sqrt(left[joint]))} N m")
    return f"; most of the rest is at {joint}, {size} beyond noise"


def called(finding: Mapping[str, Any], lead: str = "", most_tied: int = MOST_NAMED) -> str:
    """A name with its joints, `lead` first; of one less likely than not those of its class, and how likely they are."""
    joints, likely = sorted(finding["joints"], key=lambda one: one != lead), is_likely(finding)
    words = name_with_rivals(finding, most_tied) + place_words(finding["effect"], joints)
    rivals = finding.get("class", ())[1:]
    sure = finding.get("class_probability", 1.0) if rivals else finding["probability"]
    return words if likely else f"{words} ({percent(sure)})"


def name_with_rivals(finding: Mapping[str, Any], most_tied: int = MOST_NAMED) -> str:
    """A name; of one less likely than not those of its class beside it."""
    if is_likely(finding):
        return effect_name(finding["effect"])
    tied = finding.get("class") or [finding["effect"]]
    more = len(tied) - most_tied
    names = " or ".join(map(effect_name, tied[:most_tied]))
    if more <= 0:
        return names
    return f"{names} or another" if more == 1 else f"{names} or one of {more} others"


def place_words(effect: str, joints: Sequence[str]) -> str:
    """Where an effect is; one of the whole arm, as a payload, is in no joint: where it is felt."""
    few = 0 < len(joints) <= MOST_NAMED
    if effect in OF_THE_ARM:
        return f" felt at {join_words(joints)}" if few else ""
    where = join_words(joints) if few else "the whole arm"
    return f" in {where}" if joints else ""


def every_place(effect: str, joints: Sequence[str]) -> str:
    """Where an effect is, however many joints that are."""
    return f" {'felt at' if effect in OF_THE_ARM else 'in'} {join_words(joints)}" if joints else ""


def leading_joint(record: Mapping[str, Any]) -> tuple[str, str]:
    """The joint of the first place, else of the largest gap with a name or factor, or of any; its size beyond noise."""
    factors = [one["joints"] for one in record.get("telemetry", []) if one["issue"] == MISREAD]
    own = set().union(*map(joints_shown, record.get("findings", [])), *factors)
    gaps = [(joint, one) for joint, one in record.get("gap", {}).items() if joint in own or not own]
    found = {joint: math.sqrt(max(one["rms_Nm"] ** 2 - one["noise_floor_Nm"] ** 2, 0.0)) for joint, one in gaps}
    if where := record.get("where"):
        found = {where[0]["joint"]: where[0].get("beyond_noise_Nm", 0.0)}
    joint, size = max(found.items(), key=lambda one: one[1], default=("", 0.0))
    return joint, f"{significant(size)} {in_units_of([joint], record, 'N m')}"


def in_units_of(joints: Iterable[str], record: Mapping[str, Any], text: str, effect: str = "") -> str:
    """What is said of some joints, in the units of those that slide where all do; angles of the whole arm stay."""
    slides = {*record.get("slides", ()), *(joint for joint, gap in record.get("gap", {}).items() if "unit" in gap)}
    if set() < {*joints} <= slides:
        text = text.replace("N m", "N") if effect in OF_THE_ARM else in_linear_units(text)
    return text


def units_of(record: Mapping[str, Any], unit: str = "N m") -> str:
    """A unit of all joints, with that of those that slide beside it."""
    found = {in_units_of([joint], record, unit) for joint in record["joints"]}
    return "; of joints that slide ".join(sorted(found)[::-1])


def in_order_of_joints(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Names as they are shown: those that act at the leading joint first, of them what closes most there.

    Where the leading joint's torque is off by a factor that has a name, such names of other joints stand beside it. A
    gain that nobody measured comes before what is told in its unit.
    """
    lead, findings = leading_joint(record)[0], record.get("findings", [])
    off = [one for one in record.get("telemetry", []) if one["issue"] == MISREAD]
    guessed = {name for one in record.get("telemetry", []) if one["issue"] == "guessed_gains" for name in one["joints"]}
    factors = [one for one in findings if is_likely(one) and any(_names_factor(one, issue) for issue in off)]
    factors = factors if any(lead in one["joints"] for one in factors) else []

    def rank(one: Mapping[str, Any]) -> tuple[bool, bool, bool, float, bool, bool]:
        before, after = (
            one.get("heldout", {}).get(f"rms_{side}_Nm", {}).get(lead, 0.0) for side in ("before", "after")
        )
        elsewhere, fall = lead not in one["joints"], after**2 - before**2
        gain = one["effect"] in GAINS and is_likely(one) and not guessed.isdisjoint(one["joints"])
        return one not in factors, not _acts_on(one, lead, record), not gain, fall, elsewhere, not is_likely(one)

    return sorted(findings, key=rank)


def is_likely(finding: Mapping[str, Any], alike: Collection[str] = ()) -> bool:
    """Whether a name is likelier than not; where its whole class is of one kind, that kind."""
    key = "class_probability" if {*finding.get("class", "?")} <= {*alike} else "probability"
    return bool(finding.get(key, 1.0) >= LIKELY)


def verdict_key(record: Mapping[str, Any]) -> str:
    """The verdict by which words are chosen: of a gap without a name, whether it has names beside it."""
    if record["verdict"] != "none_of_catalogue":
        return str(record["verdict"])
    return "mostly" if record.get("findings") else "none_of_catalogue"


def first_action(record: Mapping[str, Any]) -> str:
    """What to do first, about the leading joint: set its torque if that is off by a factor."""
    scale, (joint, beyond) = _misread(record), leading_joint(record)
    if scale and not scale["bodily"] and joint in ("", *scale["joints"]):
        return f"At {scale['places']}: {scale['remedy']}."
    named = [one for one in in_order_of_joints(record) if not joint or _acts_on(one, joint, record)]
    overtuned, hidden = overtuned_joints(record), tuned_away_joints(record)
    discount_by_discrepancy = any(map(is_likely, named)) or not (overtuned or hidden)
    action = next(filter(None, (order_of(one, record) for one in named)), "")
    if action and discount_by_discrepancy and record["verdict"] not in ("not_testable", "none_of_catalogue"):
        return f"{sentence(action)}."
    if overtuned:
        return "Record this again, longer and wider: several minutes, each joint over its whole range, at all speeds."
    if hidden:
        return f"{beyond} at {joint} may be a load or wrong inertias. " * (joint in hidden) + OWN_INERTIAS
    if record["verdict"] == "no_gap" and describe_numbers(record):
        return WRITE_NUMBERS
    motion = "" if record["verdict"] in ("no_gap", "refused") else _next_motion(record)
    unnamed = f"{beyond} at {joint} are unexplained. " if record.get("findings") and not named else ""
    return f"{unnamed}Record this next: {motion}." if motion else ""


def _misread(record: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What telemetry says of joints whose whole torque is off by a factor, if anything: the leading joint's first.

    None, too, where a likely name says what it is: first of all the gain of every joint that is off, or what turns
    gravity at several joints, as a zero or a mount, and closes the gap there. The first name of all, a likely body that
    the leading joint carries, may be it (`bodily`), so far as it goes.
    """
    off = next((one for one in record.get("telemetry", []) if one["issue"] == MISREAD), None)
    shown = in_order_of_joints(record)
    likely = [one for one in shown if is_likely(one)]
    if off is None or record["verdict"] == "refused":
        return None
    gained = {joint for one in likely if _names_factor(one, off) for joint in one["joints"]}
    if set(off["joints"]) <= gained and _names_factor(likely[0], off):
        return None
    turning = [one for one in likely if one["effect"] in ELSEWHERE - BODIES]
    if {*off["joints"]} <= {joint for one in turning for joint in joints_shown(one) if _explains(one, joint, record)}:
        return None
    lead = leading_joint(record)[0]
    there = bool(shown) and (not lead or _acts_on(shown[0], lead, record))
    body = there and shown[0]["effect"] in BODIES and is_likely(shown[0], BODIES)
    session, _, evidence = off["evidence"].rpartition(": ")
    where = f" in {session}" * (bool(session) and len(record.get("provenance", {}).get("sessions", ())) != 1)
    joints = sorted(off["joints"], key=lambda one: one != lead)
    readings = sorted(evidence.split("; "), key=lambda one: not one.startswith(f"{lead} "))
    others = f"; off as well: {join_words(joints[1:])}" * (len(joints) > 1)
    places = _with_factors(joints, evidence)
    texts = {"reading": f"{readings[0]}{where}", "others": others, "places": places}
    return {**off, **texts, "joints": joints, "bodily": body}


def _with_factors(joints: Sequence[str], evidence: str) -> str:
    """Joints that read a factor; of several each with its own."""
    if len(joints) == 1:
        return joints[0]
    factors = {joint: f"{joint} ({factor})" for joint, factor in READS.findall(evidence)}
    return join_words([factors.get(joint, joint) for joint in joints])


def _explains(finding: Mapping[str, Any], joint: str, record: Mapping[str, Any]) -> bool:
    """Whether a name by itself closes nearly all of what the model errs by at a joint beyond its noise."""
    figures = finding.get("heldout") or {}
    before, after = (figures.get(key, {}).get(joint, math.inf) for key in ("rms_before_Nm", "rms_after_Nm"))
    floor = record.get("gap", {}).get(joint, {}).get("noise_floor_Nm", math.inf)
    left = (1.0 - USUAL_VERDICT.explained) * (before**2 - floor**2)
    return floor < before < math.inf and after**2 - floor**2 <= left


def order_of(finding: Mapping[str, Any], record: Mapping[str, Any]) -> str:
    """What to do about a name; of tied ones that are less likely than not no single order."""
    names = finding.get("class", [])
    action = _with_joint_names(str(finding.get("action", "")), record)
    scale = _misread(record) if record.get("findings") else None
    if action and scale and _names_factor(finding, scale):
        return f"settle the factor above first; what is left of it with all masses tuned: {action}"
    if action and _is_at_the_end(finding, record):
        return f"{AT_THE_END[_adds_mass(finding)]}, {action}"
    if is_likely(finding) or not action or len(names) < 2:
        return action
    lead, motion = leading_joint(record)[0], _next_motion(record)
    joint = lead if lead in finding["joints"] else finding["joints"][0]
    parted = set(names[:2]) <= set((record.get("next_experiment") or {}).get("separates", ()))
    if not parted or ("--joint" in motion and f"--joint {joint} " not in f"{motion} "):
        motion = f"`plan excite --robot … --separate {names[0]},{names[1]} --joint {joint}` works the motion out"
        motion = setup_for(names[:2], CATALOGUE) or motion
    elif setup := setup_for(names[:2], CATALOGUE):
        motion = setup
    tied = " or ".join(effect_name(name) for name in names[:MOST_TIED])
    return f"act on none yet, for it may be {tied} in {joint}; record this to tell them apart: {motion}"


def _with_joint_names(text: str, record: Mapping[str, Any]) -> str:
    """A sentence with the names of joints that an effect counts from the base."""
    joints = record.get("joints", ())

    def name(counted: re.Match[str]) -> str:
        number = int(counted[1])
        return str(joints[number - 1]) if 0 < number <= len(joints) else counted[0]

    return re.sub(r"joint number (\d+)", name, text)


def _is_at_the_end(finding: Mapping[str, Any], record: Mapping[str, Any]) -> bool:
    """Whether a link's mass is what the check of the recordings has found at the arm's end."""
    bodies = [issue for issue in record.get("telemetry", ()) if issue["issue"] == BODY]
    checked = {joint for issue in bodies for joint in issue["joints"]}
    places = {*finding["joints"], *(place["joint"] for place in finding.get("elsewhere", ()))}
    may_be_carried = not BODIES.isdisjoint(finding.get("class", ())[1:])
    changes_link = finding["effect"] in BODIES and "mass_change_kg" in finding.get("parameters", {})
    return changes_link and bool(checked) and (may_be_carried or not checked.isdisjoint(places))


def _adds_mass(finding: Mapping[str, Any]) -> bool:
    """Whether a link weighs more than its URDF has it."""
    return bool(finding["parameters"]["mass_change_kg"]["value"] > 0.0)


def _next_motion(record: Mapping[str, Any]) -> str:
    return str((record.get("next_experiment") or {}).get("motion", "")).removeprefix(NO_MOTION)


# What the check of the recordings says of a body at the arm's end.
BODY = "body_differs"
MASS_AT_THE_END = {
    False: "less mass at the arm's end than the URDF has",
    True: "more mass at the arm's end than the URDF has",
}
# What to do about that first, of a mass too much in the URDF and of one that it lacks.
AT_THE_END = {
    False: "take the hand or tool that is not mounted out of the URDF; if all of it is",
    True: "give what the arm carries at its end as [payload] of session.toml; if it carries nothing",
}
# A name below is less likely than not.
LIKELY = 0.5
# A chance of one in five that something is left at a joint is worth saying.
WORTH_SAYING = 0.2
# Tied names that one sentence holds.
MOST_TIED = MOST_NAMED
# What a motion's words begin with where it takes more than motion.
NO_MOTION = "Motion alone hardly tells these apart. "
OWN_INERTIAS = (
    "Give what the flange carries as [payload] of session.toml; if it carries nothing, fit the arm's own inertias "
    "(`ident fit`) and give them with `--model`."
)


# Where nothing but numbers of the URDF is wrong: what is left once they are right, and how they get there.
RIGHTED = "Put right, it is as good as these recordings can tell."
# A factor that a likely body at the arm explains, by the verdict.
MAY_BE_A_BODY = {"named": "It may be a body", "partial": "Part of it may be a body"}
PATCH = (
    "`ident patch why.json --robot … --out patched --into MINE.urdf`, or MINE.xml "
    "(why.json is what `--json why.json` writes here)."
)
WRITE_NUMBERS = f"Write these numbers into your model: {PATCH}"


def likeliest_doubt(record: Mapping[str, Any]) -> tuple[str, float]:
    """Where a cause without a name is likeliest left, and how likely; no joint where that is hardly likely."""
    left = record.get("leftover", {})
    joint = max(left, key=left.__getitem__, default="")
    if not joint or left[joint] < WORTH_SAYING:
        return "", 0.0
    return joint, left[joint]


def noise_is_left(record: Mapping[str, Any]) -> list[str]:
    """Joints whose noise is what the names leave, to the digits shown: nothing but noise is believed left there."""
    after = (record.get("heldout") or {}).get("rms_after_Nm", {}) if record.get("findings") else {}
    gaps = record.get("gap", {})
    left = {joint: after.get(joint, gap["rms_Nm"]) for joint, gap in gaps.items()}
    return [joint for joint, gap in gaps.items() if f"{left[joint]:.3f}" == f"{gap['noise_floor_Nm']:.3f}"]


def describe_noise(record: Mapping[str, Any]) -> str:
    """Why noise and what is left are one figure at some joints, or at all; empty where they are at none."""
    alike = noise_is_left(record)
    if not alike:
        return ""
    at_all = len(alike) == len(record["gap"])
    where = "What is left" if at_all else f"What is left at {join_words(alike)}"
    there = "at no joint" if at_all else "there"
    sure = "is a cause without a name likelier than not" if at_all else "no cause without a name is likelier than not"
    return f"{where} is counted as noise: {there} {sure}."


def tuned_away_joints(record: Mapping[str, Any]) -> list[str]:
    """Joints whose torque only inertias beyond the URDF's tolerance explain, the loudest first."""
    hidden = {
        joint: gap["tuned_away_Nm"] / max(gap["noise_floor_Nm"], 1e-12)
        for joint, gap in record.get("gap", {}).items()
        if gap.get("tuned_away_Nm", 0.0) > gap["noise_floor_Nm"]
    }
    return sorted(hidden, key=lambda joint: -hidden[joint])


def overtuned_joints(record: Mapping[str, Any]) -> list[str]:
    """Joints that the tuned model, with the names, foretells worse on unseen runs than the model as it was given."""
    after, gaps = (record.get("heldout") or {}).get("rms_after_Nm", {}), record.get("gap", {})
    left = {joint: min(gap["rms_Nm"], after.get(joint, math.inf)) for joint, gap in gaps.items()}
    return [joint for joint, gap in gaps.items() if left[joint] > OVERTUNED * gap.get("fixed_rms_Nm", math.inf)]


def joints_tuned_away(record: Mapping[str, Any]) -> set[str]:
    """Joints at which tuning hides a named effect, which is judged by the model before tuning."""
    hidden = [
        finding for finding in record.get("findings", []) if finding.get("evidence", {}).get("judged_against") == "urdf"
    ]
    return set[str]().union(*map(joints_shown, hidden))


def describe_findings(record: Mapping[str, Any]) -> str:
    """How far the named effects shrink the gap: where tuning hides one, that of the model before tuning."""
    heldout, gaps, findings = record.get("heldout") or {}, record.get("gap", {}), record.get("findings", [])
    if not findings or "shrink" not in heldout:
        return ""
    absorbed = joints_tuned_away(record)
    named = set[str]().union(*map(joints_shown, findings))
    new, old = heldout.get("rms_after_Nm", {}), heldout.get("rms_before_Nm", {})
    old = {**old, **{joint: gaps[joint]["fixed_rms_Nm"] for joint in absorbed}}
    parts = [
        f"{joint} {significant(old.get(joint))} → {significant(new.get(joint))}" for joint in gaps if joint in named
    ]
    squares = np.array([(old[joint], new[joint], gaps[joint]["noise_floor_Nm"]) for joint in absorbed]) ** 2
    share, since = heldout["shrink"], ""
    if absorbed:
        before, after, floor = squares.sum(axis=0)
        share, since = (before - after) / max(before - floor, 1e-12), ", counted from the model before tuning"
    amount = "nothing" if share <= 0.0 else percent(share)
    closes = f"On parts that the fit never saw all names close {amount} of what can be closed{since}"
    return f"{closes}. Torque error [{units_of(record)}]: {', '.join(parts)}." if parts else f"{closes}."


def describe_reservations(record: Mapping[str, Any]) -> list[str]:
    """Reasons to doubt: what fits and is not believed, by reason, and a replay that ends far off.

    A reason reads "what was found: why no arm is like that"; effects that share the second part make one sentence, with
    what was found of the first.
    """
    alike, doubts = dict[str, list[Mapping[str, Any]]](), []
    for one in record.get("reservations", []):
        if one["effect"]:
            alike.setdefault(one["reason"].split(": ")[-1], []).append(one)
        else:
            doubts.append(f"Doubt: {one['reason']}.")
    return [*(_describe_unbelieved(some, record) for some in alike.values()), *doubts]


def _describe_unbelieved(some: Sequence[Mapping[str, Any]], record: Mapping[str, Any]) -> str:
    """One sentence about effects that fit and are not believed for one reason."""
    joints = dict[str, dict[str, None]]()
    for one in some:
        joints.setdefault(one["effect"], {}).update(dict.fromkeys(one["joints"]))
    places = [effect_name(effect) + every_place(effect, list(where)) for effect, where in joints.items()]
    names = join_words(places)
    first = some[0]
    reason = in_units_of(first["joints"], record, with_units(first["reason"]), first["effect"])
    if len(some) == 1 or ": " not in reason:
        return f"Not believed: {names} would fit, but {reason}."
    return f"Not believed, though they would fit: {names}. Of the first, {reason}."


def describe_unnamed(record: Mapping[str, Any]) -> str:
    """What speaks for a gap beside, or without, any name: inertias tuned too far, a candidate that came near."""
    parts = []
    if worse := overtuned_joints(record):
        joint = max(worse, key=lambda name: record["gap"][name]["rms_Nm"])
        before, after = (significant(record["gap"][joint][key]) for key in ("fixed_rms_Nm", "rms_Nm"))
        parts.append(
            f"These recordings are too few to tune a model on: tuned on one part of them it is further off on the rest "
            f"than as it was given ({joint}: {before} → {after} N m), so little can be concluded."
        )
    if hidden := tuned_away_joints(record):
        parts.append(
            "The tuned inertias lie farther from the given ones than their tolerance allows; what they hide acts most "
            f"on {join_words(hidden[:2])}. Wrong links in the URDF, a load or a wrong gain look like this."
        )
        if not first_action(record).endswith(OWN_INERTIAS):
            parts.append(OWN_INERTIAS)
    return " ".join(parts)


def describe_motion(record: Mapping[str, Any]) -> str:
    """By how much the replayed motion comes nearer, of the joints that the names are about."""
    forward = (record.get("heldout") or {}).get("forward")
    if not record.get("findings") or not forward:
        return ""
    before, after = (forward["position_rms_rad"][key] for key in ("before", "after"))
    named = [joint for joint in before if any(joint in one["joints"] for one in record["findings"])]
    parts = [f"{joint} {fixed(1e3 * before[joint], 1)} → {fixed(1e3 * after[joint], 1)}" for joint in named]
    window = f"after {1e3 * forward['window_s']:.0f} ms by [{units_of(record, 'mrad')}]"
    return f"Replayed under the recorded torques, the motion is off {window}: {', '.join(parts)}." if parts else ""


def energy_pair(heldout: Mapping[str, Any], when: str, runs: int) -> str:
    """Mean energy error of a run, with its spread over the runs where there are several."""
    spread = heldout.get(f"energy_error_{when}_std_J") if runs > 1 else None
    return pair(heldout.get(f"energy_error_{when}_J"), spread)
