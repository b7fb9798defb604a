"""Diagnoses a folder of sessions with answers, made by a simulator that is not this project's plant.

    IDENT_OTHER_WORLD=FOLDER python tests/bench/bench_otherworld.py [SESSION …]

The folder holds `robot.urdf`, one folder a session, and `answers.json`: for each session `effects`, and `true_loss`
with `motor_inertia_kgm2`, `viscous_Nms_rad` and `coulomb_Nm` of every joint. An effect is an object with `effect` and
`joint` (a number from 0 or a name) or `joints`; other keys are that simulator's own figures. Sessions are diagnosed by
`ident diagnose` in processes of their own, which see the recordings and the URDF. Printed: each session's names against
its answer, then the shares of all with 95 % intervals, and how far the tuned losses are off.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from ident.benchmark.scores import share

VARIABLE = "IDENT_OTHER_WORLD"
LOSSES = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Names of one thing: another simulator need not use the catalogue's words.
SAME = {"none": "", "null": "", "stribeck": "stribeck_friction", "elasticity": "joint_elasticity"}
Row = dict[str, Any]


def read_truth(entry: Mapping[str, Any], joints: Sequence[str]) -> list[tuple[str, str]]:
    """Hidden effects as (id, joint); no joint where the answer names none."""
    found = []
    for one in entry.get("effects", ()):
        values = {"effect": one} if isinstance(one, str) else dict(one)
        name = str(values.get("effect") or values.get("id") or values.get("name") or values.get("kind") or "")
        place = values.get("joint", values.get("joints", ""))
        place = place[0] if isinstance(place, list) and place else place
        joint = joints[place] if isinstance(place, int) and 0 <= place < len(joints) else str(place or "")
        found.append((SAME.get(name, name), joint if joint in joints else ""))
    return found


def diagnose(session: Path, robot: Path) -> Row:
    """The diagnosis of a session's recordings; the answers lie out of its reach."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "diagnosis.json"
        command = [sys.executable, "-c", "from ident.cli.app import main; main()", "diagnose", str(session)]
        command += ["--robot", str(robot), "--json", str(out)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if not out.is_file():
            lines = done.stderr.strip().splitlines() or ["no message"]
            return {"verdict": f"failed: {lines[-1]}", "findings": [], "joints": [], "baseline": {}}
        return dict(json.loads(out.read_text(encoding="utf-8")))


def compare(session: Path, robot: Path, entry: Mapping[str, Any]) -> Row:
    """Diagnoses one session and lays it beside its answer."""
    start = time.perf_counter()
    record = diagnose(session, robot)
    true = read_truth(entry, record["joints"])
    named = [(one["effect"], one["joints"]) for one in record["findings"]]
    false = [
        name for name, at in named if not any(name == effect and (joint in at or not joint) for effect, joint in true)
    ]
    tuned, losses = record["baseline"], entry.get("true_loss", {})
    errors = {
        key: [
            tuned[joint][key] / value - 1.0 for joint, value in zip(record["joints"], losses.get(key, []), strict=False)
        ]
        for key in LOSSES
    }
    strict = len(true) == 1 and bool(named) and named[0][0] == true[0][0]
    row = {"session": session.name, "true": true, "named": named, "false": false, "strict": strict, "errors": errors}
    return {**row, "verdict": record["verdict"], "seconds": time.perf_counter() - start}


def run(folder: Path, only: Sequence[str] = ()) -> Iterator[Row]:
    """All sessions of a folder that have an answer, or those named; each is printed in a line."""
    answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    for name, entry in answers.items():
        if (not only or name in only) and (folder / name).exists():
            one = compare(folder / name, folder / "robot.urdf", entry)
            true = ", ".join(f"{effect}:{joint}" if joint else effect for effect, joint in one["true"]) or "nothing"
            named = ", ".join(f"{effect}:{'+'.join(joints)}" for effect, joints in one["named"]) or "no name"
            print(f"{name}  hidden {true}  |  {one['verdict']}: {named}  ({one['seconds']:.1f} s)", flush=True)
            yield one


def summarise(rows: Sequence[Row]) -> Iterator[str]:
    """The shares of all sessions."""
    healthy, single = ([one for one in rows if len(one["true"]) == count] for count in (0, 1))
    for words, hits in (
        ("healthy: a gap reported", [one["verdict"] != "no_gap" for one in healthy]),
        ("healthy: given a name", [bool(one["named"]) for one in healthy]),
        ("single effects: first name right", [one["strict"] for one in single]),
        ("single effects: a false name", [bool(one["false"]) for one in single]),
    ):
        one = share(hits)
        span = "" if one.low is None or one.high is None else f" [{one.low:.0%}, {one.high:.0%}]"
        yield f"{words}: {sum(hits)} of {len(hits)}{span}"
    for key in LOSSES:
        errors = [abs(error) for one in rows for error in one["errors"][key]]
        yield f"{key}: median error {median(errors):.1%} of {len(errors)}" if errors else f"{key}: nothing to count"


if __name__ == "__main__":
    if VARIABLE not in os.environ:
        sys.exit(f"{VARIABLE} names no folder: set it to a folder with robot.urdf, answers.json and sessions")
    print("\n".join(summarise(list(run(Path(os.environ[VARIABLE]), sys.argv[1:])))))
