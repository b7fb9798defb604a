"""The order of a diagnosis: the joint that all words begin with, and the names that show there.

It is the order of the map: the joint of its first place leads, one whose whole torque is off by a
factor, else of the largest gap.
"""

from __future__ import annotations

import math
import re

from ident.checks.report import MISREAD
from ident.diagnosis.next_experiment import joints_shown
from ident.effects.catalogue import CATALOGUE
from ident.records import JsonTable
from ident.show.report.finding_words import BODIES, Finding, in_units_of, is_likely
from ident.show.report.words import significant
from ident.units import TORQUE

# Those that multiply a joint's whole torque.
GAINS = {
    effect.id for effect in CATALOGUE if effect.as_change.exact and effect.as_change.common_gain
}
# A joint that reads a factor, and the factor, in what the telemetry check says.
READS = re.compile(r"(\S+) reads (-?\d+\.\d+)")


def acts_on(finding: Finding, joint: str, record: JsonTable) -> bool:
    """Whether a name is felt at a joint: it shows there, or is a body that the joint carries."""
    if joint in joints_shown(finding):
        return True
    order = list(record.get("joints", ()))
    if finding["effect"] not in BODIES or not {joint, *finding["joints"]} <= set(order):
        return False
    return any(order.index(other) > order.index(joint) for other in finding["joints"])


def names_factor(finding: Finding, off: JsonTable) -> bool:
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


def leading_joint(record: JsonTable) -> tuple[str, str]:
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
        for issue in issues_of_kind(record, MISREAD):
            spoken_of.update(issue["joints"])
        for joint, gap in record.get("gap", {}).items():
            if joint in spoken_of or not spoken_of:
                beyond = gap["rms_Nm"] ** 2 - gap["noise_floor_Nm"] ** 2
                sizes[joint] = math.sqrt(max(beyond, 0.0))
    lead = max(sizes, key=sizes.__getitem__, default="")
    size = sizes.get(lead, 0.0)
    return lead, f"{significant(size)} {in_units_of([lead], record, TORQUE)}"


def issues_of_kind(record: JsonTable, kind: str) -> list[JsonTable]:
    """What the check of the recordings says of one kind."""
    return [issue for issue in record.get("telemetry", ()) if issue["issue"] == kind]


def in_order_of_joints(record: JsonTable) -> list[Finding]:
    """Names as they are shown: those that act at the leading joint first, of them what closes most
    there.

    Where the leading joint's torque is off by a factor that has a name, such names of other joints
    stand beside it. A gain that nobody measured comes before what is told in its unit.
    """
    lead = leading_joint(record)[0]
    findings = record.get("findings", [])
    off = issues_of_kind(record, MISREAD)
    guessed: set[str] = set()
    for issue in issues_of_kind(record, "guessed_gains"):
        guessed.update(issue["joints"])

    def names_one_of_them(finding: Finding) -> bool:
        return is_likely(finding) and any(names_factor(finding, issue) for issue in off)

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
            not acts_on(finding, lead, record),
            not (is_gain and not guessed.isdisjoint(finding["joints"])),
            after**2 - before**2,
            lead not in finding["joints"],
            not is_likely(finding),
        )

    return sorted(findings, key=rank)


def verdict_key(record: JsonTable) -> str:
    """The verdict by which words are chosen: of a gap without a name, whether it has names beside
    it.
    """
    if record["verdict"] != "none_of_catalogue":
        return str(record["verdict"])
    return "mostly" if record.get("findings") else "none_of_catalogue"
