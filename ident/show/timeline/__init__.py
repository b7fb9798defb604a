"""The Rerun timeline: measured torque against every rung, what is left, and the moving arm."""

from ident.lazy import lazily

TYPE_CHECKING = False
if TYPE_CHECKING:
    from ident.show.timeline.screen import require_screen as require_screen
    from ident.show.timeline.series import Curve as Curve
    from ident.show.timeline.series import Mark as Mark
    from ident.show.timeline.writing import show_timeline as show_timeline
    from ident.show.timeline.writing import write_timeline as write_timeline

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
