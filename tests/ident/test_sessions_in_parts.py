"""A long session is read in parts: together they are the session, and each waits for its turn."""

import weakref
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident import sessions
from ident.checks.inspection import inspect_parts
from ident.checks.report import TelemetryReport
from ident.command_options import FitOptions
from ident.diagnosis import from_reports as command
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import find_effect
from ident.errors import RecordingError
from ident.fitting.fit import fit_hybrid
from ident.motion import stretches
from ident.motion.settings import USUAL_MOTION
from ident.recordings.load import load_parts, load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.sessions import Given, inspect_sources, open_sessions
from tests.ident.diagnosis.planted import load_arm, sprung_session

RUN = 1000  # samples


@pytest.fixture(scope="module")
def session() -> Session:
    return sprung_session()


def in_parts(paths: list[Path], robot: ArmModel | None = None) -> tuple[ArmModel, Iterable[TelemetryReport]]:
    """Robot and reports as a diagnosis reads them."""
    found = inspect_sources(Given(paths, robot), in_parts=True)
    return found.arm, found.reports


@pytest.fixture
def folder(session: Session, tmp_path: Path) -> Path:
    write_session(session, tmp_path / "long")
    return tmp_path / "long"


@pytest.fixture
def long_from_2_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "PART_SAMPLES", 2 * RUN)


def test_parts_are_the_session(folder: Path) -> None:
    """Law: parts of consecutive runs, end to end, are the session; a part ends with the run that fills it."""
    whole = load_session(folder)
    parts = list(load_parts(folder, most=RUN + 1))
    assert [len(part.runs) for part in parts] == [2, 2, 2]
    for one, other in zip((run for part in parts for run in part.runs), whole.runs, strict=True):
        assert one.name == other.name
        assert np.array_equal(one.position, other.position)
    assert all((part.name, part.robot, part.common_clock) == (whole.name, whole.robot, True) for part in parts)
    (folder / "run_5.parquet").write_bytes(b"no table")  # does not matter before its turn
    waiting = load_parts(folder, most=2 * RUN)
    assert [[run.name for run in next(waiting).runs] for _ in range(2)] == [["run_0", "run_1"], ["run_2", "run_3"]]
    with pytest.raises(RecordingError, match="run_5"):
        next(waiting)


def test_parts_share_joints_and_clock(session: Session, tmp_path: Path) -> None:
    """Law: a clock that restarts between two parts is reported; joints that change between them are refused."""
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


def test_parts_are_let_go(session: Session) -> None:
    """Law: when a part is read, the check holds none of the parts before it, nor what it made of them."""
    alive: weakref.WeakSet[Session] = weakref.WeakSet()
    left: list[int] = []

    def coming() -> Iterator[Session]:
        for k in range(3):
            left.append(len(alive))
            part = session.replace(runs=[run.replace() for run in session.runs[2 * k : 2 * k + 2]])
            alive.add(part)
            yield part
            del part

    for report in inspect_parts(coming(), load_arm()):
        alive.add(report.session)
        del report
    assert left == [0, 0, 0]


def test_short_sessions_come_whole(folder: Path) -> None:
    """Law: below the limit the reports are those of sessions read whole."""
    _, reports = in_parts([folder])
    _, expected = inspect_sources(Given([folder])).whole
    assert isinstance(reports, tuple)
    assert [report.to_dict() for report in reports] == [report.to_dict() for report in expected]


@pytest.mark.usefixtures("long_from_2_runs")
def test_diagnosis_in_parts_names_the_same(folder: Path) -> None:
    """Law: read in parts or whole, a session has the same runs, samples, clock and names."""
    few = tuple(find_effect(name) for name in ("spring_torque", "load_dependent_friction"))
    arm, parts = in_parts([folder])
    parted, analysis, _ = diagnose_reports(parts, arm, few)
    whole, expected, _ = diagnose_reports(inspect_sources(Given([folder])).whole[1], arm, few)
    assert parted.session == pytest.approx(whole.session)
    assert analysis.session.common_clock
    assert expected.session.common_clock
    names = [[(one.estimate.group.effect.id, one.joints) for one in each.findings] for each in (parted, whole)]
    assert names[0] == names[1] == [("spring_torque", ("joint_3",))]


