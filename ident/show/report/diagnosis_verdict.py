"""The first line of a diagnosis: its verdict, the leading joint and the likeliest names.

One order holds for all words, that of the map (`leading_joint`). A factor of a joint that has no
gap is said after the verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ident.diagnosis.tuned_links import BEYOND_URDFS
from ident.effects.catalogue import OF_THE_ARM
from ident.errors import join_words, plural
from ident.records import JsonTable
from ident.show.report.diagnosis_actions import (
    adds_mass,
    is_at_the_end,
    is_beside_the_body,
    leads_with_friction,
)
from ident.show.report.diagnosis_gap import (
    describe_largest_rest,
    describe_varying_friction,
    likeliest_doubt,
    varying_friction,
    wrong_link,
)
from ident.show.report.finding_words import (
    BODIES,
    Finding,
    called,
    in_units_of,
    is_likely,
)
from ident.show.report.leading_joint import (
    acts_on,
    in_order_of_joints,
    leading_joint,
    names_factor,
    verdict_key,
)
from ident.show.report.misread_torque import misread_torque
from ident.show.report.numbers import MOST_NAMED, describe_most, describe_numbers
from ident.show.report.words import TABLES, lowered, percent, sentence, significant
from ident.units import TORQUE

# A first line that is longer says less, step by step [characters].
LONGEST_HEADLINE = 200
MASS_AT_THE_END = {
    False: "less mass at the arm's end than the URDF has",
    True: "more mass at the arm's end than the URDF has",
}
# Where no name is found at the leading joint, but a mass at the arm's end.
OF_THE_END = "The gap is largest at {}, {} beyond noise: a mass at the arm's end is not the URDF's."
# Where nothing but numbers of the URDF is wrong: what is left once they are right, and how they get
# there.
RIGHTED = "Put right, it is as good as these recordings can tell."
# A factor that a likely body at the arm explains, by the verdict.
MAY_BE_A_BODY = {"named": "It may be a body", "partial": "Part of it may be a body"}


class Most(NamedTuple):
    """How much a first line has in it at most."""

    names: int
    tied: int  # of a name that is less likely than not, those that it may be
    rest: bool = False  # whether it says what the names leave
    others: bool = True  # whether it names the joints, but the first, that read a factor
    # Whether sizes that stand in a table below, and places beside the leading joint, are left
    # to it.
    brief: bool = False


# From a whole line to the shortest.
FEWER = (
    *(Most(names, MOST_NAMED, rest=True) for names in range(MOST_NAMED, 0, -1)),
    *(Most(1, tied) for tied in range(MOST_NAMED, 0, -1)),
    Most(1, 1, brief=True),
    Most(1, 1, others=False, brief=True),
)


def diagnosis_headline(record: JsonTable) -> str:
    """The URDF's friction if that is most of its error; the leading joint's gap if no effect of its
    own explains it, the verdict, and a factor of a torque elsewhere.

    As many names, and as many that they can't be told from, as one line holds; all of them stand in
    the list below it.
    """
    line = ""
    has_friction = leads_with_friction(record)
    for most in FEWER:
        line = _headline_of(record, most)
        if has_friction:
            joint = "" if most.brief else leading_joint(record)[0]
            most_of_it = describe_most(record, joint)
            line = f"{most_of_it} Beyond that, {lowered(line)}"
        if len(line) <= LONGEST_HEADLINE:
            return line
    return line


def _headline_of(record: JsonTable, most: Most) -> str:
    """The first line with so much in it at most."""
    scale = misread_torque(record)
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
        acts = acts_on(shown[0], joint, record)
        there = "where a cause elsewhere is felt" if acts else "and is unexplained there"
        lead = f"The gap is largest at {joint}, {size}, {there}."
    beside = bool(shown) and not misread and is_beside_the_body(shown[0], record)
    if beside:
        lead = OF_THE_END.format(joint, beyond)
    # A gain of a joint that reads a factor is only another name of it.
    other = shown
    if scale and misread:
        other = [finding for finding in shown if not names_factor(finding, scale)]
    listed = other or shown
    words = _verdict_words(record, listed, most, misread)
    if beside:
        words = f"Beside it{_largest_error(listed, record)}: {_first_names(listed, most, record)}."
    elif scale and misread and scale["bodily"] and not first:
        may_be = MAY_BE_A_BODY.get(key)
        rest = describe_largest_rest(record) if most.rest else ""
        if may_be:
            words = f"{may_be}: {_first_names(listed, most, record)}{rest}."
        else:
            words = f"A load or a link's wrong mass may be why. {words}"
    elif misread and not first and (other or not shown):
        words = f"Beyond that, {lowered(words)}"
    return " ".join(text for text in (lead, words, elsewhere) if text)


def _verdict_words(
    record: JsonTable,
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
    rest = describe_largest_rest(record) if most.rest else ""
    named = _first_names(listed, most, record)
    words = pattern.format(has=has, named=named, size=size, rest=rest)
    return _words_without_gap(words, record, misread, most.brief) if key == "no_gap" else words


def _words_without_gap(words: str, record: JsonTable, misread: bool, brief: bool) -> str:
    """The verdict where nothing is left once numbers of the URDF are right.

    Args:
        words: The verdict of an arm whose numbers are right.
        record: The diagnosis.
        misread: Whether the leading joint's torque is off by a factor, which is said before.
        brief: Whether one number of the URDF's is to be enough.
    """
    wrong = describe_numbers(record, brief)
    joint, share = likeliest_doubt(record)
    varying, _ = varying_friction(record)
    doubt = ""
    righted = RIGHTED
    if varying and joint in ("", varying):
        # What may be left at that joint is its friction's: no single number fits all runs.
        by_run = describe_varying_friction(record)
        doubt = f" But friction {by_run}."
        righted = f"Put right, friction still {by_run}."
    elif joint:
        doubt = f" With {percent(share)} an unnamed cause is left at {joint}."
        righted = (
            f"Put right, nothing is left, or with {percent(share)} an unnamed cause at {joint}."
        )
    link, _ = wrong_link(record)
    if link and wrong:
        wrong = f"{wrong} Its {link} {BEYOND_URDFS}."
    elif link:
        wrong = f"In your URDF {link} {BEYOND_URDFS}."
    if not wrong:
        return f"{words}{doubt}"
    return f"{wrong}{doubt}" if misread else f"{wrong} {righted}"


def _largest_error(findings: Sequence[Finding], record: JsonTable) -> str:
    """What the model errs by at most where some names show; "" where that is not known."""
    errors: dict[str, float] = {}
    for finding in findings:
        errors |= finding.get("heldout", {}).get("rms_before_Nm", {})
    worst = max(errors, key=errors.__getitem__, default="")
    if not worst:
        return ""
    size = in_units_of([worst], record, f"{significant(errors[worst])} {TORQUE}")
    return f", where the model is off by {size} at most"


def _first_names(listed: Sequence[Finding], most: Most, record: JsonTable) -> str:
    """The first names with their joints, the leading one first, and how many more there are."""
    lead = leading_joint(record)[0]
    names = []
    for finding in listed[: most.names]:
        likely = is_likely(finding, BODIES if finding["effect"] in OF_THE_ARM else ())
        if likely and is_at_the_end(finding, record):
            mass = MASS_AT_THE_END[adds_mass(finding)]
            if mass not in names:  # load and last link are one mass
                names.append(mass)
        else:
            names.append(called(finding, lead, most.tied, most.brief))
    joined = "; ".join(names) if " and " in "".join(names) else join_words(names)
    left = len(listed) - most.names
    return f"{joined}, and {left} more" if left > 0 else joined
