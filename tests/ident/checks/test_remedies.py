"""Laws of remedies: a line that the user is told to write is TOML, is read, and mends what it is for."""

import re
import tomllib
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from faults import spoil
from test_conventions import CHANGES

from ident.checks.inspection import inspect_sessions
from ident.checks.report import SPACED, WORDS, TelemetryReport
from ident.errors import LINE_TO_WRITE, RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Payload, Recording, Session
from ident.recordings.save import write_session
from ident.recordings.session_toml import KEYS, load_session_file
from ident.robot.arm import ArmModel
from ident.robot.rotations import rotation_about
from ident.show.console import PlainConsole, print_issues

# What a remedy's places may hold.
FILLED = {
    "line": 'order = {joint_1 = "joint 2", "joint 2" = "joint_1"}',
    "lines": 'order = {a = "b", b = "a"}` and `effort_order = {a = "a", b = "b"}',
    "place": "at the top of session.toml",
    "unit": 0.05,
}
ROWS = {key: row for key, row in WORDS.items() if isinstance(row, dict) and "remedy" in row}
# A key and what it is to be, outside of backquotes.
BARE = re.compile(rf"(?:\b(?:{'|'.join(KEYS)})\b|\[\w+\]) *[\w.]* = ")


class Filled(defaultdict[str, object]):
    """Any place of a remedy: a number where nothing else is known of it."""

    def __missing__(self, key: str) -> object:
        return FILLED.get(key, 1.5)


def remedy_of(row: dict[str, str]) -> str:
    return SPACED.vformat(row["remedy"], (), Filled())


@pytest.mark.parametrize("key", ROWS)
def test_what_is_to_be_written_can_be_read(key: str, tmp_path: Path) -> None:
    """Law: what a remedy gives to be written stands in backquotes, is TOML, and session.toml takes it."""
    remedy = remedy_of(ROWS[key])
    assert not BARE.search(LINE_TO_WRITE.sub("", remedy))
    for line in LINE_TO_WRITE.findall(remedy):
        assert set(tomllib.loads(line)) <= set(KEYS)
        (tmp_path / "session.toml").write_text(line)
        load_session_file(tmp_path / "session.toml")


def slowed(run: Recording) -> Recording:
    return run.replace(time=20.0 * run.time)


def gravity_turned(arm: ArmModel) -> ArmModel:
    return arm.with_gravity(rotation_about([1.0, 0.0, 0.0], 0.5 * np.pi) @ arm.model.gravity.linear)


def of_another_arm(arm: ArmModel, other: ArmModel) -> Callable[[Recording], Recording]:
    """A run under the torques of another arm."""

    def change(run: Recording) -> Recording:
        acceleration = np.gradient(run.velocity, run.time, axis=0)
        state = (run.position, run.velocity, acceleration)
        more = other.inverse_dynamics(*state) - arm.inverse_dynamics(*state)
        return run.replace(effort=run.effort + more)

    return change


def inspect_written(session: Session, arm: ArmModel, folder: Path, lines: str = "") -> TelemetryReport:
    """The check of a session that was written to files, with lines at the top of its session.toml."""
    if not folder.exists():
        write_session(session, folder)
    file = folder / "session.toml"
    text = file.read_text() if file.exists() else ""
    file.write_text(lines + text)
    return inspect_sessions([load_session(folder)], arm)[0]


SPOILT = {name: spoil_it for name, (spoil_it, _) in CHANGES.items() if name != "nothing"}


@pytest.mark.parametrize("change", [*SPOILT, "clock", "mount", "body", "N cm", "N mm"])
def test_what_is_written_mends_it(change: str, clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """Law: with the lines of its remedies at the top of session.toml, nothing is said of the session any more."""
    others = {
        "clock": slowed,
        "mount": of_another_arm(arm, gravity_turned(arm)),
        "N cm": lambda run: run.replace(effort=100.0 * run.effort),
        "N mm": lambda run: run.replace(effort=1000.0 * run.effort),
        "body": of_another_arm(arm, arm.with_payload(Payload(4.0, (0.02, 0.05, 0.1)))),
    }
    spoilt = spoil(clean, {**SPOILT, **others}[change])
    before = inspect_written(spoilt, arm, tmp_path / "session")
    told = [issue for issue in before.issues if issue.severity != "note"]
    lines = [line for issue in told for line in LINE_TO_WRITE.findall(issue.remedy)]
    assert lines
    after = inspect_written(spoilt, arm, tmp_path / "session", "".join(f"{line}\n" for line in lines))
    assert not [issue for issue in after.issues if issue.severity != "note"]


def test_on_a_narrow_terminal_a_line_stays_one(capsys: pytest.CaptureFixture[str]) -> None:
    """Law: however long a line of session.toml is, it is printed by itself and whole."""
    signs = ", ".join(f"joint_{number} = -1" for number in range(1, 9))
    remedy = f"write `effort_sign = {{{signs}}}` at the top of session.toml, or turn the sign round"
    issue = {"issue": "effort_sign_flipped", "severity": "fatal", "evidence": "seen", "remedy": remedy}
    print_issues(PlainConsole(width=40), [issue])
    printed = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert tomllib.loads(printed[2])["effort_sign"] == {f"joint_{number}": -1 for number in range(1, 9)}
    assert printed[3].startswith("at the top")


@pytest.mark.parametrize("text", ["order = {joint_1 = 'joint_2'}", "order = {joint_1 = 2}", "time_unit = -1"])
def test_an_order_that_is_none_is_refused(text: str, clean: Session, tmp_path: Path) -> None:
    write_session(clean, tmp_path / "session")
    (tmp_path / "session/session.toml").write_text(text)
    with pytest.raises(RecordingError):
        load_session(tmp_path / "session")
