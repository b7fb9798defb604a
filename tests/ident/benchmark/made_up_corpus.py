"""A small corpus of made-up results, whose features say how likely a candidate is right."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ident.benchmark.corpus import Entry, Truth
from ident.benchmark.corpus_run import result_path

JOINTS = ("joint_1", "joint_2", "joint_3")
EFFECTS = ("stribeck_friction", "torque_ripple", "spring_torque")
# True log odds: per unit of evidence, and of a candidate without any.
SLOPE, BASE = 2.0, -2.0


def truth(effect: str, joint: str, **parameters: float) -> Truth:
    """A planted effect that is asked to show three times the noise."""
    return Truth(effect, True, (joint,), (joint,), dict(parameters), asked=3.0)


def entry(case: str, *truths: Truth, kind: str = "single", arm: str = "made", control: str = "") -> Entry:
    """A session of the corpus, without recordings."""
    group = case.partition("/")[0]
    return Entry(case, group, kind, "", "", arm, arm, truths, control)


def candidate(effect: str, joint: str, **changes: Any) -> dict[str, Any]:
    """A candidate as an engine writes it."""
    row = {"effect": effect, "joint": joint, "other": None, "class": [effect], "joints": [joint]}
    return {**row, "features": {}, "parameters": {}, "rivals": [], "named": False, **changes}


def write_result(out: Path, case: str, *candidates: dict[str, Any], **changes: Any) -> None:
    """A session's result."""
    record = {
        "case": case,
        "seconds": 1.0,
        "peak_mb": 100.0,
        "verdict": "named",
        "candidates": candidates,
    }
    path = result_path(out, case)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**record, "diagnosis": {"findings": []}, **changes}), encoding="utf-8")


def make_corpus(out: Path, sessions: int, seed: int, arms: int = 6) -> list[Entry]:
    """Sessions of one effect each, on several arms in two groups.

    A session's candidate is right with the log odds that its evidence says.
    """
    rng = np.random.default_rng(seed)
    entries: list[Entry] = []
    for number in range(sessions):
        arm = number % arms
        group = "worlds" if arm % 2 else "other"  # what a real arm has of its own is neither right nor wrong
        case = f"{group}/case_{number:04d}"
        places = [(effect, joint) for effect in EFFECTS for joint in JOINTS]
        order = rng.permutation(len(places))
        evidence = float(rng.normal(1.0, 1.0))
        right = rng.random() < 1.0 / (1.0 + np.exp(-(SLOPE * evidence + BASE)))
        chosen = places[int(order[0])]
        hidden = chosen if right else places[int(order[-1])]
        size = float(rng.uniform(0.5, 2.0))
        estimate = size + 0.1 * float(rng.standard_normal())
        figures = {"amplitude_Nm": {"value": estimate, "low": estimate - 0.1, "high": estimate + 0.1}}
        features = {"evidence": evidence, "nothing": float(rng.standard_normal())}
        rows = [candidate(*chosen, features=features, parameters=figures)]
        entries.append(entry(case, truth(*hidden, amplitude_Nm=size), arm=f"arm_{arm}"))
        write_result(out, case, *rows)
    return entries
