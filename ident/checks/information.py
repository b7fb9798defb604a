"""Whether a recording holds as much as its rate says.

Torques that go on straight lines were logged more slowly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.checks.report import Findings
from ident.checks.settings import INFORMATION as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue


class Lines(NamedTuple):
    """Torques of a run that go on straight lines."""

    steps: dict[int, int]  # joint -> samples from corner to corner
    corners: Bool[Array, "T n"]  # where a joint's torque changes its slope; others nowhere

    @property
    def step(self) -> int:
        """Samples from corner to corner, of most joints."""
        return int(np.median(list(self.steps.values())))

    def measured(self) -> Int[Array, " k"]:
        """Rows that were measured: where most of these joints have a corner, and whole steps on.

        A slope that goes on through a measured row shows no corner there.
        """
        at_most = self.corners.sum(axis=1) > 0.5 * len(self.steps)
        anchors = np.flatnonzero(at_most)
        rows = np.arange(len(self.corners))
        before = np.searchsorted(anchors, rows, side="right") - 1
        nearest = anchors[np.maximum(before, 0)]
        return rows[(rows - nearest) % self.step == 0]


def mend_information(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Takes out rows whose torques were interpolated between samples of a lower rate.

    A measured torque has noise in every sample. Where most samples lie on the line between their
    neighbours, and corners come every so many samples, nothing was measured in between: what
    follows takes these rows for evidence, and their corners for vibrations.

    Returns:
        The session with the measured rows alone, and the issue; as it was, and none, where all
        are.
    """
    findings = Findings(session)
    for run in session.runs:
        lines = find_lines(run)
        if lines is None:
            findings.runs.append(run)
            continue
        step = lines.step
        rate = 1.0 / run.sample_interval
        made_of = f"{rate:.4g} Hz made of {rate / step:.4g} Hz"
        findings.note(
            run, f"torques go on straight lines over {step} samples: {made_of}", lines.steps
        )
        findings.runs.append(run.at(lines.measured()))
    return findings.left(), findings.issues("interpolated")


def find_lines(run: Recording) -> Lines | None:
    """The torques that go on straight lines, if those of most joints that have any do."""
    steps: dict[int, int] = {}
    corners = np.zeros(run.effort.shape, dtype=bool)
    for joint in range(len(run.joints)):
        of_joint = corners_of(run, joint)
        step = step_between(of_joint)
        if step is not None:
            steps[joint] = step
            corners[of_joint, joint] = True
    moving = int((np.ptp(run.effort, axis=0) > 0.0).sum()) if len(run) else 0
    return Lines(steps, corners) if len(steps) > LIMIT.most_joints * moving else None


def corners_of(run: Recording, joint: int) -> Int[Array, " k"]:
    """Rows in which a torque that goes on straight lines changes its slope.

    Empty where it goes on none.

    Args:
        run: The run.
        joint: Index of the joint.
    """
    none = np.zeros(0, dtype=int)
    effort = run.effort[:, joint]
    if len(effort) < LIMIT.least_samples:
        return none
    slope = np.diff(effort) / np.diff(run.time)
    rises = np.abs(slope) > LIMIT.flat * np.abs(slope).max(initial=0.0)
    changing = rises[:-1] & rises[1:]
    straight = changing & _alike(slope[:-1], slope[1:])
    if not changing.any() or straight.sum() < LIMIT.most_samples * changing.sum():
        return none
    return 1 + np.flatnonzero(changing & ~straight)


def step_between(corners: Int[Array, " k"]) -> int | None:
    """Rows from corner to corner; None where these are few, near or irregular."""
    if len(corners) < LIMIT.least_corners:
        return None
    spans = np.diff(corners)
    step = int(np.median(spans))
    regular = np.mean(spans % max(step, 1) == 0)
    return step if step >= LIMIT.shortest_line and regular >= LIMIT.regular else None


def _alike(before: Float[Array, " T"], after: Float[Array, " T"]) -> Bool[Array, " T"]:
    """Whether two slopes are one but for rounding."""
    size = np.maximum(np.abs(before), np.abs(after))
    return np.abs(after - before) <= LIMIT.rounding * size
