"""Short hash of the code that a step rests on: says whether a result of an earlier try may be used again.

What counts is not listed by hand but read from the source: the step's module and every module of ours that it imports,
directly or through others, at its top or inside its functions.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]


@cache
def stamp_of(module: str) -> str:
    """Stamp of a module, `ident.blind_check.examining` say, and of all of `ident` that it imports."""
    digest = hashlib.sha256()
    for path in sorted(reached_from(module)):
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def reached_from(module: str) -> set[Path]:
    """Source files of `ident` that importing a module can run; packages on the way to a module are among them."""
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        parts = waiting.pop().split(".")
        for length in range(1, len(parts) + 1):
            path = _source(parts[:length])
            if path is not None and path not in found:
                found.add(path)
                # The door of the whole package offers everything and imports nothing until asked.
                if path != ROOT / "__init__.py":
                    waiting.extend(_imported(path))
    return found


def _source(parts: list[str]) -> Path | None:
    """File of a module or package of ours; None for what is a name inside a module."""
    place = ROOT.joinpath(*parts[1:])
    for path in (place / "__init__.py", place.with_suffix(".py")):
        if path.is_file():
            return path
    return None


def _imported(path: Path) -> Iterator[str]:
    """Dotted names under `ident` that a file's import statements mention; a name may be a module or what is in it."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == "ident")
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "ident":
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
