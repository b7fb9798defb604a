"""Diagnoses a folder of sessions with answers, made by a simulator that is not this project's plant.

    IDENT_OTHER_WORLD=FOLDER python tests/bench/bench_otherworld.py [SESSION …]

The folder holds `robot.urdf`, one folder a session, and `answers.json`: for each session `kind` (`null` for nothing
hidden), `effects`, and `true_loss` with `motor_inertia_kgm2`, `viscous_Nms_rad` and `coulomb_Nm` of every joint. An
effect is an object with `effect` (or `id`, `name`) and `joint` (a number from 0 or a name) or `joints`; other keys
are that simulator's own figures. Sessions are diagnosed by `ident diagnose` in processes of their own, which see the
recordings and the URDF. Printed: each session's names against its answer, then the shares of all, then how often the
tuned baseline's intervals (`tuned` of the diagnosis, where it tells `low` and `high`) hold the true losses.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

VARIABLE = "IDENT_OTHER_WORLD"
LOSSES = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Names of one thing: another simulator need not use the catalogue's words.
SAME = {"none": "", "null": "", "stribeck": "stribeck_friction", "elasticity": "joint_elasticity"}


@dataclass(frozen=True)
class Compared:
    """One session: what was hidden, what was told."""

    session: str
    true: tuple[tuple[str, str], ...]
    told: tuple[tuple[str, tuple[str, ...]], ...]
    verdict: str
    losses: Mapping[str, Sequence[bool]]
    errors: Mapping[str, Sequence[float]]
    seconds: float

    @property
    def strict(self) -> bool:
        return len(self.true) == 1 and bool(self.told) and self.told[0][0] == self.true[0][0]

    @property
    def false_names(self) -> int:
        return sum(not any(_matches(name, joints, one) for one in self.true) for name, joints in self.told)


def _matches(name: str, joints: Sequence[str], true: tuple[str, str]) -> bool:
    return name == true[0] and (not true[1] or not joints or true[1] in joints)


def read_truth(entry: Mapping[str, Any], joints: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Hidden effects as (id, joint); no joint where the answer names none."""
    found = []
    for one in entry.get("effects", ()):
        values = {"effect": one} if isinstance(one, str) else dict(one)
        name = str(values.get("effect") or values.get("id") or values.get("name") or values.get("kind") or "")
        place = values.get("joint", values.get("joints", ""))
        place = place[0] if isinstance(place, list) and place else place
        joint = joints[place] if isinstance(place, int) and 0 <= place < len(joints) else str(place or "")
        found.append((SAME.get(name, name), joint if joint in joints else ""))
    return tuple(found)


def diagnose(session: Path, robot: Path) -> tuple[dict[str, Any], float]:
    """The diagnosis of a session's recordings, and its time [s]; the answers lie out of its reach."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "diagnosis.json"
        start = time.perf_counter()
        command = [sys.executable, "-c", "from ident.cli.app import main; main()", "diagnose", str(session)]
        done = subprocess.run(
            [*command, "--robot", str(robot), "--json", str(out)], capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - start
        if not out.is_file():
            lines = done.stderr.strip().splitlines() or ["no message"]
            return {"verdict": f"failed: {lines[-1]}", "findings": [], "joints": []}, seconds
        return json.loads(out.read_text(encoding="utf-8")), seconds


def compare(session: Path, robot: Path, entry: Mapping[str, Any]) -> Compared:
    """Diagnoses one session and lays it beside its answer."""
    record, seconds = diagnose(session, robot)
    joints = record["joints"]
    told = tuple((one["effect"], tuple(one["joints"])) for one in record["findings"])
    covered: dict[str, list[bool]] = {key: [] for key in LOSSES}
    errors: dict[str, list[float]] = {key: [] for key in LOSSES}
    for key, j, figure in loss_figures(record):
        true = entry.get("true_loss", {}).get(key, [])
        if j < len(true):
            errors[key].append(figure["value"] / true[j] - 1.0)
            if None not in (figure["low"], figure["high"]):
                covered[key].append(figure["low"] <= true[j] <= figure["high"])
    return Compared(session.name, read_truth(entry, joints), told, record["verdict"], covered, errors, seconds)


def loss_figures(record: Mapping[str, Any]) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Tuned losses of a diagnosis as (key, joint's number, value with its interval where there is one)."""
    tuned = record.get("tuned") or record.get("baseline") or {}
    for j, joint in enumerate(record["joints"]):
        for key in LOSSES:
            value = tuned.get(joint, {}).get(key)
            if isinstance(value, Mapping) and value.get("value") is not None:
                yield key, j, {"low": None, "high": None, **value}
            elif isinstance(value, (int, float)):
                spread = (tuned[joint].get("intervals") or {}).get(key) or (None, None)
                yield key, j, {"value": float(value), "low": spread[0], "high": spread[1]}


def run(folder: Path, only: Sequence[str] = ()) -> list[Compared]:
    """All sessions of a folder that have an answer, or those named."""
    answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    found = []
    for name, entry in answers.items():
        if (not only or name in only) and (folder / name).exists():
            found.append(compare(folder / name, folder / "robot.urdf", entry))
            print(line(found[-1]), flush=True)
    return found


def line(one: Compared) -> str:
    """A session in a line."""
    true = ", ".join(f"{name}:{joint}" if joint else name for name, joint in one.true) or "nothing"
    told = ", ".join(f"{name}:{'+'.join(joints)}" for name, joints in one.told) or "no name"
    return f"{one.session}  hidden {true}  |  {one.verdict}: {told}  ({one.seconds:.1f} s)"


def summarise(found: Sequence[Compared]) -> list[str]:
    """The shares of all sessions."""
    healthy = [one for one in found if not one.true]
    single = [one for one in found if len(one.true) == 1]
    lines = [
        _share("healthy: told to have a gap", [one.verdict != "no_gap" for one in healthy]),
        _share("healthy: given a name", [bool(one.told) for one in healthy]),
        _share("single effects: first name right", [one.strict for one in single]),
        _share("single effects: a false name", [one.false_names > 0 for one in single]),
    ]
    for key in LOSSES:
        inside = [hit for one in found for hit in one.losses[key]]
        errors = sorted(abs(error) for one in found for error in one.errors[key])
        middle = f"; median error {100 * errors[len(errors) // 2]:.1f} % of {len(errors)}" if errors else ""
        lines.append(_share(f"{key}: true figure in its interval", inside) + middle)
    return lines


def _share(text: str, hits: Sequence[bool]) -> str:
    return f"{text}: {sum(hits)} of {len(hits)}" if hits else f"{text}: nothing to count"


@pytest.mark.skipif(VARIABLE not in os.environ, reason=f"{VARIABLE} names no folder")
def test_other_world() -> None:
    found = run(Path(os.environ[VARIABLE]))
    print("\n".join(summarise(found)))
    assert found


def main() -> None:
    if VARIABLE not in os.environ:
        sys.exit(f"{VARIABLE} names no folder: set it to a folder with robot.urdf, answers.json and sessions")
    print("\n".join(summarise(run(Path(os.environ[VARIABLE]), sys.argv[1:]))))


if __name__ == "__main__":
    main()
