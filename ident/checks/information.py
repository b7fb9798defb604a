"""Whether a recording holds as much as its rate says.

Torques that go on straight lines were logged more slowly.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.report import Findings
from ident.checks.settings import INFORMATION as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue


def check_information(session: Session) -> list[TelemetryIssue]:
    """Finds torques that were interpolated between samples of a lower rate.

    A measured torque has noise in every sample. Where most samples lie on the line between their
    neighbours, and corners come every so many samples, nothing was measured in between.
    """
    findings = Findings(session)
    for run in session.runs:
        lengths = {joint: line_length(run, joint) for joint in range(len(run.joints))}
        steps = {joint: length for joint, length in lengths.items() if length is not None}
        moving = int((np.ptp(run.effort, axis=0) > 0.0).sum()) if len(run) else 0
        if len(steps) > LIMIT.most_joints * moving:
            step = int(np.median(list(steps.values())))
            rate = 1.0 / run.sample_interval
            made_of = f"{rate:.4g} Hz made of {rate / step:.4g} Hz"
            findings.note(
                run, f"torques go on straight lines over {step} samples: {made_of}", steps
            )
    return findings.issues("interpolated")


def line_length(run: Recording, joint: int) -> int | None:
    """Samples from corner to corner of a torque that goes on straight lines.

    None where it does not.

    Args:
        run: The run.
        joint: Index of the joint.
    """
    effort = run.effort[:, joint]
    if len(effort) < LIMIT.least_samples:
        return None
    slope = np.diff(effort) / np.diff(run.time)
    rises = np.abs(slope) > LIMIT.flat * np.abs(slope).max(initial=0.0)
    changing = rises[:-1] & rises[1:]
    straight = changing & _alike(slope[:-1], slope[1:])
    if not changing.any() or straight.sum() < LIMIT.most_samples * changing.sum():
        return None
    corners = np.flatnonzero(changing & ~straight)
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
