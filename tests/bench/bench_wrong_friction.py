"""Friction that is 1.5 times what a URDF says, and nothing else: first line, table, patched file, replay.

    python -m tests.bench.bench_wrong_friction OUT [--robots tm5-900,ur5] [--seeds 1,2,3]

The recordings and the replay are those of plain numpy (tests/ident/plain_arm.py), which shares nothing with armgap.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from ident import diagnose, patch
from ident.robot.names import find_urdf
from ident.show.report.diagnosis_verdict import diagnosis_headline
from tests.ident.plain_arm import STEP, PlainArm, motion_of, record, state_friction

FACTOR = 1.5
UNSEEN = 77  # seed of a motion that no session holds
REPLAYED_S = 0.25
LEAST_SPEED = 0.05  # of every joint while a replay runs, for none may turn round [rad/s]
FIRST_LINE = re.compile(r"Friction is ([\d.]+) times what your URDF says at every joint")


@dataclass(frozen=True)
class Outcome:
    """How far what a user sees is from what was planted, and how far the files are off on unseen motion."""

    headline: str
    said: float | None  # the first line's factor; None where it is another line
    table: float  # largest relative error of a damping or dry friction in the record
    file: float  # the same in the patched URDF
    torque: tuple[float, float]  # relative error before and after, of the worst joint
    angle: tuple[float, float]  # after `REPLAYED_S` of replay, the median over windows of the worst joint [rad]


def check(text: str, seed: int, folder: Path, unseen_s: float = 30.0) -> Outcome:
    """Records an arm with more friction than its URDF says, diagnoses and patches it, and replays the file.

    Args:
        text: Some arm's URDF.
        seed: Of the recordings.
        folder: Gets session, URDF and patch.
        unseen_s: Length of the motion that is replayed [s].
    """
    folder.mkdir(parents=True)
    urdf, mine = folder / "arm.urdf", folder / "mine.urdf"
    for path in (urdf, mine):
        path.write_text(state_friction(text, 1.0))
    true = PlainArm.read(state_friction(text, FACTOR))
    found = diagnose(record(true, folder / "session", seed), urdf).to_dict()
    patch(found, urdf, folder / "patch", into=mine)
    headline = diagnosis_headline(found)
    factor = FIRST_LINE.match(headline)
    before, after = PlainArm.read(urdf.read_text()), PlainArm.read(mine.read_text())
    shown = np.array([_losses(found["identified"][joint]) for joint in true.joints]).T
    return Outcome(
        headline=headline,
        said=float(factor[1]) if factor else None,
        table=_farthest(shown, true),
        file=_farthest(np.array([after.damping, after.friction]), true),
        torque=(_torque_error(before, true), _torque_error(after, true)),
        angle=_replay_errors(before, after, true, unseen_s),
    )


def _losses(figures: dict[str, Any]) -> tuple[float, float]:
    return figures["viscous_Nms_rad"]["value"], figures["coulomb_Nm"]["value"]


def _farthest(found: np.ndarray, true: PlainArm) -> float:
    planted = np.array([true.damping, true.friction])
    return float(np.max(np.abs(found / planted - 1.0)))


def _torque_error(arm: PlainArm, true: PlainArm) -> float:
    """Of the worst joint, as a share of its torque."""
    _, q, dq, ddq = motion_of(len(true.joints), UNSEEN, 8.0)
    truth = true.torque(q, dq, ddq)
    error = arm.torque(q, dq, ddq) - truth
    return float(np.max(np.linalg.norm(error, axis=0) / np.linalg.norm(truth, axis=0)))


def _replay_errors(before: PlainArm, after: PlainArm, true: PlainArm, unseen_s: float) -> tuple[float, float]:
    """Of the worst joint [rad]."""
    _, q, dq, ddq = motion_of(len(true.joints), UNSEEN, unseen_s, 1.0 / STEP)
    truth = true.torque(q, dq, ddq)
    steps = round(REPLAYED_S / STEP)
    starts = [k for k in range(0, len(q) - steps, steps) if _never_turns(dq[k : k + steps])]
    misses: list[list[np.ndarray]] = [[], []]
    for start in starts:
        for arm, errors in zip((before, after), misses, strict=True):
            path = arm.replay(q[start], dq[start], truth[start : start + steps])
            errors.append(np.abs(path[-1] - q[start + steps]))
    medians = [np.median(errors, axis=0).max() for errors in misses]
    return float(medians[0]), float(medians[1])


def _never_turns(speed: np.ndarray) -> bool:
    steady = np.all(np.sign(speed) == np.sign(speed[0]))
    return bool(steady and np.abs(speed).min() > LEAST_SPEED)


def main(out: Path, robots: str = "tm5-900,ur5", seeds: str = "1,2,3") -> None:
    for robot in robots.split(","):
        text = find_urdf(robot).read_text()
        for seed in map(int, seeds.split(",")):
            outcome = check(text, seed, out / f"{robot}_{seed}")
            cells = [robot, str(seed), outcome.headline]
            cells += [f"{100.0 * error:.2f} %" for error in (outcome.table, outcome.file)]
            cells += [" → ".join(f"{100.0 * error:.2f}" for error in outcome.torque) + " %"]
            cells += [" → ".join(f"{1000.0 * error:.2f}" for error in outcome.angle) + " mrad"]
            print(" | ".join(cells), flush=True)


if __name__ == "__main__":
    typer.run(main)
