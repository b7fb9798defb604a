"""What the names of a diagnosis leave, joint by joint: noise, errors, inertias tuned too far."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ident.diagnosis.next_experiment import joints_shown
from ident.diagnosis.tuned_links import BEYOND_URDFS
from ident.errors import join_words
from ident.records import JsonTable
from ident.regression.settings import USUAL_REGRESSION
from ident.show.report.finding_words import in_units_of, units_of
from ident.show.report.words import fixed, pair, percent, significant
from ident.units import TORQUE

# Tuned on other runs a model that errs by so many times what it does untuned has learned what does
# not carry over.
OVERTUNED = 2.0
# A chance of one in five that something is left at a joint is worth saying.
WORTH_SAYING = 0.2


def describe_largest_rest(record: JsonTable) -> str:
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


def likeliest_doubt(record: JsonTable) -> tuple[str, float]:
    """Where a cause without a name is likeliest left, and how likely.

    Returns:
        The joint and the probability; "" and 0 where that is hardly likely.
    """
    left = record.get("leftover", {})
    joint = max(left, key=left.__getitem__, default="")
    if not joint or left[joint] < WORTH_SAYING:
        return "", 0.0
    return joint, left[joint]


def noise_is_left(record: JsonTable) -> list[str]:
    """Joints at which what the names leave is the noise, to the digits shown."""
    after = (record.get("heldout") or {}).get("rms_after_Nm", {}) if record.get("findings") else {}
    gaps = record.get("gap", {})
    left = {joint: after.get(joint, gap["rms_Nm"]) for joint, gap in gaps.items()}
    alike = []
    for joint, gap in gaps.items():
        noise = gap["noise_floor_Nm"]
        if f"{left[joint]:.3f}" == f"{noise:.3f}":
            alike.append(joint)
    return alike


def describe_noise(record: JsonTable) -> str:
    """Why noise and what is left are one figure at some joints; "" where they are at none."""
    alike = noise_is_left(record)
    if not alike:
        return ""
    at_all = len(alike) == len(record["gap"])
    where = "What is left" if at_all else f"What is left at {join_words(alike)}"
    there = "at no joint" if at_all else "there"
    likelier = "likelier than not"
    sure = f"is a cause without a name {likelier}"
    if not at_all:
        sure = f"no cause without a name is {likelier}"
    joint, share = varying_friction(record)
    varies = ""
    if joint in alike:
        by_run = f"differs from run to run, by {percent(share)} (standard deviation) at {joint}"
        varies = f" A part of it is friction that {by_run}."
    return f"{where} is counted as noise: {there} {sure}.{varies}"


def varying_friction(record: JsonTable) -> tuple[str, float]:
    """The joint whose friction differs most from run to run, and by which share of it.

    A standard deviation; "" and 0 where it is nowhere more than a warm arm's.
    """
    spreads = {
        joint: float(gap.get("friction_spread", 0.0))
        for joint, gap in record.get("gap", {}).items()
    }
    joint = max(spreads, key=spreads.__getitem__, default="")
    if not joint or spreads[joint] <= USUAL_REGRESSION.wide_spread:
        return "", 0.0
    return joint, spreads[joint]


def describe_varying_friction(record: JsonTable) -> str:
    """By how much friction differs from run to run where it does so most, and the error that is
    left there, to follow the word "friction"; "" where it is one number everywhere.
    """
    joint, share = varying_friction(record)
    if not joint:
        return ""
    left = f"{significant(record['gap'][joint]['rms_Nm'])} {TORQUE}"
    by_run = f"differs from run to run, by {percent(share)} at {joint}"
    return f"{by_run}; {in_units_of([joint], record, left)} are left there"


def wrong_link(record: JsonTable) -> tuple[str, str]:
    """The link that is off by more than URDFs are and by most, and what is to be done about it.

    Returns:
        Its name, and a sentence without full stop; both empty where no link is, or friction that
        differs from run to run may have moved it.
    """
    if varying_friction(record)[0]:
        return "", ""
    worst = ""
    largest = 0.0
    for name, link in record.get("tuned_links", {}).items():
        moments = [*link["moment_kgm"].values()]
        if "about_axis_kgm" in link:
            moments.append(link["about_axis_kgm"])
        change = max((abs(moment["value"]) for moment in moments), default=0.0)
        if link["beyond_tolerance"] and change > largest:
            worst = name
            largest = change
    for reservation in record.get("reservations", ()):
        if worst and reservation["reason"].startswith(f"{worst} {BEYOND_URDFS}"):
            return worst, reservation["reason"]
    return "", ""


def tuned_away_joints(record: JsonTable) -> list[str]:
    """Joints whose torque only inertias beyond the URDF's tolerance explain, the loudest first."""
    hidden = {}
    for joint, gap in record.get("gap", {}).items():
        if gap.get("tuned_away_Nm", 0.0) > gap["noise_floor_Nm"]:
            hidden[joint] = gap["tuned_away_Nm"] / max(gap["noise_floor_Nm"], 1e-12)
    return sorted(hidden, key=lambda joint: -hidden[joint])


def overtuned_joints(record: JsonTable) -> list[str]:
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


def joints_tuned_away(record: JsonTable) -> set[str]:
    """Joints at which tuning hides a named effect, which is judged by the model before tuning."""
    joints: set[str] = set()
    for finding in record.get("findings", []):
        if finding.get("evidence", {}).get("judged_against") == "urdf":
            joints.update(joints_shown(finding))
    return joints


def describe_findings(record: JsonTable) -> str:
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
    closes = (
        f"On parts that the fit never saw all names close {amount} of what can be closed{since}"
    )
    shown = [joint for joint in gaps if joint in named]
    errors = _changes(shown, before, after, significant)
    if not errors:
        return f"{closes}."
    return f"{closes}. Torque error [{units_of(record)}]: {errors}."


def describe_motion(record: JsonTable) -> str:
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
    shown = [joint for joint in before if joint in named]
    errors = _changes(shown, before, after, _milliradians)
    if not errors:
        return ""
    window = f"after {1e3 * forward['window_s']:.0f} ms by [{units_of(record, 'mrad')}]"
    what = "Replayed under the recorded torques, the motion is off"
    return f"{what} {window}: {errors}."


def _changes(
    joints: Sequence[str],
    before: JsonTable,
    after: JsonTable,
    words: Callable[[float | None], str],
) -> str:
    """Errors of some joints before and after, one behind the other; empty without a joint."""
    pairs = [(words(before.get(joint)), words(after.get(joint))) for joint in joints]
    named = zip(joints, pairs, strict=True)
    return ", ".join(f"{joint} {old} → {new}" for joint, (old, new) in named)


def _milliradians(error: float | None) -> str:
    """An error, given in radians, in mrad."""
    return fixed(None if error is None else 1e3 * error, 1)


def energy_pair(heldout: JsonTable, when: str, runs: int) -> str:
    """Mean energy error of a run, with its spread over the runs where there are several."""
    spread = heldout.get(f"energy_error_{when}_std_J") if runs > 1 else None
    return pair(heldout.get(f"energy_error_{when}_J"), spread)
