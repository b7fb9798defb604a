"""The folder of what can be made anew."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def user_cache() -> Path | None:
    """The folder of what can be made anew; None where others may write: what lies there is run, or
    believed.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # A container's user may have no home.
    folder = Path(home if os.path.isabs(home) else tempfile.gettempdir()) / "armgap"
    try:
        if not os.path.lexists(folder):
            folder.mkdir(mode=0o700, parents=True)
        state = folder.lstat()
    except OSError:
        return None
    private = (
        stat.S_ISDIR(state.st_mode) and state.st_uid == os.geteuid() and not state.st_mode & 0o022
    )
    return folder if private else None
