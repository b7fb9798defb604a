"""A diagnosis in words: its verdict, what to do first, what is not known.

One order holds for all words, that of the map: the joint of its first place leads, one whose whole
torque is off by a factor, else of the largest gap. The first line begins with it, what to do first
is about it, and of the names those that show there come first. A factor of a joint that has no gap
is said after the verdict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ident.checks.report import MISREAD
from ident.diagnosis.next_experiment import LIKELY, joints_shown
from ident.diagnosis.settings import USUAL_VERDICT
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import setup_for
from ident.errors import join_words, plural
from ident.show.report.numbers import MOST_NAMED, describe_numbers
from ident.show.report.words import (
    TABLES,
    effect_name,
    fixed,
    pair,
    percent,
    sentence,
    significant,
    with_units,
)
from ident.units import FORCE, TORQUE, in_linear_units

# Tuned on other runs a model that errs by so many times what it does untuned has learned what does
# not carry over.
OVERTUNED = 2.0
BODIES = {effect.id for effect in CATALOGUE if effect.as_change.body}
GAINS = {effect.id for effect in CATALOGUE if effect.as_change.exact and effect.as_change.common_gain}
OF_THE_ARM = {effect.id for effect in CATALOGUE if effect.scope == "arm"}
# They act on other joints' torque, too.
ELSEWHERE = {effect.id for effect in CATALOGUE if effect.rows == "all"}
# A joint that reads a factor, and the factor, in what the telemetry check says.
READS = re.compile(r"(\S+) reads (-?\d+\.\d+)")
# A first line that is longer says less, step by step [characters].
LONGEST_HEADLINE = 200
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
# A chance of one in five that something is left at a joint is worth saying.
WORTH_SAYING = 0.2
# Tied names that one sentence holds.
MOST_TIED = MOST_NAMED
# What a motion's words begin with where it takes more than motion.
NO_MOTION = "Motion alone hardly tells these apart. "
OWN_INERTIAS = (
    "Give what the flange carries as [payload] of session.toml; if it carries nothing, fit the "
    "arm's own inertias (`ident fit`) and give them with `--model`."
)
RECORD_WIDER = "Record this again, longer and wider: several minutes, each joint over its whole range, at all speeds."
# Where nothing but numbers of the URDF is wrong: what is left once they are right, and how they get
# there.
RIGHTED = "Put right, it is as good as these recordings can tell."
# A factor that a likely body at the arm explains, by the verdict.
MAY_BE_A_BODY = {"named": "It may be a body", "partial": "Part of it may be a body"}
PATCH = (
    "`ident patch why.json --robot … --out patched --into MINE.urdf`, or MINE.xml "
    "(why.json is what `--json why.json` writes here)."
)
WRITE_NUMBERS = f"Write these numbers into your model: {PATCH}"
# Verdicts of which no name tells what to do.
WITHOUT_ACTION = ("not_testable", "none_of_catalogue")
# Verdicts after which no motion is asked for.
WITHOUT_MOTION = ("no_gap", "refused")

Finding = Mapping[str, Any]
"""A name's record in `findings`."""


class Most(NamedTuple):
    """How much a first line has in it at most."""

    names: int
    tied: int  # of a name that is less likely than not, those that it may be
    rest: bool = False  # whether it says what the names leave
    others: bool = True  # whether it names the joints, but the first, that read a factor
    # Whether sizes that stand in a table below, and places beside the leading joint, are left to it.
    brief: bool = False


# From a whole line to the shortest.
FEWER = (
    *(Most(names, MOST_NAMED, rest=True) for names in range(MOST_NAMED, 0, -1)),
    *(Most(1, tied) for tied in range(MOST_NAMED, 0, -1)),
    Most(1, 1, brief=True),
    Most(1, 1, others=False, brief=True),
)