@pytest.mark.usefixtures("long_from_2_runs")
def test_a_long_session_is_diagnosed_by_stretches(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: of more samples than are held, stretches from all over give the same name; the record has the whole session,

    and says how much of it was used.
    """
    monkeypatch.setattr(stretches, "HELD_SAMPLES", 3 * RUN)
    monkeypatch.setattr(stretches, "STRETCH_SAMPLES", RUN // 2)
    arm, parts = in_parts([folder])
    found, analysis, motions = diagnose_reports(parts, arm, (find_effect("spring_torque"),))
    assert [(one.estimate.group.effect.id, one.joints) for one in found.findings] == [("spring_torque", ("joint_3",))]
    assert (found.session["runs"], found.session["samples"]) == (6, 6 * RUN)
    assert sum(len(motion.time) for motion in motions) == 3 * RUN
    assert len({motion.name.split(" (")[0] for motion in motions}) >= 4
    (note,) = [one for one in found.telemetry if one.issue == "used_in_part"]
    assert note.evidence.startswith(f"{3 * RUN} of {6 * RUN} samples")
    assert note.severity == "note"
    assert analysis is not None


def written(session: Session, change: Callable[[int, Recording], Recording], folder: Path) -> Path:
    """A folder of the session with some runs changed, by their number."""
    write_session(session.replace(runs=[change(k, run) for k, run in enumerate(session.runs)]), folder)
    return folder


def flipped(run: Recording, joints: tuple[int, ...]) -> Recording:
    """A run whose torque of some joints has the wrong sign."""
    return run.replace(effort=np.where(np.isin(np.arange(3), joints), -1.0, 1.0) * run.effort)


def resting(run: Recording, joints: tuple[int, ...] = (0, 1, 2)) -> Recording:
    """A run in which some joints stand still but for noise; its torque stays that of the motion."""
    still = np.isin(np.arange(3), joints)
    return run.replace(position=np.where(still, 0.3 + 1e-5 * (run.position - run.position.mean(axis=0)), run.position))


@pytest.mark.usefixtures("long_from_2_runs")
def test_no_later_fault_hides_behind_an_earlier_one(session: Session, tmp_path: Path) -> None:
    """Law: a fault that forbids a fit is reported in whatever part it shows, and each session's faults are its own."""
    late = written(session, lambda k, run: flipped(run, (1,)) if k >= 2 else run, tmp_path / "late")
    arm, reports = in_parts([late])
    found = list(reports)
    fatal = [[issue.issue for issue in report.fatal] for report in found[:3]]
    assert fatal == [[], ["effort_sign_flipped"], ["effort_sign_flipped"]]
    assert diagnose_reports(found, arm, ())[0].verdict == "refused"
    with pytest.raises(RecordingError, match="effort_sign_flipped"):
        open_sessions([late], load_arm())


@pytest.mark.usefixtures("long_from_2_runs")
def test_each_session_is_told_of_its_own_faults_once(session: Session, tmp_path: Path) -> None:
    """Law: a fault of two sessions is reported once for each of them, though both come in parts, and mended in each."""
    jump = 2 * np.pi * (np.arange(RUN) > 500)[:, None]
    folders = [
        written(session, lambda _, run: run.replace(position=run.position + jump), tmp_path / name)
        for name in ("one", "other")
    ]
    found = list(in_parts(folders)[1])
    assert [len(report.session.runs) for report in found[:6]] == [2] * 6
    seen = [[issue.issue for issue in report.issues].count("position_wraps") for report in found]
    assert (sum(seen[:3]), sum(seen)) == (1, 2)
    assert all(np.abs(np.diff(run.position, axis=0)).max() < 1.0 for report in found for run in report.session.runs)


@pytest.mark.usefixtures("long_from_2_runs")
@pytest.mark.parametrize("joints", [(0, 1, 2), (1,)])
def test_parts_lack_what_the_session_lacks(session: Session, tmp_path: Path, joints: tuple[int, ...]) -> None:
    """Law: joints that stand still in every part are told as those of the whole session; all of them: not testable."""
    folder = written(session, lambda _, run: resting(run, joints), tmp_path / "resting")
    arm, reports = in_parts([folder])
    found = list(reports)
    _, (whole,) = inspect_sources(Given([folder])).whole
    said = [issue for report in found for issue in report.find("insufficient_excitation")]
    expected = whole.find("insufficient_excitation")
    assert expected
    assert [(one.joints, one.severity) for one in said] == [(one.joints, one.severity) for one in expected]
    # A joint that moves in another part has travelled: one part at rest forbids nothing.
    pausing = written(session, lambda k, run: resting(run, joints) if k in (2, 3) else run, tmp_path / "pausing")
    paused = [issue for report in in_parts([pausing])[1] for issue in report.find("insufficient_excitation")]
    assert not [issue for issue in paused if issue.joints]
    if len(joints) == 3:
        verdict, _, _ = diagnose_reports(found, arm, ())
        assert verdict.verdict == "not_testable"
        assert verdict.session["runs"] == 6


@pytest.mark.usefixtures("long_from_2_runs")
def test_an_aborted_run_alone_in_a_part_is_left_out(session: Session, tmp_path: Path) -> None:
    """Law: a part without a run of 1 s gives no motion, as in the whole session; without any such run that is said."""
    last = session.runs[5].replace(name="run_6", time=session.runs[5].time + 9.0).at(slice(0, 60))
    write_session(session.replace(runs=[*session.runs, last]), tmp_path / "aborted")
    _, reports = in_parts([tmp_path / "aborted"])
    found = list(reports)
    assert [len(report.session.runs) for report in found if report.session.runs] == [2, 2, 2, 1]
    motions = list(command._prepare_in_turn(found, command._Collected(), 25.0, USUAL_MOTION))
    assert [motion.name for motion in motions] == [f"run_{k}" for k in range(6)]
    shorts = [run.at(slice(k, k + 60)) for run in session.runs for k in (0, 100)]
    with pytest.raises(RecordingError, match="no run lasts 1 s"):
        diagnose_reports([TelemetryReport(session.replace(runs=shorts), ())], load_arm(), ())


@pytest.mark.usefixtures("long_from_2_runs")
def test_a_later_session_may_name_the_robot(session: Session, tmp_path: Path) -> None:
    """Law: in parts as in whole, the first session.toml that names a robot names it, however late its turn comes."""
    write_session(session.replace(robot=None), tmp_path / "first")
    write_session(session, tmp_path / "second")
    arm, reports = in_parts([tmp_path / "first", tmp_path / "second"])
    assert not isinstance(reports, tuple)
    assert arm.name == inspect_sources(Given([tmp_path / "first", tmp_path / "second"])).whole[0].name
    with pytest.raises(RecordingError, match="no robot is named"):
        in_parts([tmp_path / "first"])


def test_a_run_that_comes_again_parts_later_is_told(session: Session, tmp_path: Path, long_from_2_runs: None) -> None:
    """Law: a held-out run is no copy of a fitted one, however far between they were read."""
    write_session(session.replace(runs=[*session.runs, session.runs[1].replace(name="again")]), tmp_path / "twice")
    _, reports = in_parts([tmp_path / "twice"], load_arm())
    fatal = [issue for report in reports for issue in report.fatal]
    assert [issue.issue for issue in fatal if issue.issue == "repeated_session"] == ["repeated_session"]
    write_session(session, tmp_path / "once")
    (tmp_path / "linked").symlink_to(tmp_path / "once")
    _, reports = in_parts([tmp_path / "once", tmp_path / "linked"], load_arm())
    assert any(issue.issue == "repeated_session" for report in reports for issue in report.fatal)


def test_a_long_session_is_opened_and_fitted_in_parts(
    folder: Path, long_from_2_runs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: of the runs nothing is held but stretches from all over; what is fitted of them is what the whole gives."""
    arm, options = load_arm(), FitOptions(net="none", inertia="nominal")
    monkeypatch.setattr(sessions, "FITTED_SAMPLES", 3 * RUN)
    monkeypatch.setattr(stretches, "STRETCH_SAMPLES", RUN // 2)
    parts = open_sessions([folder], arm)
    assert not any(report.session.runs for report in parts.reports)
    ((name, group),) = parts.groups
    assert (name, len(group)) == (folder.name, 6)
    monkeypatch.setattr(sessions, "PART_SAMPLES", 100 * RUN)
    monkeypatch.setattr(sessions, "FITTED_SAMPLES", 100 * RUN)
    whole = open_sessions([folder], arm)
    assert parts.stamps == whole.stamps
    assert parts.data_records() == whole.data_records()
    assert (parts.arm.joint_names, len(whole.motions)) == (whole.arm.joint_names, 6)
    found, expected = (fit_hybrid(one.motions, one.arm, options).model for one in (parts, whole))
    assert found.provenance["samples"] == expected.provenance["samples"] / 2 == 3 * RUN
    for figure, other in zip(found.figures, expected.figures, strict=True):
        assert figure.value == pytest.approx(other.value, abs=0.5 * (other.high - other.low))
        # Pieces this short are stretches of their own: twice as many repeats of the friction.
        assert 1 / 3 < (figure.high - figure.low) / (other.high - other.low) < 3
