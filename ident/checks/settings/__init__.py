"""Numbers that decide, of the checks: each with its unit, its meaning and where it comes from.

A file a subject.
"""

from ident.checks.settings.angles import ANGLES as ANGLES
from ident.checks.settings.arrangement import ARRANGEMENT as ARRANGEMENT
from ident.checks.settings.arrangement import BETWEEN_RUNS as BETWEEN_RUNS
from ident.checks.settings.channels import CHANNELS as CHANNELS
from ident.checks.settings.clock import CLOCK as CLOCK
from ident.checks.settings.clock import FILTER as FILTER
from ident.checks.settings.clock import LATENESS as LATENESS
from ident.checks.settings.effort import EFFORT_KIND as EFFORT_KIND
from ident.checks.settings.effort import USUAL_EFFORT as USUAL_EFFORT
from ident.checks.settings.effort import EffortSettings as EffortSettings
from ident.checks.settings.excitation import INFORMATION as INFORMATION
from ident.checks.settings.excitation import USUAL_EXCITATION as USUAL_EXCITATION
from ident.checks.settings.excitation import ExcitationSettings as ExcitationSettings
from ident.checks.settings.telemetry import USUAL_TELEMETRY as USUAL_TELEMETRY
from ident.checks.settings.telemetry import TelemetrySettings as TelemetrySettings
