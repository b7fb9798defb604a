"""The folder in which a training may stop and go on."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ident.files import clear_temporaries
from ident.outputs import MARKER, is_begun

NAME = "checkpoint.safetensors"
# What a checkpoint's folder is marked as.
KIND = "training"


def remove_checkpoint(folder: Path) -> None:
    """A finished training needs its checkpoint no more, nor what killed ones left beside it."""
    if not is_begun(folder, KIND):
        return
    clear_temporaries(folder / NAME)
    for name in (NAME, MARKER):
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):  # something else lies in it: that stays
        folder.rmdir()