def diagnosis_headline(record: Mapping[str, Any]) -> str:
    """The leading joint's gap if no effect of its own explains it, the verdict, and a factor of a
    torque elsewhere.

    As many names, and as many that they can't be told from, as one line holds; all of them stand in
    the list below it.
    """
    line = ""
    for most in FEWER:
        line = _headline_of(record, most)
        if len(line) <= LONGEST_HEADLINE:
            return line
    return line


def _headline_of(record: Mapping[str, Any], most: Most) -> str:
    """The first line with so much in it at most."""
    scale = _misread(record)
    if scale and not most.others and len(scale["joints"]) > 2:
        others = plural(len(scale["joints"]) - 1, "joint")
        scale = {**scale, "others": f"; off as well: {others}"}
    joint, beyond = leading_joint(record)
    shown = in_order_of_joints(record)
    key = verdict_key(record)
    size = f"{beyond} beyond noise"
    misread = scale is not None and joint in scale["joints"]
    # A likely body at the joint itself is said first: it may be why the torque reads a factor.
    first = bool(scale and misread and scale["bodily"] and joint in shown[0]["joints"])
    lead = ""
    elsewhere = ""
    if scale and first:
        elsewhere = f"{scale['reading']}{scale['others']}: the body may be why."
    elif scale and misread:
        gap = f" ({size})" if record.get("where") and not most.brief else ""
        lead = f"{scale['reading']}{gap}{scale['others']}."
    elif scale:
        elsewhere = f"{scale['reading']}{scale['others']}."
        if joint and not scale["bodily"]:  # else it is what to do first
            elsewhere += f" {sentence(scale['remedy'])}."
    # The verdict `mostly` says itself where the gap is.
    is_elsewhere = bool(shown) and joint not in ("", *shown[0]["joints"])
    if not misread and is_elsewhere and key != "mostly":
        acts = _acts_on(shown[0], joint, record)
        there = "where a cause elsewhere is felt" if acts else "and is unexplained there"
        lead = f"The gap is largest at {joint}, {size}, {there}."
    # A gain of a joint that reads a factor is only another name of it.
    other = shown
    if scale and misread:
        other = [finding for finding in shown if not _names_factor(finding, scale)]
    listed = other or shown
    words = _verdict_words(record, listed, most, misread)
    if scale and misread and scale["bodily"] and not first:
        may_be = MAY_BE_A_BODY.get(key)
        rest = _largest_rest(record) if most.rest else ""
        if may_be:
            words = f"{may_be}: {_first_names(listed, most, record)}{rest}."
        else:
            words = f"A load or a link's wrong mass may be why. {words}"
    elif misread and not first and (other or not shown):
        words = f"Beyond that, {words[:1].lower()}{words[1:]}"
    return " ".join(text for text in (lead, words, elsewhere) if text)


def _verdict_words(
    record: Mapping[str, Any],
    listed: Sequence[Finding],
    most: Most,
    misread: bool,
) -> str:
    """The verdict as a sentence, and what may be wrong though there is no gap.

    Args:
        record: The diagnosis.
        listed: Its names in their order.
        most: How much is said.
        misread: Whether the leading joint's torque is off by a factor, which is said before.
    """
    key = verdict_key(record)
    joint, beyond = leading_joint(record)
    pattern = str(TABLES["headlines"].get(key, key.replace("_", " ")))
    has = "has a name" if listed and is_likely(listed[0]) else "may have a name"
    size = "" if misread or not joint else f": {joint} is off by {beyond} beyond noise"
    rest = _largest_rest(record) if most.rest else ""
    named = _first_names(listed, most, record)
    words = pattern.format(has=has, named=named, size=size, rest=rest)
    return _words_without_gap(words, record, misread, most.brief) if key == "no_gap" else words


def _words_without_gap(words: str, record: Mapping[str, Any], misread: bool, brief: bool) -> str:
    """The verdict where nothing is left once numbers of the URDF are right.

    Args:
        words: The verdict of an arm whose numbers are right.
        record: The diagnosis.
        misread: Whether the leading joint's torque is off by a factor, which is said before.
        brief: Whether one number of the URDF's is to be enough.
    """
    wrong = describe_numbers(record, brief)
    joint, share = likeliest_doubt(record)
    doubt = f" With {percent(share)} an unnamed cause is left at {joint}." if joint else ""
    if not wrong:
        return f"{words}{doubt}"
    if misread:
        return f"{wrong}{doubt}"
    if joint:
        left = f"with {percent(share)} an unnamed cause at {joint}"
        return f"{wrong} Put right, nothing is left, or {left}."
    return f"{wrong} {RIGHTED}"


