"""The modules of both packages, read once."""

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("ident", "plan")
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Source:
    """A module: where it is, its text, and what it says."""

    path: Path
    text: str
    tree: ast.Module
    room: str

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All that it says, walked once."""
        return list(ast.walk(self.tree))

    def functions(self) -> Iterator[Function]:
        return (node for node in self.nodes if isinstance(node, Function))

    def imports(self) -> Iterator[str]:
        """Dotted names that it imports."""
        for node in self.nodes:
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module
            elif isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)

    def constants(self) -> Iterator[tuple[ast.stmt, ast.expr]]:
        """Assignments of the module's constants, and what each is given; several in one statement
        are several.
        """
        for statement in self.tree.body:
            for target, value in assigned(statement):
                if isinstance(target, ast.Name) and CONSTANT.fullmatch(target.id):
                    yield statement, value


def assigned(statement: ast.stmt) -> list[tuple[ast.expr, ast.expr]]:
    """What a statement assigns to, and what it gives; side by side where it gives several."""
    if isinstance(statement, ast.AnnAssign):
        return [] if statement.value is None else [(statement.target, statement.value)]
    if not isinstance(statement, ast.Assign):
        return []
    target = statement.targets[0]
    value = statement.value
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        return list(zip(target.elts, value.elts, strict=False))
    return [(target, value)]


@cache
def read_sources(folder: Path) -> list[Source]:
    """All modules of both packages."""
    sources = []
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            room = ".".join(parts[:2]) if parts[1:] != ("__init__",) else package
            text = path.read_text(encoding="utf-8")
            sources.append(Source(path.relative_to(folder), text, ast.parse(text), room))
    return sources


def total(count: Callable[[Source], int], sources: list[Source]) -> int:
    """A count over all modules."""
    return sum(map(count, sources))
