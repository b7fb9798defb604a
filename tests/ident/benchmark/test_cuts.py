"""Sessions of a few seconds that are cut from whole ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.benchmark.corpus import INDEX, Entry, Truth, read_index, write_index
from ident.benchmark.cuts import LENGTHS_S, add_cuts, first_seconds, holds_alone, plan_cuts
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session

RATE_HZ = 100.0


def make_run(name: str, rest_s: float, moves_s: float) -> Recording:
    """A joint that stands, and then swings."""
    time = np.arange(0.0, rest_s + moves_s, 1.0 / RATE_HZ)
    angle = np.where(time < rest_s, 0.0, np.sin(2.0 * np.maximum(time - rest_s, 0.0)))
    return Recording(name, ("joint_1",), time, angle[:, None], np.ones((len(time), 1)))


@pytest.fixture
def session() -> Session:
    return Session("two", (make_run("first", 1.0, 2.0), make_run("second", 0.5, 6.0)))


def test_the_first_seconds_begin_with_motion_and_go_on_in_the_next_run(session: Session) -> None:
    first, second = first_seconds(session, 3.0).runs
    assert first.time[0] == pytest.approx(1.0, abs=0.05)
    assert second.time[0] == pytest.approx(0.5, abs=0.05)
    assert first.duration + second.duration == pytest.approx(3.0, abs=0.05)
    inside = np.isin(session.runs[1].time, second.time)
    np.testing.assert_array_equal(second.position, session.runs[1].position[inside])


def test_holds_alone_are_where_every_joint_stands(session: Session) -> None:
    rests = (1.0, 0.5)
    for run, rest_s in zip(holds_alone(session).runs, rests, strict=True):
        assert run.time[0] == 0.0
        assert np.sum(run.time < rest_s) >= 0.95 * rest_s * RATE_HZ
        speed = np.cos(2.0 * run.time[run.time > rest_s + 0.02] - 2.0 * rest_s)
        assert np.all(np.abs(speed) < 0.05)


def entry_of(case: str, kind: str, folder: Path, asked: float | None = None) -> Entry:
    truth = (Truth("payload", True, ("joint_1",), (), asked=asked),) if asked is not None else ()
    control = "" if kind == "control" else "real/control"
    return Entry(f"real/{case}", "real", kind, str(folder), "robot.urdf", "arm", "real", truth, control)


def test_controls_are_cut_to_every_length_and_what_hardly_shows_to_none(tmp_path: Path) -> None:
    entries = [
        entry_of("control", "control", tmp_path),
        entry_of("seen", "single", tmp_path, 1.0),
        entry_of("hidden", "single", tmp_path, 0.3),
        entry_of("two", "pair", tmp_path, 3.0),
    ]
    planned = [(entry.case, seconds) for entry, seconds in plan_cuts(entries, seed=3)]
    assert [seconds for case, seconds in planned if case == "real/control"] == list(LENGTHS_S)
    assert [case for case, _ in planned].count("real/seen") == 1
    assert not {"real/hidden", "real/two"} & {case for case, _ in planned}


def test_cuts_stand_in_the_index_with_truth_and_control_and_only_once(session: Session, tmp_path: Path) -> None:
    write_session(session, tmp_path / "whole")
    whole = entry_of("seen", "single", tmp_path / "whole", 1.0)
    write_index(tmp_path, [whole])
    said: list[str] = []
    add_cuts(tmp_path, 5, said.append)
    add_cuts(tmp_path, 5, said.append)
    first, cut = read_index(tmp_path / INDEX)
    assert first == whole
    assert said == [cut.case, cut.case]
    assert cut.control == f"real/control_first_{cut.seconds:g}s"
    same = replace(cut, case=whole.case, folder=whole.folder, control=whole.control, seconds=0.0)
    assert same == whole
    lasts = sum(run.duration for run in load_session(cut.folder).runs)
    assert lasts <= cut.seconds + 0.05