def _first_names(listed: Sequence[Finding], most: Most, record: Mapping[str, Any]) -> str:
    """The first names with their joints, the leading one first, and how many more there are."""
    lead = leading_joint(record)[0]
    names = []
    for finding in listed[: most.names]:
        likely = is_likely(finding, BODIES if finding["effect"] in OF_THE_ARM else ())
        if likely and _is_at_the_end(finding, record):
            names.append(MASS_AT_THE_END[_adds_mass(finding)])
        else:
            names.append(called(finding, lead, most.tied, most.brief))
    joined = "; ".join(names) if " and " in "".join(names) else join_words(names)
    left = len(listed) - most.names
    return f"{joined}, and {left} more" if left > 0 else joined


def _acts_on(finding: Finding, joint: str, record: Mapping[str, Any]) -> bool:
    """Whether a name is felt at a joint: it shows there, or is a body that the joint carries."""
    if joint in joints_shown(finding):
        return True
    order = list(record.get("joints", ()))
    if finding["effect"] not in BODIES or not {joint, *finding["joints"]} <= set(order):
        return False
    return any(order.index(other) > order.index(joint) for other in finding["joints"])


def _names_factor(finding: Finding, off: Mapping[str, Any]) -> bool:
    """Whether a name is a gain, of joints alone that read a factor, and as they do: too much or too
    little.
    """
    if finding["effect"] not in GAINS or not set(finding["joints"]) <= set(off["joints"]):
        return False
    gain = finding.get("parameters", {}).get("gain", {}).get("value")
    if gain is None:
        return True
    reads = {joint: float(factor) for joint, factor in READS.findall(off["evidence"])}
    known = [reads[joint] for joint in finding["joints"] if joint in reads]
    return all((gain > 0.0) == (factor > 1.0) for factor in known)


def _largest_rest(record: Mapping[str, Any]) -> str:
    """Where the names leave most beyond noise, and how much."""
    after = (record.get("heldout") or {}).get("rms_after_Nm", {})
    gap = record.get("gap", {})
    left = {}
    for joint, rms in after.items():
        if joint in gap:
            left[joint] = rms**2 - gap[joint]["noise_floor_Nm"] ** 2
    worst = max(left, key=left.__getitem__, default="")
    if not worst or left[worst] <= 0.0:
        return ""
    size = in_units_of([worst], record, f"{significant(math.sqrt(left[worst]))} {TORQUE}")
    return f"; most of the rest is at {worst}, {size} beyond noise"


def called(finding: Finding, lead: str = "", most_tied: int = MOST_TIED, brief: bool = False) -> str:
    """A name with its joints; of one less likely than not those of its class, and how likely they
    are.

    Args:
        finding: The name.
        lead: The joint that is said first.
        most_tied: How many of its class are said at most.
        brief: Whether one of the joints where it is felt is enough.
    """
    joints = sorted(finding["joints"], key=lambda joint: joint != lead)
    if brief and finding["effect"] in OF_THE_ARM:
        joints = joints[:1]
    words = name_with_rivals(finding, most_tied) + place_words(finding["effect"], joints)
    if is_likely(finding):
        return words
    has_rivals = len(finding.get("class", ())) > 1
    sure = finding.get("class_probability", 1.0) if has_rivals else finding["probability"]
    return f"{words} ({percent(sure)})"


