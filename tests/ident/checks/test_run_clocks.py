"""Laws of clocks that change their speed behind a gap: told with their stretches, the rest stays."""

from collections.abc import Callable

import numpy as np
import pytest
from faults import inspect, spoil, without_velocity

from ident.checks.run_clocks import check_run_clocks
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path


def slowed(factor: float, gap: float) -> Callable[[Recording], Recording]:
    """From the middle of a run on, behind a gap [s], time goes on at another speed."""

    def change(run: Recording) -> Recording:
        middle = len(run) // 2
        stamps = np.array(run.time)
        stamps[middle:] = stamps[middle] + gap + factor * (stamps[middle:] - stamps[middle])
        return run.replace(time=stamps)

    return change


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_clock_that_goes_otherwise_behind_a_gap_is_told(factor: float, clean: Session, arm: ArmModel) -> None:
    """Law: the stretch behind the gap is named, with its factor, and left out; the rest is fit for use."""
    spoilt = spoil(clean, slowed(factor, 1.0), 0)
    rest, (issue,) = check_run_clocks(spoilt)
    assert (issue.issue, issue.severity) == ("wrong_time_base", "warning")
    assert f"{clean.runs[0].name}[1]:" in issue.evidence
    assert f"is {factor:.3g} times" in issue.evidence
    assert len(rest.runs) == len(clean.runs)
    assert inspect(spoilt, arm).find("wrong_time_base")
    assert not inspect(spoilt, arm).fatal


def test_clocks_of_all_runs_may_change_behind_gaps(clean: Session, arm: ArmModel) -> None:
    """Law: told once, and nothing else is accused."""
    report = inspect(spoil(clean, slowed(0.5, 1.0)), arm)
    assert len(report.find("wrong_time_base")) == 1
    assert not report.fatal


def test_a_gap_alone_is_no_other_clock(clean: Session) -> None:
    assert check_run_clocks(spoil(clean, slowed(1.0, 1.0)))[1] == []


def test_a_clock_that_is_wrong_everywhere_is_another_fault(clean: Session) -> None:
    """Law: where no stretch is right, the whole time base is told, elsewhere."""
    runs = [run.replace(time=0.5 * run.time) for run in clean.runs]
    assert check_run_clocks(clean.replace(runs=runs))[1] == []


@pytest.mark.parametrize("name", ["E1", "T1"])
def test_clocks_as_they_were_recorded_stand(name: str) -> None:
    assert check_run_clocks(load_session(data_path(f"logs/tm5_900/{name}")))[1] == []


def test_positions_without_velocities_tell_nothing(clean: Session) -> None:
    silent = without_velocity(spoil(clean, slowed(0.5, 1.0), 0))
    assert check_run_clocks(silent) == (silent, [])
