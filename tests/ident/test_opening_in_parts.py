"""A long session is read in parts: together they are the session, and each waits for its turn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident import opening
from ident.arrays import Array
from ident.diagnosis.command import diagnose_reports
from ident.effects.catalogue import find_effect
from ident.errors import RecordingError
from ident.opening import inspect_in_parts, inspect_paths
from ident.reading import load_parts, load_session
from ident.recording import Session
from ident.writing import write_session
from tests.ident.diagnosis.planted import healthy_torque, load_arm, spring_on_3
from tests.ident.made_up import made_session

RUN = 1000  # samples


@pytest.fixture(scope="module")
def session() -> Session:
    """Six runs of 8 s at 125 Hz, with a spring across joint 3."""
    arm = load_arm()

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        return healthy_torque(arm, q, dq, ddq) + spring_on_3(arm, q, dq, ddq)

    return made_session(arm, law, range(6), 8.0, 125.0)


@pytest.fixture
def folder(session: Session, tmp_path: Path) -> Path:
    write_session(session, tmp_path / "long")
    return tmp_path / "long"


@pytest.fixture
def long_from_2_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "PART_SAMPLES", 2 * RUN)


def test_parts_are_the_session(folder: Path) -> None:
    """Law: parts of consecutive runs, end to end, are the session; a part ends with the run that fills it."""
    whole = load_session(folder)
    parts = list(load_parts(folder, most=RUN + 1))
    assert [len(part.runs) for part in parts] == [2, 2, 2]
    for one, other in zip((run for part in parts for run in part.runs), whole.runs, strict=True):
        assert one.name == other.name
        assert np.array_equal(one.position, other.position)
    assert all((part.name, part.robot, part.common_clock) == (whole.name, whole.robot, True) for part in parts)


def test_files_wait_for_their_turn(folder: Path) -> None:
    """Law: what is wrong with a later part's file does not matter before that part's turn."""
    (folder / "run_5.parquet").write_bytes(b"no table")
    parts = load_parts(folder, most=2 * RUN)
    assert [run.name for run in next(parts).runs] == ["run_0", "run_1"]
    assert [run.name for run in next(parts).runs] == ["run_2", "run_3"]
    with pytest.raises(RecordingError, match="run_5"):
        next(parts)


def test_parts_share_joints_and_clock(session: Session, tmp_path: Path) -> None:
    """Law: a clock that restarts between two parts is told; joints that change between them are refused."""
    runs = list(session.runs)
    runs[4] = replace(runs[4], time=runs[0].time)
    write_session(session.replace(runs=runs), tmp_path / "restarted")
    parts = list(load_parts(tmp_path / "restarted", most=2 * RUN))
    assert [part.common_clock for part in parts] == [True, True, False]
    assert [note.issue for note in parts[2].notes] == ["clock_restarts"]
    write_session(session.replace(runs=runs[:2]), tmp_path / "changed")
    write_session(session.replace(runs=[runs[3].select(runs[3].joints[:2])]), tmp_path / "other")
    (tmp_path / "other" / "run_3.parquet").rename(tmp_path / "changed" / "run_3.parquet")
    parts_of_both = load_parts(tmp_path / "changed", most=2 * RUN)
    next(parts_of_both)
    with pytest.raises(RecordingError, match="has other joints than run_1"):
        next(parts_of_both)


def test_short_sessions_come_whole(folder: Path) -> None:
    """Law: below the limit the reports are those of `inspect_paths`."""
    _, reports = inspect_in_parts([folder], None)
    _, expected = inspect_paths([folder], None)
    assert isinstance(reports, tuple)
    assert [report.to_dict() for report in reports] == [report.to_dict() for report in expected]


@pytest.mark.usefixtures("long_from_2_runs")
def test_what_all_parts_show_is_told_once(session: Session, tmp_path: Path) -> None:
    """Law: a fault of the whole session is one issue, mended in every part."""
    turned = [
        run.replace(position=run.position + 2 * np.pi * (np.arange(len(run)) > 500)[:, None]) for run in session.runs
    ]
    write_session(session.replace(runs=turned), tmp_path / "wrapped")
    _, reports = inspect_in_parts([tmp_path / "wrapped"], None)
    found = list(reports)
    assert [len(report.session.runs) for report in found] == [2, 2, 2]
    told = [issue.issue for report in found for issue in report.issues]
    assert told.count("position_wraps") == 1
    assert all(np.abs(np.diff(run.position, axis=0)).max() < 1.0 for report in found for run in report.session.runs)


@pytest.mark.usefixtures("long_from_2_runs")
def test_diagnosis_in_parts_names_the_same(folder: Path) -> None:
    """Law: read in parts or whole, a session has the same runs, samples, clock and names."""
    few = tuple(find_effect(name) for name in ("spring_torque", "load_dependent_friction"))
    arm, parts = inspect_in_parts([folder], None)
    in_parts, analysis, _ = diagnose_reports(parts, arm, few)
    whole, expected, _ = diagnose_reports(inspect_paths([folder], None)[1], arm, few)
    assert in_parts.session == whole.session
    assert analysis is not None
    assert expected is not None
    assert analysis.session.common_clock
    assert expected.session.common_clock
    names = [[(one.estimate.group.effect.id, one.joints) for one in each.findings] for each in (in_parts, whole)]
    assert names[0] == names[1] == [("spring_torque", ("joint_3",))]