def name_with_rivals(finding: Finding, most_tied: int = MOST_TIED) -> str:
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
    """Where an effect is, to follow its name: " in joint_2", " felt at joint_2".

    One of the whole arm, as a payload, is in no joint: it is told where it is felt.

    Returns:
        With a blank before it; "" where nothing can be said.
    """
    few = 0 < len(joints) <= MOST_NAMED
    if effect in OF_THE_ARM:
        return f" felt at {join_words(joints)}" if few else ""
    where = join_words(joints) if few else "the whole arm"
    return f" in {where}" if joints else ""


def every_place(effect: str, joints: Sequence[str]) -> str:
    """Where an effect is, all joints named, to follow its name; "" without joints."""
    if not joints:
        return ""
    word = "felt at" if effect in OF_THE_ARM else "in"
    return f" {word} {join_words(joints)}"


def leading_joint(record: Mapping[str, Any]) -> tuple[str, str]:
    """The joint that all words begin with, and its gap beyond noise with its unit.

    The joint of the map's first place, else that of the largest gap with a name or a factor, or of
    any; "" where there is none.
    """
    sizes: dict[str, float] = {}
    where = record.get("where")
    if where:
        sizes = {where[0]["joint"]: where[0].get("beyond_noise_Nm", 0.0)}
    else:
        spoken_of: set[str] = set()
        for finding in record.get("findings", []):
            spoken_of.update(joints_shown(finding))
        for issue in _issues(record, MISREAD):
            spoken_of.update(issue["joints"])
        for joint, gap in record.get("gap", {}).items():
            if joint in spoken_of or not spoken_of:
                beyond = gap["rms_Nm"] ** 2 - gap["noise_floor_Nm"] ** 2
                sizes[joint] = math.sqrt(max(beyond, 0.0))
    lead = max(sizes, key=sizes.__getitem__, default="")
    size = sizes.get(lead, 0.0)
    return lead, f"{significant(size)} {in_units_of([lead], record, TORQUE)}"


def _issues(record: Mapping[str, Any], kind: str) -> list[Mapping[str, Any]]:
    """What the check of the recordings says of one kind."""
    return [issue for issue in record.get("telemetry", ()) if issue["issue"] == kind]


def in_units_of(joints: Iterable[str], record: Mapping[str, Any], text: str, effect: str = "") -> str:
    """What is said of some joints, in the units of those that slide where all do; angles of the
    whole arm stay.
    """
    slides = set(record.get("slides", ()))
    slides.update(joint for joint, gap in record.get("gap", {}).items() if "unit" in gap)
    concerned = set(joints)
    if not concerned or not concerned <= slides:
        return text
    if effect in OF_THE_ARM:
        return text.replace(TORQUE, FORCE)
    return in_linear_units(text)


def units_of(record: Mapping[str, Any], unit: str = TORQUE) -> str:
    """A unit of all joints, with that of those that slide beside it."""
    units = {in_units_of([joint], record, unit) for joint in record["joints"]}
    return "; of joints that slide ".join(sorted(units)[::-1])


def in_order_of_joints(record: Mapping[str, Any]) -> list[Finding]:
    """Names as they are shown: those that act at the leading joint first, of them what closes most
    there.

    Where the leading joint's torque is off by a factor that has a name, such names of other joints
    stand beside it. A gain that nobody measured comes before what is told in its unit.
    """
    lead = leading_joint(record)[0]
    findings = record.get("findings", [])
    off = _issues(record, MISREAD)
    guessed: set[str] = set()
    for issue in _issues(record, "guessed_gains"):
        guessed.update(issue["joints"])

    def names_one_of_them(finding: Finding) -> bool:
        return is_likely(finding) and any(_names_factor(finding, issue) for issue in off)

    factors = list(filter(names_one_of_them, findings))
    if not any(lead in finding["joints"] for finding in factors):
        factors = []

    def rank(finding: Finding) -> tuple[bool, bool, bool, float, bool, bool]:
        """What sorts first, in turn: False before True, a larger fall of the square before less."""
        figures = finding.get("heldout", {})
        before = figures.get("rms_before_Nm", {}).get(lead, 0.0)
        after = figures.get("rms_after_Nm", {}).get(lead, 0.0)
        is_gain = finding["effect"] in GAINS and is_likely(finding)
        return (
            finding not in factors,
            not _acts_on(finding, lead, record),
            not (is_gain and not guessed.isdisjoint(finding["joints"])),
            after**2 - before**2,
            lead not in finding["joints"],
            not is_likely(finding),
        )

    return sorted(findings, key=rank)


