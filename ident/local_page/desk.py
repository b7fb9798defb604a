"""What a person does with one log and one robot, step by step: give, check, correct, diagnose, take
the files.

Nothing here knows of a browser. The user's own files are read where they lie; what is corrected,
guessed and written stands in a folder of its own.
"""

from __future__ import annotations

import shutil
import threading
import tomllib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import tomli_w

from ident.api.diagnosing import examine
from ident.api.exporting import patch
from ident.api.inspecting import inspect
from ident.command_options import DiagnoseOptions
from ident.errors import LINE_TO_WRITE, InputError, first_line
from ident.infer.new_session import guess_session
from ident.progress import listening
from ident.recordings.session_toml import KEYS
from ident.recordings.session_toml import NAME as SESSION_FILE
from ident.safe_read import toml_line
from ident.sessions import load_robot
from ident.show.report.diagnosis_actions import WRITE_NUMBERS, first_action, second_action
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.laws import draw_laws
from ident.show.report.traces import gather_traces

RECORD = "why.json"
PAGE = "why.html"
PATCH = "patched"
ZIPPED = f"{PATCH}.zip"
# A sign that is there already is turned round.
SIGN = "effort_sign"


@dataclass
class Progress:
    """How far a diagnosis has come."""

    stage: str = ""
    share: float = 0.0
    running: bool = False
    error: str = ""
    result: dict[str, Any] | None = None


