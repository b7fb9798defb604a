"""xacro files: expanded by the package of the same name, which evaluates the expressions in them as Python.

So every expression is looked at here before; files that a description includes are read where its package is, and
nowhere else; and what would take for ever is stopped.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ident.errors import RobotError
from ident.robot.xacro_expressions import FUNCTIONS, HarmfulExpression, make_harmless, require_small

SUFFIX = ".xacro"
# Processor time in which the largest descriptions are expanded many times over [s].
LONGEST_S = 5.0
# Kinds of files that descriptions are made of.
INCLUDED = (SUFFIX, ".urdf", ".xml", ".yaml", ".yml")
# What marks the folder of a package, and where installed ones lie.
PACKAGES = ("package.xml", ".git")
INSTALLED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")


def expand(path: Path) -> str:
    """The URDF text of a xacro file, its arguments at their defaults.

    Raises:
        RobotError: It can't be expanded: damaged, an argument without a default, a package that is not installed, an
            expression that reaches beyond figures or takes too long, or a file from elsewhere.
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
    """Lends xacro with its places of evaluation, its macros, and its opening of files, under guard."""
    import xacro
    from xacro import substitution_args

    homes, end = _homes(path), time.thread_time() + LONGEST_S
    braces, brackets, walk = xacro.safe_eval, substitution_args._eval, xacro.eval_all

    def look_at_clock() -> None:
        if time.thread_time() > end:
            raise HarmfulExpression("it takes too long")

    def in_braces(text: str, *scopes: Any) -> Any:
        look_at_clock()
        return require_small(braces(make_harmless(text), *scopes))

    def in_brackets(text: str, context: Any) -> Any:
        look_at_clock()
        return require_small(brackets(make_harmless(text), context))

    def in_macros(*given: Any) -> Any:
        look_at_clock()
        return walk(*given)

    def open_beside(name: str) -> Any:
        place = Path(name).resolve()
        if place.suffix.lower() not in INCLUDED or not any(place.is_relative_to(home) for home in homes):
            raise HarmfulExpression(f"{name} is no part of the description: it lies outside of its package")
        return place.open(encoding="utf-8")

    lent: list[tuple[dict[str, Any], Mapping[str, Any]]] = [
        (vars(xacro), {"safe_eval": in_braces, "eval_all": in_macros, "open": open_beside}),
        (vars(substitution_args), {"_eval": in_brackets}),
        (xacro._global_symbols, FUNCTIONS),
        (xacro._global_symbols["python"], {"range": FUNCTIONS["range"]}),
        (substitution_args._eval_dict, FUNCTIONS),
    ]
    before = [{name: names[name] for name in new if name in names} for names, new in lent]
    try:
        for names, new in lent:
            names.update(new)
        yield xacro
    finally:
        for (names, new), old in zip(lent, before, strict=True):
            for name in new:
                del names[name]
            names.update(old)


def _homes(path: Path) -> list[Path]:
    """The folders whose files may be included: the package's, or those beside the file; installed packages'."""
    here = list(path.resolve().parents)
    own = next((folder for folder in here if any((folder / mark).exists() for mark in PACKAGES)), None)
    installed = [Path(one).resolve() for name in INSTALLED for one in os.environ.get(name, "").split(os.pathsep) if one]
    return [own or here[min(1, len(here) - 1)], here[0], *installed]