def is_likely(finding: Finding, alike: Collection[str] = ()) -> bool:
    """Whether a name is likelier than not; where its whole class is of one kind, that kind.

    Args:
        finding: The name.
        alike: The effects of that kind, by id.
    """
    key = "class_probability" if {*finding.get("class", "?")} <= {*alike} else "probability"
    return bool(finding.get(key, 1.0) >= LIKELY)


def verdict_key(record: Mapping[str, Any]) -> str:
    """The verdict by which words are chosen: of a gap without a name, whether it has names beside
    it.
    """
    if record["verdict"] != "none_of_catalogue":
        return str(record["verdict"])
    return "mostly" if record.get("findings") else "none_of_catalogue"


def first_action(record: Mapping[str, Any]) -> str:
    """What to do first, about the leading joint: set its torque right if that is off by a factor.

    Args:
        record: Of a diagnosis, `ident.diagnosis/1`.

    Returns:
        One or two sentences with their full stops; "" where there is nothing to do.
    """
    scale = _misread(record)
    joint, beyond = leading_joint(record)
    if scale and not scale["bodily"] and joint in ("", *scale["joints"]):
        return f"At {scale['places']}: {scale['remedy']}."
    named = in_order_of_joints(record)
    if joint:
        named = [finding for finding in named if _acts_on(finding, joint, record)]
    overtuned = overtuned_joints(record)
    hidden = tuned_away_joints(record)
    orders = (order_of(finding, record) for finding in named)
    action = next((order for order in orders if order), "")
    is_sound = any(map(is_likely, named)) or not (overtuned or hidden)
    if action and is_sound and record["verdict"] not in WITHOUT_ACTION:
        return f"{sentence(action)}."
    if overtuned:
        return RECORD_WIDER
    if hidden and joint in hidden:
        return f"{beyond} at {joint} may be a load or wrong inertias. {OWN_INERTIAS}"
    if hidden:
        return OWN_INERTIAS
    if record["verdict"] == "no_gap" and describe_numbers(record):
        return WRITE_NUMBERS
    motion = "" if record["verdict"] in WITHOUT_MOTION else _next_motion(record)
    if not motion:
        return ""
    is_unnamed = record.get("findings") and not named
    unnamed = f"{beyond} at {joint} are unexplained. " if is_unnamed else ""
    return f"{unnamed}Record this next: {motion}."