@dataclass
class Desk:
    """A log, a robot and what was made of them.

    Attributes:
        folder: Where everything is written; the user's own files are never changed.
        log: Folder or file of the recordings; None until it is given.
        robot: URDF path or name; None until it is given.
    """

    folder: Path
    log: Path | None = None
    robot: str | None = None
    progress: Progress = field(default_factory=Progress)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        theirs = (
            None
            if self.log is None
            else (self.log if self.log.is_dir() else self.log.parent) / SESSION_FILE
        )
        if theirs is not None and theirs.is_file():
            shutil.copyfile(theirs, self.session_file)

    @property
    def session_file(self) -> Path:
        """The session.toml that counts; it may not be there yet."""
        return self.folder / SESSION_FILE

    @property
    def files(self) -> list[str]:
        """Names of what can be taken away by now."""
        return [
            name for name in (SESSION_FILE, RECORD, PAGE, ZIPPED) if (self.folder / name).is_file()
        ]

    def take_log(self, name: str, content: bytes) -> None:
        """Takes a run, or a session.toml, that was dropped; all runs together are the session.

        Raises:
            InputError: It has no name of a file.
        """
        place = self.folder / "log"
        if self.log != place:
            shutil.rmtree(place, ignore_errors=True)
            self.session_file.unlink(missing_ok=True)
            self.log = place
        file = plain_name(name)
        target = self.session_file if file == SESSION_FILE else place / file
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)

    def take_robot(self, name: str, content: bytes) -> None:
        """Takes a URDF that was dropped.

        Raises:
            InputError: It is no arm.
        """
        place = self.folder / "robot"
        place.mkdir(exist_ok=True)
        (place / plain_name(name)).write_bytes(content)
        self.name_robot(str(place / plain_name(name)))

    def name_robot(self, name: str) -> None:
        """Takes a URDF's path, or a name.

        Raises:
            InputError: There is no such robot, or it is no arm.
        """
        load_robot(name, ())
        self.robot = name

    def forget_log(self) -> None:
        """Makes room for another log."""
        self.log = None

    def check(self) -> dict[str, Any]:
        """What is read of the log, what is wrong with it, and the lines that put it right.

        Raises:
            InputError: Log or robot are missing or can't be read at all.
        """
        log, robot = self._given()
        guesses: list[dict[str, str]] = []
        try:
            inspection = inspect(log, robot, **self._reading())
        except InputError:
            if self.session_file.exists():
                raise
            guess = guess_session(log, load_robot(robot, ()), None)
            self.session_file.write_text(guess.text, encoding="utf-8")
            guesses = [reason.to_dict() for reason in guess.reasons]
            inspection = inspect(log, robot, **self._reading())
        issues = []
        for report in inspection.reports:
            for issue in report.issues:
                record = issue.to_dict()
                issues.append({**record, "lines": lines_of(record, self._text())})
        runs = [run for report in inspection.reports for run in report.session.runs]
        return {
            "fit": all(report.is_fit for report in inspection.reports),
            "verdict": "; ".join(report.verdict for report in inspection.reports),
            "issues": issues,
            "guesses": guesses,
            "runs": [{"name": run.name, "samples": len(run.time)} for run in runs],
            "joints": list(runs[0].joints) if runs else [],
            "channels": sorted(runs[0].channels()) if runs else [],
            "session_toml": self._text(),
        }

    def write_line(self, line: str) -> None:
        """Puts a line into the session.toml, in place of an earlier one of the same key.

        Raises:
            InputError: It is no TOML, or none of its keys.
        """
        try:
            wanted = tomllib.loads(line)
            record = tomllib.loads(self._text())
        except tomllib.TOMLDecodeError as error:
            raise InputError(
                SESSION_FILE, f"not TOML ({first_line(error)})", "write KEY = VALUE"
            ) from None
        for key, value in wanted.items():
            if key not in KEYS:
                known = ", ".join(KEYS)
                raise InputError(f"{SESSION_FILE}, {key}", "no such key", f"use: {known}")
            if isinstance(value, Mapping):
                record[key] = {**record.get(key, {}), **value}
            else:
                record[key] = value
        self.session_file.write_text(tomli_w.dumps(record), encoding="utf-8")

    def replace_text(self, text: str) -> None:
        """Takes the whole session.toml as it was edited.

        Raises:
            InputError: It is no TOML.
        """
        try:
            tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(
                SESSION_FILE, f"not TOML ({first_line(error)})", "correct it"
            ) from None
        self.session_file.write_text(text, encoding="utf-8")

    def diagnose(self) -> None:
        """Diagnoses, and writes record, page and patch; `progress` tells how far it has come, and
        of a failure.
        """
        with self._lock:
            self.progress = Progress(running=True)
            try:
                with listening(self._listen):
                    self.progress.result = self._diagnose()
            except InputError as error:
                self.progress.error = str(error)
            finally:
                self.progress.running = False

    def _listen(self, stage: str, share: float, _: float | None) -> None:
        self.progress.stage = stage
        self.progress.share = share

    def _diagnose(self) -> dict[str, Any]:
        log, robot = self._given()
        done = examine(log, robot, DiagnoseOptions(**self._reading()))
        record = done.diagnosis.to_dict()
        done.diagnosis.save(self.folder / RECORD)
        pictures = () if done.analysis is None else draw_laws(done.analysis)
        traces = None if done.analysis is None else gather_traces(done.analysis)
        write_diagnosis_report(self.folder / PAGE, record, None, pictures, traces)
        told = self._patch(robot)
        first = first_action(record)
        if first == WRITE_NUMBERS and not told:
            first = (
                "Take the corrected model below; your own file takes these numbers by "
                "`ident patch … --into`."
            )
        return {
            "verdict": record["verdict"],
            "headline": diagnosis_headline(record),
            "first": f"{first} {second_action(record)}".strip(),
            "told": told,
            "files": self.files,
        }

    def _patch(self, robot: str) -> str:
        """Writes the patch and packs it; why there is none, or an empty text."""
        (self.folder / ZIPPED).unlink(missing_ok=True)
        try:
            patch(self.folder / RECORD, robot, self.folder / PATCH)
        except InputError as error:
            return str(error)
        except ImportError as error:
            return f"no patched model: {error.name} is not installed"
        with zipfile.ZipFile(self.folder / ZIPPED, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in sorted((self.folder / PATCH).iterdir()):
                if not file.name.startswith("."):
                    packed.write(file, file.name)
        return ""

    def _given(self) -> tuple[Path, str]:
        if self.log is None:
            raise InputError("log", "none is given", "drop one, or choose a file")
        if self.robot is None:
            raise InputError("robot", "none is given", "drop a URDF, or give a name such as panda")
        return self.log, self.robot

    def _reading(self) -> dict[str, Any]:
        return {"session_file": self.session_file} if self.session_file.exists() else {}

    def _text(self) -> str:
        return self.session_file.read_text(encoding="utf-8") if self.session_file.exists() else ""


def plain_name(name: str) -> str:
    """The last part of a name that a browser gave.

    Raises:
        InputError: Nothing is left of it, or it is hidden.
    """
    last = PurePosixPath(name.replace("\\", "/")).name
    if not last or last.startswith(".") or "\x00" in last:
        raise InputError("file", f"{name!r} is no name of a file", "give another one")
    return last


def lines_of(issue: Mapping[str, Any], text: str = "") -> list[str]:
    """Lines of session.toml that a telemetry issue's remedy asks for, to be put in by a click.

    Args:
        issue: The issue's record.
        text: The session.toml as it is: a sign that is there already is turned round.
    """
    signs = tomllib.loads(text).get(SIGN, {})
    lines = []
    for line in LINE_TO_WRITE.findall(issue["remedy"]):
        ((key, value),) = tomllib.loads(line).items()
        if key == SIGN:
            value = {joint: -signs.get(joint, 1) for joint in value}
        lines.append(toml_line(key, value))
    return lines
