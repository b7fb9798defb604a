"""Writes the reference of all public names, made from their docstrings: `make api`.

python tests/examples/write_api.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import pdoc

import ident
import plan

# Where a how-to leads beyond the names of the two packages.
FURTHER = (
    "ident.effects.base",
    "ident.effects.knowledge",
    "ident.effects.typical_sizes",
    "ident.diagnosis.settings",
    "ident.recordings.load",
    "plan.planners.base",
)


def write_api(folder: Path) -> None:
    """One page a package and module."""
    for package in (ident, plan):
        for name in package.__all__:  # loaded when first asked for, by which pdoc can't find them
            setattr(package, name, getattr(package, name))
    pdoc.render.configure(docformat="google")
    pdoc.pdoc("ident", "plan", *FURTHER, output_directory=folder)


if __name__ == "__main__":
    write_api(Path(sys.argv[1]))
