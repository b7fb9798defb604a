"""Whether there is a screen to show a timeline on; asked before recordings are read."""

from __future__ import annotations

import os
import sys

from ident.errors import InputError


def require_screen() -> None:
    """Looks for a display server where windows need one.

    Raises:
        InputError: Linux, and neither X11's nor Wayland's display is named in the environment.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("viewer", "there is no screen here", "save the timeline with --rrd FILE, open it elsewhere")
