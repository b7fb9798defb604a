"""Is a recording fit for use? Finds faults, mends what can be mended safely, and refuses what can't."""

from ident.checks.inspection import inspect, inspect_sessions
from ident.checks.report import TelemetryReport
from ident.checks.streaming import inspect_parts

__all__ = ["TelemetryReport", "inspect", "inspect_parts", "inspect_sessions"]
