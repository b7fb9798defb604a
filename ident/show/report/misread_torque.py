"""Joints whose whole torque is off by a factor: what is said of them, and what explains it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ident.checks.report import MISREAD
from ident.diagnosis.next_experiment import joints_shown
from ident.diagnosis.settings import USUAL_VERDICT
from ident.effects.catalogue import CATALOGUE
from ident.errors import join_words
from ident.records import JsonTable
from ident.show.report.finding_words import BODIES, Finding, is_likely
from ident.show.report.leading_joint import (
    READS,
    acts_on,
    in_order_of_joints,
    issues_of_kind,
    leading_joint,
    names_factor,
)

# They act on other joints' torque, too.
ELSEWHERE = {effect.id for effect in CATALOGUE if effect.rows == "all"}


def misread_torque(record: JsonTable) -> JsonTable | None:
    """What telemetry says of joints whose whole torque is off by a factor, if anything: the leading
    joint's first.

    None, too, where a likely name says what it is: first of all the gain of every joint that is
    off, or what turns gravity at several joints, as a zero or a mount, and closes the gap there;
    or another law of the joint, as of readings that flatten, beside which its gain is none.
    The first name of all, a likely body that the leading joint carries, may be it (`bodily`), so
    far as it goes.
    """
    issues = issues_of_kind(record, MISREAD)
    if not issues or record["verdict"] == "refused":
        return None
    off = issues[0]
    shown = in_order_of_joints(record)
    likely = [finding for finding in shown if is_likely(finding)]
    if _gains_explain(off, likely) or _turning_explains(off, likely, record):
        return None
    if _laws_explain(off, likely, record):
        return None
    lead = leading_joint(record)[0]
    acts = bool(shown) and (not lead or acts_on(shown[0], lead, record))
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


def _gains_explain(off: JsonTable, likely: Sequence[Finding]) -> bool:
    """Whether gains, the first of the likely names among them, are the factors of all joints that
    are off.
    """
    gained: set[str] = set()
    for finding in likely:
        if names_factor(finding, off):
            gained.update(finding["joints"])
    return set(off["joints"]) <= gained and names_factor(likely[0], off)


def _turning_explains(off: JsonTable, likely: Sequence[Finding], record: JsonTable) -> bool:
    """Whether names that turn gravity close the gap at all joints that are off."""
    explained: set[str] = set()
    for finding in likely:
        if finding["effect"] in ELSEWHERE - BODIES:
            places = joints_shown(finding)
            explained.update(joint for joint in places if _explains(finding, joint, record))
    return set(off["joints"]) <= explained


def _laws_explain(off: JsonTable, likely: Sequence[Finding], record: JsonTable) -> bool:
    """Whether each joint that is off has a likely name beside which its gain is nearer to one than
    to the factor, wherever in its interval.
    """
    factors = {joint: float(number) for joint, number in READS.findall(off["evidence"])}
    for joint in off["joints"]:
        named = [finding for finding in likely if joint in finding["joints"]]
        gain = record.get("identified", {}).get(joint, {}).get("torque_gain", {})
        ends = [gain.get("low_with_urdf"), gain.get("high_with_urdf")]
        if not named or None in ends or joint not in factors:
            return False
        farthest = max(abs(end - 1.0) for end in ends)
        if farthest > 0.5 * abs(factors[joint] - 1.0):
            return False
    return True


def _with_factors(joints: Sequence[str], evidence: str) -> str:
    """Joints that read a factor; of several each with its own."""
    if len(joints) == 1:
        return joints[0]
    factors = {joint: f"{joint} ({factor})" for joint, factor in READS.findall(evidence)}
    return join_words([factors.get(joint, joint) for joint in joints])


def _explains(finding: Finding, joint: str, record: JsonTable) -> bool:
    """Whether a name by itself closes nearly all of what the model errs by at a joint beyond its
    noise.
    """
    figures = finding.get("heldout") or {}
    before = figures.get("rms_before_Nm", {}).get(joint, math.inf)
    after = figures.get("rms_after_Nm", {}).get(joint, math.inf)
    floor = record.get("gap", {}).get(joint, {}).get("noise_floor_Nm", math.inf)
    left = (1.0 - USUAL_VERDICT.explained) * (before**2 - floor**2)
    return floor < before < math.inf and after**2 - floor**2 <= left
