"""Why a diagnosis may be wrong: what fits and is not believed, what speaks for an unnamed gap."""

from __future__ import annotations

from collections.abc import Sequence

from ident.errors import join_words
from ident.records import JsonTable
from ident.show.report.diagnosis_actions import OWN_INERTIAS, first_action
from ident.show.report.diagnosis_gap import overtuned_joints, tuned_away_joints
from ident.show.report.finding_words import every_place, in_units_of
from ident.show.report.words import effect_name, significant, with_units


def describe_reservations(record: JsonTable) -> list[str]:
    """Reasons to doubt: what fits and is not believed, by reason, and a replay that ends far off.

    A reason reads "what was found: why no arm is like that"; effects that share the second part
    make one sentence, with what was found of the first.
    """
    alike: dict[str, list[JsonTable]] = {}
    doubts = []
    for reservation in record.get("reservations", []):
        if reservation["effect"]:
            reason = reservation["reason"].split(": ")[-1]
            alike.setdefault(reason, []).append(reservation)
        else:
            doubts.append(f"Doubt: {reservation['reason']}.")
    return [*(_describe_unbelieved(some, record) for some in alike.values()), *doubts]


def _describe_unbelieved(some: Sequence[JsonTable], record: JsonTable) -> str:
    """One sentence about effects that fit and are not believed for one reason."""
    joints: dict[str, dict[str, None]] = {}
    for reservation in some:
        of_effect = joints.setdefault(reservation["effect"], {})
        of_effect.update(dict.fromkeys(reservation["joints"]))
    places = []
    for effect, where in joints.items():
        places.append(effect_name(effect) + every_place(effect, [*where]))
    names = join_words(places)
    first = some[0]
    reason = in_units_of(first["joints"], record, with_units(first["reason"]), first["effect"])
    if len(some) == 1 or ": " not in reason:
        return f"Not believed: {names} would fit, but {reason}."
    return f"Not believed, though they would fit: {names}. Of the first, {reason}."


def describe_unnamed(record: JsonTable) -> str:
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
            f"they hide acts most on {join_words(hidden[:2])}. Wrong links in the URDF, a load "
            "or a wrong gain look like this."
        )
        if not first_action(record).endswith(OWN_INERTIAS):
            sentences.append(OWN_INERTIAS)
    return " ".join(sentences)
