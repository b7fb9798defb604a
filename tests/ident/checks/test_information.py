"""Torques that were interpolated between samples of a lower rate are told; measured ones are not."""

from pathlib import Path

import numpy as np
import pytest

from ident.checks.information import mend_information
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.names import data_path

LOGS = Path(data_path("logs/tm5_900"))


def interpolated(run: Recording, every: int, digits: int = 12) -> Recording:
    """A run of which every so many samples were kept, and drawn out again."""
    kept = np.arange(0, len(run), every)
    inside = slice(0, int(kept[-1]) + 1)
    effort = [np.interp(run.time[inside], run.time[kept], column[kept]) for column in run.effort.T]
    return run.at(inside).replace(effort=np.round(np.column_stack(effort), digits))


@pytest.mark.parametrize("every", [4, 10])
@pytest.mark.parametrize("digits", [12, 6])
def test_a_torque_drawn_out_is_told(every: int, digits: int) -> None:
    """Law: with the rate that it was logged at; the rows that were measured are left, and no others."""
    session = load_session(LOGS / "E1")
    rate = 1.0 / session.runs[0].sample_interval
    drawn_out = tuple(interpolated(run, every, digits) for run in session.runs)
    mended, (issue,) = mend_information(session.replace(runs=drawn_out))
    assert (issue.issue, issue.severity) == ("wrong_time_base", "warning")
    assert f"{rate:.4g} Hz made of {rate / every:.4g} Hz" in issue.evidence
    for run, original in zip(mended.runs, session.runs, strict=True):
        np.testing.assert_array_equal(run.time, original.time[::every])


def test_the_rows_that_were_measured_are_found_beside_dropped_ones() -> None:
    """Law: where a logger lost rows, those that were measured after them are still the ones that are left."""
    time = np.arange(0.0, 30.0, 0.01)
    position = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    effort = position + 0.02 * np.random.default_rng(4).standard_normal(position.shape)
    run = Recording("run", ("a", "b"), time, position, effort)
    left = np.delete(np.arange(2990), [203, 204, 207, 1311])
    mended, _ = mend_information(Session("session", (interpolated(run, 10).at(left),)))
    measured = np.isin(mended.runs[0].time, time[::10])
    assert measured.mean() > 0.98
    assert measured.sum() > 0.98 * len(time) / 10


@pytest.mark.parametrize("name", ["E1", "T1", "payload_1029g"])
def test_a_measured_torque_is_not(name: str) -> None:
    session = load_session(LOGS / name)
    assert mend_information(session) == (session, [])


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_neither_is_a_smooth_one_nor_a_coarse_one_nor_a_held_one(rate: float) -> None:
    """Law: without noise, in steps of a converter, and with each sample held, nothing was drawn out."""
    time = np.arange(0.0, 20.0, 1.0 / rate)
    smooth = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    for effort in (smooth, np.round(smooth, 2), np.repeat(smooth[::5], 5, axis=0)[: len(time)], 0 * smooth):
        run = Recording("run", ("a", "b"), time, smooth, effort)
        session = Session("session", (run,))
        assert mend_information(session) == (session, [])
