"""Measures the layout of the two packages: rooms, arrows, sizes, and what is annotated, documented and named twice.

    python tests/house.py [FOLDER …]      # the repository's folder, or others to compare with

A room is a package, or a module that stands alone, at the top of `ident` or `plan`; an arrow is one room's import of
another's, what stands under TYPE_CHECKING included.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from statistics import median, quantiles

PACKAGES = ("ident", "plan")
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Source:
    """A module: where it is, its text, and what it says."""

    path: Path
    text: str
    tree: ast.Module
    room: str

    @property
    def lines(self) -> int:
        return len(self.text.splitlines())

    def functions(self) -> Iterator[Function]:
        return (node for node in ast.walk(self.tree) if isinstance(node, Function))

    def public(self) -> Iterator[Function | ast.ClassDef]:
        """Classes and functions at the top, and methods, whose names don't begin with an underscore."""
        for node in self.tree.body:
            if isinstance(node, Function | ast.ClassDef) and not node.name.startswith("_"):
                yield node
                if isinstance(node, ast.ClassDef):
                    inside = (one for one in node.body if isinstance(one, Function))
                    yield from (one for one in inside if not one.name.startswith("_"))

    def imports(self) -> Iterator[str]:
        """Dotted names of ours that it imports."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module
            elif isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)


def read_sources(folder: Path) -> list[Source]:
    """All modules of both packages."""
    found = []
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            room = ".".join(parts[:2]) if parts[1:] != ("__init__",) else package
            text = path.read_text(encoding="utf-8")
            found.append(Source(path.relative_to(folder), text, ast.parse(text), room))
    return found


def arrows(sources: list[Source]) -> set[tuple[str, str]]:
    """Pairs of rooms of which the first imports the second; the doors of the packages, which offer all, left out."""
    rooms = {one.room for one in sources} - set(PACKAGES)
    found = set()
    for one in sources:
        for name in one.imports():
            target = ".".join(name.split(".")[:2])
            if one.room in rooms and target in rooms and target != one.room:
                found.add((one.room, target))
    return found


def depth(pairs: set[tuple[str, str]]) -> int:
    """Floors: rooms on the longest way down; 0 where the arrows run in a circle."""
    below: dict[str, set[str]] = {}
    for first, second in pairs:
        below.setdefault(first, set()).add(second)
        below.setdefault(second, set())
    floors: dict[str, int] = {}
    while len(floors) < len(below):
        ready = [room for room, under in below.items() if room not in floors and under <= floors.keys()]
        if not ready:
            return 0
        floors.update({room: 1 + max((floors[one] for one in below[room]), default=0) for room in ready})
    return max(floors.values(), default=0)


def length(function: Function) -> int:
    """Lines of a function's body without its docstring."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return 1 + (body[-1].end_lineno or 0) - body[0].lineno if body else 0


def is_annotated(function: Function) -> bool:
    """Whether the result and every argument but self have a type."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return function.returns is not None and all(one.annotation or one.arg in ("self", "cls") for one in named)


def names_twice(sources: list[Source]) -> dict[str, list[str]]:
    """Public classes whose name stands in more than one module."""
    places: dict[str, list[str]] = {}
    for one in sources:
        for node in one.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(one.path))
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}


def measure(folder: Path) -> dict[str, float | int | str]:
    """All figures of a working tree."""
    sources = read_sources(folder)
    files = [one for one in sources if one.path.name != "__init__.py"]
    lengths = [length(function) for one in sources for function in one.functions()]
    functions = list(chain.from_iterable(one.functions() for one in sources))
    public = list(chain.from_iterable(one.public() for one in sources))
    documented = sum(ast.get_docstring(one) is not None for one in public)
    flat = Counter(one.room for one in files)
    pairs = arrows(sources)
    biggest = max(files, key=lambda one: one.lines)
    return {
        "modules": len(files),
        **{
            f"modules at the top of {package}": sum(one.path.parent == Path(package) for one in files)
            for package in PACKAGES
        },
        "rooms": len(flat),
        "arrows between rooms": len(pairs),
        "floors": depth(pairs),
        "lines of the median file": round(median(one.lines for one in files)),
        "lines of the largest file": f"{biggest.lines} ({biggest.path})",
        "lines of the median function": round(median(lengths)),
        "lines of functions, 90 %": round(quantiles(lengths, n=10)[-1]),
        "functions annotated [%]": round(100 * sum(map(is_annotated, functions)) / len(functions), 1),
        "public names documented [%]": round(100 * documented / len(public), 1),
        "public class names that stand twice": len(names_twice(sources)),
    }


def main(folders: list[Path]) -> None:
    """Prints one column a folder, and the names that stand twice in the last."""
    columns = [measure(folder) for folder in folders]
    for name in columns[0]:
        print(f"{name:<38}" + "".join(f"{column[name]!s:>44}" for column in columns))
    for name, places in names_twice(read_sources(folders[-1])).items():
        print(f"  {name}: {', '.join(places)}")


if __name__ == "__main__":
    main([Path(one) for one in sys.argv[1:]] or [Path(__file__).parents[1]])
