"""Whether a diagnosis says one thing first: first line, first action and first name at the joint of the first place.

    python -m tests.bench.bench_first_line RESULT.json ...

Results are those of `ident diagnose --json`, or of a check's cases. A body, a name of another joint that shows there,
and what is said of the whole arm count; where a factor of a torque is said first, a name of another joint may follow.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.diagnosis.next_experiment import joints_shown
from ident.show.report.diagnosis_actions import first_action
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.finding_words import BODIES
from ident.show.report.leading_joint import in_order_of_joints


def first_joint(text: str, joints: list[str]) -> str:
    """The joint that a text names first; "" where it names none, or the whole arm before."""
    found = [(text.find(joint), -len(joint), joint) for joint in joints if joint in text]
    return "" if not found or 0 <= text.find("the whole arm") < min(found)[0] else min(found)[2]


def judge(record: Mapping[str, Any]) -> tuple[dict[str, bool], str]:
    """What stands at the first place's joint, and the words."""
    lead, names = record["where"][0]["joint"], in_order_of_joints(record)
    headline, action = diagnosis_headline(record), first_action(record)
    acts = (one for one in names[:1] if one["effect"] in BODIES or lead in joints_shown(one))
    shown = {"", lead, *(joint for one in acts for joint in one["joints"])}
    found = {
        "headline": first_joint(headline, record["joints"]) in ("", lead),
        "action": first_joint(action, record["joints"]) in shown,
        "places beyond noise": all(place.get("beyond_noise_Nm", 1.0) > 0.0 for place in record["where"]),
    }
    if names:
        found["name"] = lead in {*names[0]["joints"], *joints_shown(names[0])}
    return found, f"{lead} | {headline} | {action}"


def main(*paths: str) -> None:
    right: Counter[str] = Counter()
    seen: Counter[str] = Counter()
    for path in map(Path, paths):
        record = json.loads(path.read_text(encoding="utf-8"))
        record = record.get("diagnosis") or record
        if not record.get("where"):
            seen[f"no place, {record.get('verdict', 'no diagnosis')}"] += 1
            continue
        found, words = judge(record)
        seen.update(found.keys())
        right.update(key for key, value in found.items() if value)
        if not all(found.values()):
            print(f"{path.stem}: {', '.join(key for key, value in found.items() if not value)}: {words}")
    for key, count in seen.items():
        print(f"{key}: {right[key]} of {count}" if key in right else f"{key}: {count}")


if __name__ == "__main__":
    main(*sys.argv[1:])
