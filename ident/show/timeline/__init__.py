"""The Rerun timeline: measured torque against every rung, what is left, and the moving arm."""

from typing import TYPE_CHECKING

from ident.lazy import lazily

if TYPE_CHECKING:
    from ident.show.timeline.screen import require_screen as require_screen
    from ident.show.timeline.series import Curve as Curve
    from ident.show.timeline.series import Mark as Mark
    from ident.show.timeline.writing import show_timeline as show_timeline
    from ident.show.timeline.writing import write_timeline as write_timeline

_HOMES = {
    "Curve": "ident.show.timeline.series",
    "Mark": "ident.show.timeline.series",
    "require_screen": "ident.show.timeline.screen",
    "show_timeline": "ident.show.timeline.writing",
    "write_timeline": "ident.show.timeline.writing",
}
__getattr__, __dir__ = lazily(__name__, _HOMES)
