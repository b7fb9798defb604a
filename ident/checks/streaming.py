"""The telemetry check of sessions too long to be held: part by part, each let go before the next is read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

from threadpoolctl import threadpool_limits

from ident.checks.excitation import STATES, Amount
from ident.checks.inspection import inspect_alone
from ident.checks.repeated import Repeats
from ident.checks.report import TelemetryReport, as_mounted
from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel


def inspect_parts(
    parts: Iterable[Session], arm: ArmModel, settings: TelemetrySettings = USUAL_TELEMETRY
) -> Iterator[TelemetryReport]:
    """Reports of consecutive parts of sessions that are to be used together, each made when its turn comes.

    A part is checked and mended by itself. What an earlier part of its session showed is not told again, unless it is
    fatal. Whether there is enough motion, and every run but once, is asked of all parts at once: if not, a last report
    without runs says so.

    Raises:
        RecordingError: No joint of the robot is recorded, or a part has other joints than the first.
    """
    check = _Check(arm, settings)
    # A map holds on to nothing that it has handed out.
    return chain(map(check.inspect, parts), check.close())


class _Check:
    """What the parts so far have shown."""

    def __init__(self, arm: ArmModel, settings: TelemetrySettings) -> None:
        self._arm, self._settings = arm, settings
        self._amount, self._repeats = Amount(STATES, settings.excitation), Repeats()
        self._told: set[tuple[str, str, tuple[str, ...], str]] = set()
        self._last: TelemetryReport | None = None

    def inspect(self, part: Session) -> TelemetryReport:
        """The report of one more part."""
        # The checks' matrices are small: threads of the linear algebra only get into each other's way.
        with threadpool_limits(limits=1, user_api="blas"):
            self._repeats.take(part)
            report = inspect_alone(part, self._arm, self._settings)
            self._arm = as_mounted(self._arm, report.session)  # later parts are held against the same arm
            self._amount.take(report.session, report.arm)
        self._last = TelemetryReport(report.session.replace(runs=()), (), report.arm)
        where = str(part.path or part.name)
        return replace(report, issues=tuple(issue for issue in report.issues if self._is_news(where, issue)))

    def close(self) -> Iterator[TelemetryReport]:
        """What all parts lack together, or hold twice, once the last of them has come."""
        issues = [*self._amount.issues(), *self._repeats.issues()]
        if issues and self._last is not None:
            yield replace(self._last, issues=tuple(issues))

    def _is_news(self, where: str, issue: TelemetryIssue) -> bool:
        key = (where, issue.issue, issue.joints, issue.severity)
        known = key in self._told
        self._told.add(key)
        return not known or issue.severity == "fatal"
