"""Which code made a result: the commit of a checkout, and the versions of the engines behind it."""

from __future__ import annotations

import importlib.metadata
import re
from functools import cache
from pathlib import Path

# Distributions whose numbers stand in results: linear algebra, dynamics, solvers, collisions,
# simulation, nets, tables.
ENGINES: tuple[str, ...] = ("numpy", "scipy", "numba", "pin", "clarabel", "pyarrow", "scikit-learn")
ENGINES += ("casadi", "coal", "cma", "daqp", "mujoco", "torch")
HASH = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")
# Where git writes down what a checkout stands at, and how deep names may point at names.
POINTER = "gitdir: "
REFERENCE = "ref: "
MOST_STEPS = 5
# Of all figures in results, unless a key's ending says otherwise (`_deg`, `_minutes`).
UNITS = "SI: rad or m, rad/s or m/s, N m or N, kg, kg m², s"


@cache
def engine_versions() -> dict[str, str]:
    """Version of each engine that is installed, by its name; the others have no entry."""
    versions = {}
    for name in ENGINES:
        for distribution in importlib.metadata.distributions(name=name):
            versions[name] = distribution.version
            break
    return versions


@cache
def code_commit(package: Path = Path(__file__).parent) -> str | None:
    """Commit that the package's checkout stands at; None where it is no checkout, as in a wheel.

    Git's files are read as they lie there: no program is started.
    """
    root = package.parent
    if not (root / "pyproject.toml").is_file():
        return None
    try:
        return _read_commit(_git_folder(root / ".git"))
    except OSError:
        return None


def _git_folder(place: Path) -> Path:
    """The folder of a checkout; of a further worktree its `.git` is a file that points at it."""
    if place.is_dir():
        return place
    return place.parent / place.read_text(encoding="utf-8").strip().removeprefix(POINTER)


def _read_commit(folder: Path) -> str | None:
    shared = folder
    if (folder / "commondir").is_file():
        shared = folder / (folder / "commondir").read_text(encoding="utf-8").strip()
    text = (folder / "HEAD").read_text(encoding="utf-8").strip()
    for _ in range(MOST_STEPS):
        if HASH.fullmatch(text):
            return text
        if not text.startswith(REFERENCE):
            return None
        name = text.removeprefix(REFERENCE)
        if (shared / name).is_file():
            text = (shared / name).read_text(encoding="utf-8").strip()
        else:
            text = _packed(shared, name)
    return None


def _packed(folder: Path, name: str) -> str:
    """The same of a name that git has packed away with others."""
    for line in (folder / "packed-refs").read_text(encoding="utf-8").splitlines():
        commit, _, known = line.partition(" ")
        if known == name:
            return commit
    return ""
