"""Laws of a rate that session.toml states beside a time column: told where they agree, refused where they don't."""

from pathlib import Path

import pytest
from faults import inspect, spoil

from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

ROWS = 200


def stated(session: Session, factor: float) -> Session:
    """The same where session.toml states so many times the rate that the time column gives."""
    return spoil(session, lambda run: run.replace(stated_rate_hz=factor / run.sample_interval))


@pytest.mark.parametrize("factor", [1.0, 1.01])
def test_a_rate_that_the_time_column_gives_is_told_as_not_used(factor: float, clean: Session, arm: ArmModel) -> None:
    """Law: one note with what the column gives; the verdict is as without."""
    report = inspect(stated(clean, factor), arm)
    (issue,) = report.find("stated_rate")
    assert issue.severity == "note"
    assert f"the time column gives {1.0 / clean.runs[0].sample_interval:.4g} Hz" in issue.evidence
    assert report.verdict == inspect(clean, arm).verdict


@pytest.mark.parametrize("factor", [0.5, 0.9, 2.0])
def test_a_rate_that_the_time_column_denies_is_refused(factor: float, clean: Session, arm: ArmModel) -> None:
    """Law: refused with both rates in one line."""
    (issue,) = inspect(stated(clean, factor), arm).fatal
    assert issue.issue == "wrong_time_base"
    rate = 1.0 / clean.runs[0].sample_interval
    assert f"sample_rate_hz = {factor * rate:g}" in issue.evidence
    assert f"gives {rate:.4g} Hz" in issue.evidence


@pytest.mark.parametrize(("name", "used"), [("time", False), ("timestamp", True)])
def test_the_reader_keeps_what_was_stated(name: str, used: bool, tmp_path: Path) -> None:
    """Law: beside a time column the rate is kept for the check; in place of another clock that is said."""
    rows = [f"{0.02 * k:.3f},{0.01 * k:.3f},1.0" for k in range(ROWS)]
    (tmp_path / "run.csv").write_text("\n".join([f"{name},a/position,a/effort", *rows]))
    (tmp_path / "session.toml").write_text("sample_rate_hz = 100")
    run = load_session(tmp_path).runs[0]
    assert run.sample_interval == pytest.approx(0.01 if used else 0.02)
    assert run.stated_rate_hz == (None if used else 100.0)
    assert [issue.issue for issue in run.issues] == ["stated_rate"] * used
