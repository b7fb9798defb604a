"""What the class of an effect asks for, and where effects are named."""

import ast
import tomllib
from pathlib import Path

from tests.house.sources import Function, Source

# Where effects may be named: the laws, and the simulated arm that has laws of its own.
EFFECT_HOMES = ("ident/effects", "ident/laws", "ident/simulation")
EFFECT_BASE = Path("ident/effects/base.py")
EFFECT_ROWS = Path("ident/effects/effects.toml")


def effect_body(sources: list[Source]) -> list[ast.stmt]:
    """Statements of the class `Effect`."""
    for source in sources:
        if source.path == EFFECT_BASE:
            for node in source.tree.body:
                if isinstance(node, ast.ClassDef) and node.name == "Effect":
                    return node.body
    raise LookupError(
        f"no class Effect in {EFFECT_BASE}: say in tests/house/effects.py where it is now"
    )


def count_members(sources: list[Source]) -> tuple[int, int]:
    """Attributes and methods that the class `Effect` states itself; its record is none of them."""
    body = effect_body(sources)
    attributes = sum(isinstance(line, ast.AnnAssign | ast.Assign) for line in body)
    methods = sum(isinstance(line, Function) for line in body)
    return attributes, methods


def effect_ids(folder: Path) -> set[str]:
    """Ids of the effects, as their rows give them."""
    return set(tomllib.loads((folder / EFFECT_ROWS).read_text(encoding="utf-8"))["effects"])


def effect_classes(sources: list[Source]) -> set[str]:
    """Names of the effects' classes; those that others derive from are none."""
    parents: dict[str, set[str]] = {}
    for source in sources:
        for node in source.nodes:
            if isinstance(node, ast.ClassDef):
                bases = {base.id for base in node.bases if isinstance(base, ast.Name)}
                parents.setdefault(node.name, set()).update(bases)
    family = {"Effect"}
    grown = True
    while grown:
        heirs = {name for name, bases in parents.items() if bases & family}
        grown = not heirs <= family
        family |= heirs
    inherited = set().union(*parents.values())
    return family - inherited


def is_effect_home(source: Source) -> bool:
    """Whether effects may be named in the module."""
    return any(source.path.is_relative_to(home) for home in EFFECT_HOMES)


def quoted_ids(source: Source, ids: set[str]) -> int:
    """How often a literal of the module is the id of an effect."""
    literals = (node.value for node in source.nodes if isinstance(node, ast.Constant))
    return sum(value in ids for value in literals if isinstance(value, str))


def named_classes(source: Source, classes: set[str]) -> int:
    """How often the module names one of the classes, imports included."""
    count = 0
    for node in source.nodes:
        if isinstance(node, ast.Name):
            count += node.id in classes
        elif isinstance(node, ast.Attribute):
            count += node.attr in classes
        elif isinstance(node, ast.ImportFrom):
            count += sum(alias.name in classes for alias in node.names)
    return count
