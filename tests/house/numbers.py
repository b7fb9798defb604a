"""Numbers that decide: settings, in tables and in fields, and constants of modules."""

import ast
import tomllib
from pathlib import Path

from tests.house.sources import PACKAGES, Source

# Numbers of arithmetic and of counting.
PLAIN = (0, 1, 2, 3, 0.5)


def is_number(value: ast.AST) -> bool:
    """Whether an expression is made of numerals alone."""
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left) and is_number(value.right)
    if not isinstance(value, ast.Constant) or isinstance(value.value, bool):
        return False
    return isinstance(value.value, int | float)


def number_constants(source: Source) -> int:
    """Constants of the module that are numbers."""
    return sum(is_number(value) for _, value in source.constants())


def bare_numbers(source: Source) -> int:
    """Numbers that functions hold without a name; counts, halves and signs need none.

    With `number_constants` they are all numbers of the code: to name one changes nothing.
    """
    inside = {
        node
        for function in source.functions()
        for statement in function.body
        for node in ast.walk(statement)
    }
    numerals = [node for node in inside if isinstance(node, ast.Constant) and is_number(node)]
    return sum(node.value not in PLAIN for node in numerals)


def written_settings(source: Source) -> int:
    """Settings that a field gives in Python: `number(value, unit, meaning, source)`."""
    calls = (node for node in source.nodes if isinstance(node, ast.Call))
    named = (call for call in calls if isinstance(call.func, ast.Name))
    return sum(call.func.id == "number" and bool(call.args or call.keywords) for call in named)


def count_rows(table: dict[str, object]) -> int:
    """Rows with a value, in a table of settings and in those below it."""
    if "value" in table:
        return 1
    return sum(count_rows(entry) for entry in table.values() if isinstance(entry, dict))


def settings_rows(folder: Path) -> int:
    """Rows of all files of settings."""
    rows = 0
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("settings.toml")):
            rows += count_rows(tomllib.loads(path.read_text(encoding="utf-8")))
    return rows
