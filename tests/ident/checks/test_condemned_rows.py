"""Law: what an earlier check condemned moves no later one, whatever stands in the cells that went with it."""

from collections.abc import Callable

import numpy as np
import pytest
from faults import inspect, spoil

from ident.checks.report import TelemetryReport
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

FIRST, LAST = 200, 330  # rows that are condemned
Change = Callable[[Recording, float], Recording]


def bumped(values: np.ndarray, size: float) -> np.ndarray:
    """The values with a smooth hump over the condemned rows, and as they are outside."""
    changed = np.array(values)
    phase = np.linspace(0.0, np.pi, LAST - FIRST)[:, None]
    changed[FIRST:LAST] += size * np.sin(phase) ** 2
    return changed


def frozen_torque(run: Recording, size: float) -> Recording:
    """The torque of all joints is frozen; the position beside it is anything."""
    effort = np.array(run.effort)
    effort[FIRST - 1 : LAST + 1] = effort[FIRST - 1]
    return run.replace(effort=effort, position=bumped(run.position, size), velocity=None)


def repeated_rows(run: Recording, size: float) -> Recording:
    """Rows that come late a second time, with another torque."""
    rows = np.sort(np.r_[np.arange(len(run)), np.arange(FIRST, LAST, 10)])
    again = np.r_[False, np.diff(rows) == 0]
    twice = run.at(rows)
    effort = np.array(twice.effort)
    effort[again] += 20.0 * size
    return twice.replace(effort=effort)


def broken_clock(run: Recording, size: float) -> Recording:
    """Cells of the clock that are no time, beside torques of any size."""
    time, effort = np.array(run.time), np.array(run.effort)
    time[FIRST:LAST:13] = np.nan
    effort[FIRST:LAST:13] *= 1.0 + 100.0 * size
    return run.replace(time=time, effort=effort)


def dead_velocity(run: Recording, size: float) -> Recording:
    """A velocity that stands at one value all the time, whichever that is."""
    return run.replace(velocity=np.full_like(run.position, size))


def said(report: TelemetryReport) -> list[tuple[str, tuple[str, ...], str]]:
    """What a report says, but for its figures."""
    return [(issue.issue, issue.joints, issue.severity) for issue in report.issues]


@pytest.mark.parametrize("change", [frozen_torque, repeated_rows, broken_clock, dead_velocity])
def test_nothing_follows_from_what_was_condemned(change: Change, clean: Session, arm: ArmModel) -> None:
    reports = [inspect(spoil(clean, lambda run, size=size: change(run, size), run=1), arm) for size in (0.1, 0.2, 0.3)]
    first, *others = reports
    assert said(first) or first.session.samples < clean.samples
    for report in others:
        assert said(report) == said(first)
        assert report.conventions == first.conventions
        assert report.effort == first.effort
        for run, other in zip(report.session.runs, first.session.runs, strict=True):
            np.testing.assert_array_equal(run.position, other.position)
            np.testing.assert_array_equal(run.effort, other.effort)
