"""What an expression in a xacro file may do: compute with figures and texts, in little time and memory.

The package that expands xacro files evaluates their expressions as Python. Its own guards miss names within
comprehensions, leave Python's functions to `$(eval …)`, and bound neither time nor memory.
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable, Mapping
from typing import Any

# Of Python's own functions those that reach nothing beyond their arguments.
HARMLESS = frozenset(
    ("abs", "all", "any", "bool", "dict", "divmod", "enumerate", "filter", "float", "int", "len", "list")
)
HARMLESS |= {"map", "max", "min", "range", "round", "set", "sorted", "str", "sum", "tuple", "zip"}
# Methods that give the attributes of their arguments by their text, and those that fill up to any length.
BY_TEXT = frozenset(("format", "format_map"))
FILLING = frozenset(("ljust", "rjust", "center", "zfill", "expandtabs", "to_bytes"))
# Larger powers than angles and lengths ever need take memory and time without end.
LARGEST_POWER = 16
# Numbers of more bits, and texts and lists of more parts, are in no description.
MOST_BITS, MOST_PARTS = 1024, 20_000
# Loops within one expression: each may run over `MOST_PARTS`.
MOST_LOOPS = 1


class HarmfulExpression(Exception):
    """An expression or a file's name in a description that a description has no need of."""


def make_harmless(text: str) -> str:
    """The same expression, its multiplications, powers and remainders by functions that look at sizes first.

    Raises:
        HarmfulExpression: It names something private, or one of Python's functions that reach beyond their arguments;
            or it could take any time.
        SyntaxError: It is no expression.
    """
    told = repr(text.strip()[:80])
    tree = ast.parse(text.strip(), mode="eval")
    loops = 0
    for node in ast.walk(tree):
        name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        reaches = isinstance(node, ast.Name) and hasattr(builtins, name) and name not in HARMLESS
        private = "__" if isinstance(node, ast.Name) else "_"
        if name.startswith(private) or name in BY_TEXT | FILLING or reaches:
            raise HarmfulExpression(f"{name!r} has no place in a description's expression {told}")
        loops += isinstance(node, ast.comprehension)
        if isinstance(node, ast.Lambda | ast.LShift | ast.NamedExpr) or loops > MOST_LOOPS:
            raise HarmfulExpression(f"{told} could take any time")
        if isinstance(node, ast.FormattedValue) and node.format_spec is not None:
            raise HarmfulExpression(f"a format in {told}: use round()")
    return ast.unparse(_Bounded().visit(tree))


class _Bounded(ast.NodeTransformer):
    """Puts the functions below in the place of operators."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        name = OPERATORS.get(type(node.op))
        if name is None:
            return node
        return ast.Call(ast.Name(name, ast.Load()), [node.left, node.right], [])


def bounded_times(a: Any, b: Any) -> Any:
    """a * b."""
    if isinstance(a, int) and isinstance(b, int):
        if a.bit_length() + b.bit_length() > MOST_BITS:
            raise HarmfulExpression("a product of too many digits")
    elif _parts(a) * _parts(b) > MOST_PARTS:
        raise HarmfulExpression("a text or list of too many parts")
    return a * b


def _parts(value: Any) -> int:
    """Length of a text or list, or how many times one is repeated."""
    return int(value) if isinstance(value, int) else len(value) if hasattr(value, "__len__") else 1


def bounded_power(a: Any, b: Any) -> Any:
    """a ** b."""
    if not isinstance(b, int | float) or abs(b) > LARGEST_POWER:
        raise HarmfulExpression(f"a power that is no number up to {LARGEST_POWER}")
    if isinstance(a, int) and a.bit_length() * abs(b) > MOST_BITS:
        raise HarmfulExpression("a power of too many digits")
    return a**b


def bounded_remainder(a: Any, b: Any) -> Any:
    """a % b of numbers."""
    if not isinstance(a, int | float):
        raise HarmfulExpression("% of a text: use str() and +")
    return a % b


def bounded_range(*bounds: int) -> range:
    """A range of not too many parts."""
    found = range(*bounds)
    if found and abs(found[-1] - found[0]) // abs(found.step) >= MOST_PARTS:
        raise HarmfulExpression("a range of too many parts")
    return found


def require_small(value: Any) -> Any:
    """Passes a value on if it has not too many parts all in all; what holds itself has no end of them."""
    left, count = [value], 0
    while left:
        one = left.pop()
        count += len(one) if isinstance(one, str | bytes) else 1
        if count > MOST_PARTS:
            raise HarmfulExpression("an expression grows beyond any description")
        if isinstance(one, int) and one.bit_length() > MOST_BITS:
            raise HarmfulExpression("a number of too many digits")
        if isinstance(one, Mapping):
            left += [*one.keys(), *one.values()]
        elif isinstance(one, list | tuple | set | frozenset):
            left += list(one)[:MOST_PARTS]
    return value


OPERATORS: dict[type[ast.operator], str] = {
    ast.Mult: "bounded_times",
    ast.Pow: "bounded_power",
    ast.Mod: "bounded_remainder",
}
# What expressions find by these names.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "bounded_times": bounded_times,
    "bounded_power": bounded_power,
    "bounded_remainder": bounded_remainder,
    "range": bounded_range,
}
