"""What the telemetry check found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ident.recordings.recording import TelemetryIssue
from ident.show.report.page import Section

ORDER = {"fatal": 0, "warning": 1, "note": 2}


@dataclass(frozen=True, eq=False)
class TelemetrySection(Section):
    """A table of issues, the worst first."""

    issues: Sequence[TelemetryIssue]
    anchor: ClassVar[str] = "telemetry"
    title: ClassVar[str] = "Telemetry"
    template: ClassVar[str] = "telemetry.html"

    def context(self) -> dict[str, Any]:
        return {"issues": sorted(self.issues, key=lambda issue: ORDER[issue.severity])}
