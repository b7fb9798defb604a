"""xacro files: expanded by the package of the same name, which evaluates the expressions in them as Python.

Its own guards miss names within comprehensions, and leave Python's functions to `$(eval …)`; so every expression is
looked at here before. Files that a description includes are read where its package is, and nowhere else.
"""

from __future__ import annotations

import ast
import builtins
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ident.errors import RobotError

SUFFIX = ".xacro"
# Of Python's own functions those that reach nothing beyond their arguments.
HARMLESS = frozenset(
    ("abs", "all", "any", "bool", "dict", "divmod", "enumerate", "filter", "float", "int", "len", "list")
)
HARMLESS |= {"map", "max", "min", "range", "round", "set", "sorted", "str", "sum", "tuple", "zip"}
# Names that give the attributes of their arguments by their text.
BY_TEXT = ("format", "format_map")
# Larger powers than angles and lengths ever need take memory and time without end.
LARGEST_POWER = 16
# Kinds of files that descriptions are made of.
INCLUDED = (SUFFIX, ".urdf", ".xml", ".yaml", ".yml")
# What marks the folder of a package, and where installed ones lie.
PACKAGES = ("package.xml", ".git")
INSTALLED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")


class HarmfulExpression(Exception):
    """An expression or a file's name in a description that a description has no need of."""


def expand(path: Path) -> str:
    """The URDF text of a xacro file, its arguments at their defaults.

    Raises:
        RobotError: It can't be expanded: damaged, an argument without a default, a package that is not installed, an
            expression that reaches beyond figures, or a file from elsewhere.
    """
    try:
        with _careful(path) as xacro:
            return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # the XML parser, the expressions and the search for packages each raise their own
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise RobotError(
            path, f"can't be expanded ({reason})", f"expand it where its packages are: xacro {path.name} > arm.urdf"
        ) from None


@contextmanager
def _careful(path: Path) -> Iterator[Any]:
    """Lends xacro with its two places of evaluation, and its opening of files, under guard."""
    import xacro
    from xacro import substitution_args

    homes = _homes(path)
    braces, brackets = xacro.safe_eval, substitution_args._eval

    def in_braces(text: str, *scopes: Any) -> Any:
        require_harmless(text)
        return braces(text, *scopes)

    def in_brackets(text: str, context: Any) -> Any:
        require_harmless(text)
        return brackets(text, context)

    def open_beside(name: str) -> Any:
        place = Path(name).resolve()
        if place.suffix.lower() not in INCLUDED or not any(place.is_relative_to(home) for home in homes):
            raise HarmfulExpression(f"{name} is no part of the description: it lies outside of its package")
        return place.open(encoding="utf-8")

    xacro.safe_eval, substitution_args._eval, xacro.open = in_braces, in_brackets, open_beside
    try:
        yield xacro
    finally:
        xacro.safe_eval, substitution_args._eval = braces, brackets
        del xacro.open


def require_harmless(text: str) -> None:
    """Passes if an expression computes with figures and texts alone.

    Raises:
        HarmfulExpression: It names something private, or one of Python's functions that reach beyond their arguments.
        SyntaxError: It is no expression.
    """
    for node in ast.walk(ast.parse(text.strip(), mode="eval")):
        name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        reaches = isinstance(node, ast.Name) and hasattr(builtins, name) and name not in HARMLESS
        private = "__" if isinstance(node, ast.Name) else "_"
        if name.startswith(private) or name in BY_TEXT or reaches:
            raise HarmfulExpression(f"{name!r} has no place in a description's expression {text.strip()!r}")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            power = node.right.value if isinstance(node.right, ast.Constant) else None
            if not isinstance(power, int | float) or abs(power) > LARGEST_POWER:
                raise HarmfulExpression(f"a power of no small number in {text.strip()!r}")


def _homes(path: Path) -> list[Path]:
    """The folders whose files may be included: the package's, or those beside the file; installed packages'."""
    here = list(path.resolve().parents)
    own = next((folder for folder in here if any((folder / mark).exists() for mark in PACKAGES)), None)
    installed = [Path(one).resolve() for name in INSTALLED for one in os.environ.get(name, "").split(os.pathsep) if one]
    return [own or here[min(1, len(here) - 1)], here[0], *installed]
