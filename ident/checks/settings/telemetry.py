"""What recordings are refused by: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.checks.settings.effort import USUAL_EFFORT, EffortSettings
from ident.checks.settings.excitation import USUAL_EXCITATION, ExcitationSettings
from ident.records import Numbers


@dataclass(frozen=True)
class TelemetrySettings(Numbers):
    """What recordings are refused by."""

    effort: EffortSettings = USUAL_EFFORT  # sign, scale and origin of the torque
    excitation: ExcitationSettings = USUAL_EXCITATION  # whether there is motion enough


USUAL_TELEMETRY = TelemetrySettings()
