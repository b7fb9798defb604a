"""Whether a candidate of a diagnosis is right: by its class, at a joint where it may stand.

A candidate is `right` if what was planted, or an effect that says the same, is the candidate itself
or of its class, at a joint where it may stand. It is `unknown`, neither right nor wrong, if the
untouched recording of the same real arm has the name as well, if others measured it on that arm, or
if the world's URDF is wrong by more than a tolerance and the name says so. All others are `wrong`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ident.benchmark.corpus import Entry, Truth
from ident.records import JsonTable
from ident.simulation.real.sources import measured_causes

RIGHT = "right"
WRONG = "wrong"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Name:
    """What a candidate says, as far as it is judged."""

    effect: str  # id
    joint: str  # empty for the whole arm
    places: frozenset[str]  # where it shows or stands
    # Its class as (id, joint); an empty joint is any of its places.
    members: frozenset[tuple[str, str]]

    @classmethod
    def of_candidate(cls, candidate: JsonTable) -> Name:
        """The name of a stored candidate.

        In its `class` an id may be written `id:joint`, where the twin stands at another joint.
        """
        joint = str(candidate.get("joint") or "")
        other = str(candidate.get("other") or "")
        shown = {str(place) for place in candidate.get("joints") or ()}
        places = {joint, other} - {""} if joint else shown
        members = {(str(candidate["effect"]), "")}
        for word in candidate.get("class") or ():
            effect, _, place = str(word).partition(":")
            members.add((effect, place))
        return cls(str(candidate["effect"]), joint, frozenset(places), frozenset(members))

    @classmethod
    def of_finding(cls, finding: JsonTable) -> Name:
        """The name of a finding of `ident.diagnosis/1`, with where else it may stand."""
        elsewhere = [
            f"{twin['effect']}:{twin.get('joint') or ''}" for twin in finding.get("elsewhere", ())
        ]
        joints = list(finding["joints"])
        classes = [*finding.get("class", ()), *elsewhere]
        return cls.of_candidate({"effect": finding["effect"], "joints": joints, "class": classes})

    def places_of(self, joint: str) -> frozenset[str]:
        """Where a member of the class stands."""
        return frozenset({joint}) if joint else self.places


def matching(name: Name, truths: Sequence[Truth]) -> int | None:
    """Number of the first truth that a name is right of; None if there is none."""
    for number, truth in enumerate(truths):
        if says(name, truth):
            return number
    return None


def says(name: Name, truth: Truth) -> bool:
    """Whether a name's class has a truth, at a joint where it may stand."""
    wanted = {truth.effect, *truth.also}
    allowed = set(truth.may_stand_at)
    for effect, joint in name.members:
        if effect not in wanted:
            continue
        if effect in truth.also and not name.joint:
            return True  # the same torque, of an effect that has no joint of its own
        places = name.places_of(joint)
        if not allowed or not places or places & allowed:
            return True
    return False


def is_strict(name: Name, truth: Truth) -> bool:
    """Whether a name is a truth's own, not only of its class."""
    return name.effect == truth.effect and says(name, truth)


def overlap(first: Name, second: Name) -> bool:
    """Whether two names may mean one thing: an effect of both classes, at a common place."""
    for effect, joint in first.members:
        for effect_of_second, joint_of_second in second.members:
            if effect != effect_of_second:
                continue
            if _meet(first.places_of(joint), second.places_of(joint_of_second)):
                return True
    return False


def says_the_same(first: Name, second: Name) -> bool:
    """Whether one of two names is of the other's class, at a common place."""
    return _is_member(first, second) or _is_member(second, first)


def _is_member(name: Name, of: Name) -> bool:
    joints = [joint for effect, joint in of.members if effect == name.effect]
    return any(_meet(name.places, of.places_of(joint)) for joint in joints)


def _meet(places: frozenset[str], others: frozenset[str]) -> bool:
    """Whether places have one in common; none at all is anywhere."""
    return not places or not others or bool(places & others)


def label(name: Name, entry: Entry, control_names: Iterable[Name] = ()) -> str:
    """Right, wrong or unknown.

    Args:
        name: Of a candidate.
        entry: The session that it is of.
        control_names: What was named on the same arm's untouched recording.
    """
    if matching(name, entry.truth) is not None:
        return RIGHT
    if name.effect in entry.excused:
        return UNKNOWN
    if any(says(name, cause) for cause in measured_on(entry)):
        return UNKNOWN
    if any(overlap(name, known) for known in control_names):
        return UNKNOWN
    return WRONG


def measured_on(entry: Entry) -> list[Truth]:
    """What others measured on the arm of a real recording."""
    if entry.group not in ("real", "kept"):
        return []
    causes = measured_causes(entry.arm)
    return [Truth(effect, True, tuple(joints), tuple(joints)) for effect, joints in causes.items()]