def _misread(record: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What telemetry says of joints whose whole torque is off by a factor, if anything: the leading
    joint's first.

    None, too, where a likely name says what it is: first of all the gain of every joint that is
    off, or what turns gravity at several joints, as a zero or a mount, and closes the gap there.
    The first name of all, a likely body that the leading joint carries, may be it (`bodily`), so
    far as it goes.
    """
    issues = _issues(record, MISREAD)
    if not issues or record["verdict"] == "refused":
        return None
    off = issues[0]
    shown = in_order_of_joints(record)
    likely = [finding for finding in shown if is_likely(finding)]
    if _gains_explain(off, likely) or _turning_explains(off, likely, record):
        return None
    lead = leading_joint(record)[0]
    acts = bool(shown) and (not lead or _acts_on(shown[0], lead, record))
    body = acts and shown[0]["effect"] in BODIES and is_likely(shown[0], BODIES)
    session, _, evidence = off["evidence"].rpartition(": ")
    is_one_session = len(record.get("provenance", {}).get("sessions", ())) == 1
    where = f" in {session}" if session and not is_one_session else ""
    joints = sorted(off["joints"], key=lambda joint: joint != lead)
    readings = sorted(evidence.split("; "), key=lambda text: not text.startswith(f"{lead} "))
    others = f"; off as well: {join_words(joints[1:])}" if len(joints) > 1 else ""
    return {
        **off,
        "reading": f"{readings[0]}{where}",
        "others": others,
        "places": _with_factors(joints, evidence),
        "joints": joints,
        "bodily": body,
    }


def _gains_explain(off: Mapping[str, Any], likely: Sequence[Finding]) -> bool:
    """Whether gains, the first of the likely names among them, are the factors of all joints that
    are off.
    """
    gained: set[str] = set()
    for finding in likely:
        if _names_factor(finding, off):
            gained.update(finding["joints"])
    return set(off["joints"]) <= gained and _names_factor(likely[0], off)


def _turning_explains(off: Mapping[str, Any], likely: Sequence[Finding], record: Mapping[str, Any]) -> bool:
    """Whether names that turn gravity close the gap at all joints that are off."""
    explained: set[str] = set()
    for finding in likely:
        if finding["effect"] in ELSEWHERE - BODIES:
            places = joints_shown(finding)
            explained.update(joint for joint in places if _explains(finding, joint, record))
    return set(off["joints"]) <= explained


def _with_factors(joints: Sequence[str], evidence: str) -> str:
    """Joints that read a factor; of several each with its own."""
    if len(joints) == 1:
        return joints[0]
    factors = {joint: f"{joint} ({factor})" for joint, factor in READS.findall(evidence)}
    return join_words([factors.get(joint, joint) for joint in joints])


def _explains(finding: Finding, joint: str, record: Mapping[str, Any]) -> bool:
    """Whether a name by itself closes nearly all of what the model errs by at a joint beyond its
    noise.
    """
    figures = finding.get("heldout") or {}
    before = figures.get("rms_before_Nm", {}).get(joint, math.inf)
    after = figures.get("rms_after_Nm", {}).get(joint, math.inf)
    floor = record.get("gap", {}).get(joint, {}).get("noise_floor_Nm", math.inf)
    left = (1.0 - USUAL_VERDICT.explained) * (before**2 - floor**2)
    return floor < before < math.inf and after**2 - floor**2 <= left


def order_of(finding: Finding, record: Mapping[str, Any]) -> str:
    """What to do about a name; of tied ones that are less likely than not no single order."""
    names = finding.get("class", [])
    action = _with_joint_names(str(finding.get("action", "")), record)
    scale = _misread(record) if record.get("findings") else None
    if action and scale and _names_factor(finding, scale):
        what = "settle the factor above first; what is left of it with all masses tuned"
        return f"{what}: {action}"
    if action and _is_at_the_end(finding, record):
        if finding["effect"] in OF_THE_ARM:  # nothing else than what the check has weighed
            return str(_issues(record, BODY)[0]["remedy"])
        return f"{AT_THE_END[_adds_mass(finding)]}, {action}"
    if is_likely(finding) or not action or len(names) < 2:
        return action
    lead = leading_joint(record)[0]
    joint = lead if lead in finding["joints"] else finding["joints"][0]
    motion = _parting_motion(names[:2], joint, record)
    tied = " or ".join(effect_name(name) for name in names[:MOST_TIED])
    what = f"act on none yet, for it may be {tied} in {joint}"
    return f"{what}; record this to tell them apart: {motion}"


def _parting_motion(pair_of: Sequence[str], joint: str, record: Mapping[str, Any]) -> str:
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


def _with_joint_names(text: str, record: Mapping[str, Any]) -> str:
    """A sentence with the names of joints that an effect counts from the base."""
    joints = record.get("joints", ())

    def name(counted: re.Match[str]) -> str:
        number = int(counted[1])
        return str(joints[number - 1]) if 0 < number <= len(joints) else counted[0]

    return re.sub(r"joint number (\d+)", name, text)


def _is_at_the_end(finding: Finding, record: Mapping[str, Any]) -> bool:
    """Whether a mass is what the check of the recordings has found at the arm's end."""
    if finding["effect"] not in BODIES or _mass_of(finding) is None:
        return False
    checked: set[str] = set()
    for issue in _issues(record, BODY):
        checked.update(issue["joints"])
    if checked and finding["effect"] in OF_THE_ARM:
        return is_likely(finding, BODIES)
    places = set(finding["joints"])
    places.update(place["joint"] for place in finding.get("elsewhere", ()))
    may_be_carried = not BODIES.isdisjoint(finding.get("class", ())[1:])
    return bool(checked) and (may_be_carried or not checked.isdisjoint(places))


def _adds_mass(finding: Finding) -> bool:
    """Whether a body weighs more than the URDF has it."""
    mass = _mass_of(finding)
    return mass is not None and mass > 0.0


def _mass_of(finding: Finding) -> float | None:
    """What a body weighs beyond the URDF [kg]; None of what is no mass."""
    parameters = finding.get("parameters", {})
    known = [parameters[key]["value"] for key in ("mass_change_kg", "mass_kg") if key in parameters]
    return float(known[0]) if known else None


def _next_motion(record: Mapping[str, Any]) -> str:
    """The motion to record next, in words; "" where none is known."""
    motion = str((record.get("next_experiment") or {}).get("motion", ""))
    return motion.removeprefix(NO_MOTION)


def likeliest_doubt(record: Mapping[str, Any]) -> tuple[str, float]:
    """Where a cause without a name is likeliest left, and how likely.

    Returns:
        The joint and the probability; "" and 0 where that is hardly likely.
    """
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
    hidden = {}
    for joint, gap in record.get("gap", {}).items():
        if gap.get("tuned_away_Nm", 0.0) > gap["noise_floor_Nm"]:
            hidden[joint] = gap["tuned_away_Nm"] / max(gap["noise_floor_Nm"], 1e-12)
    return sorted(hidden, key=lambda joint: -hidden[joint])


def overtuned_joints(record: Mapping[str, Any]) -> list[str]:
    """Joints that the tuned model, with the names, foretells worse on unseen runs than the model as
    it was given.
    """
    after = (record.get("heldout") or {}).get("rms_after_Nm", {})
    overtuned = []
    for joint, gap in record.get("gap", {}).items():
        left = min(gap["rms_Nm"], after.get(joint, math.inf))
        if left > OVERTUNED * gap.get("fixed_rms_Nm", math.inf):
            overtuned.append(joint)
    return overtuned


def joints_tuned_away(record: Mapping[str, Any]) -> set[str]:
    """Joints at which tuning hides a named effect, which is judged by the model before tuning."""
    joints: set[str] = set()
    for finding in record.get("findings", []):
        if finding.get("evidence", {}).get("judged_against") == "urdf":
            joints.update(joints_shown(finding))
    return joints


def describe_findings(record: Mapping[str, Any]) -> str:
    """How far the named effects shrink the gap: where tuning hides one, that of the model before
    tuning.
    """
    heldout = record.get("heldout") or {}
    gaps = record.get("gap", {})
    findings = record.get("findings", [])
    if not findings or "shrink" not in heldout:
        return ""
    absorbed = joints_tuned_away(record)
    named = set[str]().union(*map(joints_shown, findings))
    after = heldout.get("rms_after_Nm", {})
    before = dict(heldout.get("rms_before_Nm", {}))
    before.update({joint: gaps[joint]["fixed_rms_Nm"] for joint in absorbed})
    share = heldout["shrink"]
    since = ""
    if absorbed:
        rows = [(before[joint], after[joint], gaps[joint]["noise_floor_Nm"]) for joint in absorbed]
        old, new, floor = (np.array(rows) ** 2).sum(axis=0)
        share = (old - new) / max(old - floor, 1e-12)
        since = ", counted from the model before tuning"
    amount = "nothing" if share <= 0.0 else percent(share)
    closes = f"On parts that the fit never saw all names close {amount} of what can be closed{since}"
    errors = []
    for joint in gaps:
        if joint in named:
            error = f"{significant(before.get(joint))} → {significant(after.get(joint))}"
            errors.append(f"{joint} {error}")
    if not errors:
        return f"{closes}."
    return f"{closes}. Torque error [{units_of(record)}]: {', '.join(errors)}."


def describe_reservations(record: Mapping[str, Any]) -> list[str]:
    """Reasons to doubt: what fits and is not believed, by reason, and a replay that ends far off.

    A reason reads "what was found: why no arm is like that"; effects that share the second part
    make one sentence, with what was found of the first.
    """
    alike: dict[str, list[Mapping[str, Any]]] = {}
    doubts = []
    for reservation in record.get("reservations", []):
        if reservation["effect"]:
            reason = reservation["reason"].split(": ")[-1]
            alike.setdefault(reason, []).append(reservation)
        else:
            doubts.append(f"Doubt: {reservation['reason']}.")
    return [*(_describe_unbelieved(some, record) for some in alike.values()), *doubts]


def _describe_unbelieved(some: Sequence[Mapping[str, Any]], record: Mapping[str, Any]) -> str:
    """One sentence about effects that fit and are not believed for one reason."""
    joints: dict[str, dict[str, None]] = {}
    for reservation in some:
        of_effect = joints.setdefault(reservation["effect"], {})
        of_effect.update(dict.fromkeys(reservation["joints"]))
    places = [effect_name(effect) + every_place(effect, [*where]) for effect, where in joints.items()]
    names = join_words(places)
    first = some[0]
    reason = in_units_of(first["joints"], record, with_units(first["reason"]), first["effect"])
    if len(some) == 1 or ": " not in reason:
        return f"Not believed: {names} would fit, but {reason}."
    return f"Not believed, though they would fit: {names}. Of the first, {reason}."


def describe_unnamed(record: Mapping[str, Any]) -> str:
    """What speaks for a gap beside, or without, any name: inertias tuned too far, a candidate that
    came near.
    """
    sentences = []
    worse = overtuned_joints(record)
    if worse:
        joint = max(worse, key=lambda name: record["gap"][name]["rms_Nm"])
        gap = record["gap"][joint]
        before = significant(gap["fixed_rms_Nm"])
        after = significant(gap["rms_Nm"])
        sentences.append(
            "These recordings are too few to tune a model on: tuned on one part of them it is "
            f"further off on the rest than as it was given ({joint}: {before} → {after} N m), so "
            "little can be concluded."
        )
    hidden = tuned_away_joints(record)
    if hidden:
        sentences.append(
            "The tuned inertias lie farther from the given ones than their tolerance allows; what "
            f"they hide acts most on {join_words(hidden[:2])}. Wrong links in the URDF, a load or a "
            "wrong gain look like this."
        )
        if not first_action(record).endswith(OWN_INERTIAS):
            sentences.append(OWN_INERTIAS)
    return " ".join(sentences)


def describe_motion(record: Mapping[str, Any]) -> str:
    """By how much the replayed motion comes nearer, of the joints that the names are about."""
    forward = (record.get("heldout") or {}).get("forward")
    findings = record.get("findings")
    if not findings or not forward:
        return ""
    before = forward["position_rms_rad"]["before"]
    after = forward["position_rms_rad"]["after"]
    named: set[str] = set()
    for finding in findings:
        named.update(finding["joints"])
    errors = []
    for joint in before:
        if joint in named:
            change = f"{fixed(1e3 * before[joint], 1)} → {fixed(1e3 * after[joint], 1)}"
            errors.append(f"{joint} {change}")
    if not errors:
        return ""
    window = f"after {1e3 * forward['window_s']:.0f} ms by [{units_of(record, 'mrad')}]"
    what = "Replayed under the recorded torques, the motion is off"
    return f"{what} {window}: {', '.join(errors)}."


def energy_pair(heldout: Mapping[str, Any], when: str, runs: int) -> str:
    """Mean energy error of a run, with its spread over the runs where there are several."""
    spread = heldout.get(f"energy_error_{when}_std_J") if runs > 1 else None
    return pair(heldout.get(f"energy_error_{when}_J"), spread)
