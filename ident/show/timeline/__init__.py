"""The Rerun timeline: measured torque against every rung, what is left, and the moving arm."""

from ident.show.timeline.marks import Mark
from ident.show.timeline.series import Curve
from ident.show.timeline.writing import show_timeline, write_timeline

__all__ = ["Curve", "Mark", "show_timeline", "write_timeline"]
