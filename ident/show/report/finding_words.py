"""A name of a diagnosis in words: what it is called, where it is, in which units.

A finding is a name's record in `findings` of a diagnosis, `ident.diagnosis/1`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from ident.diagnosis.next_experiment import LIKELY
from ident.effects.catalogue import CATALOGUE, OF_THE_ARM
from ident.errors import join_words
from ident.records import JsonTable
from ident.show.report.numbers import MOST_NAMED
from ident.show.report.words import effect_name, percent
from ident.units import FORCE, TORQUE, in_linear_units

BODIES = {effect.id for effect in CATALOGUE if effect.as_change.body}
# Tied names that one sentence holds.
MOST_TIED = MOST_NAMED
Finding = JsonTable
"""A name's record in `findings`."""


def called(
    finding: Finding,
    lead: str = "",
    most_tied: int = MOST_TIED,
    brief: bool = False,
) -> str:
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


def in_units_of(joints: Iterable[str], record: JsonTable, text: str, effect: str = "") -> str:
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


def units_of(record: JsonTable, unit: str = TORQUE) -> str:
    """A unit of all joints, with that of those that slide beside it."""
    units = {in_units_of([joint], record, unit) for joint in record["joints"]}
    return "; of joints that slide ".join(sorted(units)[::-1])


def is_likely(finding: Finding, alike: Collection[str] = ()) -> bool:
    """Whether a name is likelier than not; where its whole class is of one kind, that kind.

    Args:
        finding: The name.
        alike: The effects of that kind, by id.
    """
    key = "class_probability" if {*finding.get("class", "?")} <= {*alike} else "probability"
    return bool(finding.get(key, 1.0) >= LIKELY)
