"""Is a recording fit for use? Finds faults, mends what can be mended safely, and refuses what can't."""

from ident.checks.inspection import inspect_parts, inspect_sessions
from ident.checks.report import TelemetryReport

__all__ = ["TelemetryReport", "inspect_parts", "inspect_sessions"]
