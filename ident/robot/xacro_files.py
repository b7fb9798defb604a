"""xacro files: the package of the same name walks through macros, conditions and includes; what it
would evaluate or open is worked out here.

Expressions go to our own evaluator (`ident.robot.xacro_expressions`). Files are read where the
description's package is and nowhere else. What would take for ever is stopped.
"""

from __future__ import annotations

import importlib.util
import os
import re
import threading
import time
import xml.dom.minidom
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from ident.errors import InputError, RobotError
from ident.outputs import real_path
from ident.robot.safe_xml import read_xml, require_no_entities
from ident.robot.xacro_expressions import HarmfulExpression, Lookup, evaluate, require_plain
from ident.safe_read import DEEPEST, read_text

# Processor time in which the largest descriptions are expanded many times over [s].
LONGEST_S = 5.0
# Size of all files of a description together, and of one of numbers; real ones have a tenth of it
# [bytes].
LARGEST = 1 << 22
LARGEST_YAML = 1 << 17
# Kinds of files that descriptions are made of.
INCLUDED = (".xacro", ".urdf", ".xml", ".yaml", ".yml")
# Where packages are installed, and where below it.
INSTALLED = {"AMENT_PREFIX_PATH": "share", "ROS_PACKAGE_PATH": ""}
# Folders that lie beside the others of a package (`urdf/` beside `config/`) where no package.xml
# marks it.
BESIDE = ("urdf", "xacro", "robots")
# The parameters of a macro, as the package reads them, in time that grows with their length.
PARAMETER = re.compile(
    r"^\s*+([^\s:=]++)\s*+:?=\s*+(\^\|?)?"
    r"""(\$\{.*?\}|\$\(.*?\)|(?:'[^']*+'|"[^"]*+"|[^\s'"]++)++|)(?:\s+|$)(.*)"""
)
# Lengths and angles of YAML files with their unit.
UNITS = {"radians": 1.0, "degrees": 0.017453292519943295, "meters": 1.0, "millimeters": 1e-3}
UNITS |= {"foot": 0.3048, "inches": 0.0254}
# What the package calls again and again, and by which a description grows.
WALKED = ("eval_all", "eval_text", "parse_macro_arg")
NO_NAMES: Lookup = dict[str, Any]().__getitem__
_ONE_AT_A_TIME = threading.Lock()


def expand(path: Path) -> str:
    """The URDF text of a xacro file, its arguments at their defaults.

    Raises:
        RobotError: It can't be expanded: damaged, an argument without a default, a package that is
            not installed, an expression that reaches beyond numbers and texts or takes too long, or
            a file from elsewhere.
    """
    try:
        with _ONE_AT_A_TIME:
            return str(_Expansion(path).text())
    except ImportError:
        raise  # of an extra: reported where all of them are
    # the XML parser, the expressions and the package each raise their own
    except Exception as error:
        reason = (
            f"{error.where}: {error.what}" if isinstance(error, InputError) else str(error).strip()
        )
        reason = (reason.splitlines() or [type(error).__name__])[0]
        raise RobotError(
            path,
            f"can't be expanded ({reason})",
            f"expand it where its packages are: xacro {path.name} > arm.urdf",
        ) from None


@cache
def _package() -> tuple[Any, dict[str, Any]]:
    """A copy of the package xacro of our own, so that nobody else meets what is put into it; and
    its own `WALKED`.
    """
    spec = importlib.util.find_spec("xacro")
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError("No module named 'xacro'", name="xacro")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, {name: getattr(module, name) for name in WALKED}


class _Expansion:
    """One description on its way to a URDF: its folders, its time, what it has read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.xacro, self.walked = _package()
        # The package that it belongs to; without one, its folder, or the one above `urdf/`.
        place = real_path(path)
        beside = place.parent.parent if place.parent.name in BESIDE else place.parent
        self.own = next(
            (folder for folder in place.parents if (folder / "package.xml").is_file()), beside
        )
        self.end = time.thread_time() + LONGEST_S
        self.left = LARGEST

    def text(self) -> str:
        def bounded(call: Any) -> Any:
            def checked(first: Any, *others: Any, **options: Any) -> Any:
                self.check_time()
                result = call(
                    require_plain(first) if isinstance(first, str) else first, *others, **options
                )
                return require_plain(result) if call.__name__ == "eval_text" else result

            return checked

        module = vars(self.xacro)
        module.update({name: bounded(call) for name, call in self.walked.items()})
        module.update(
            safe_eval=self.evaluate,
            eval_extension=self.substitute,
            parse=self.parse,
            get_include_files=self.included,
            is_valid_name=lambda name: str(name).isidentifier(),
            re_macro_arg=PARAMETER,
            **dict.fromkeys(
                ("warning", "message", "error", "print_location"), lambda *words, **options: None
            ),
        )
        return str(self.xacro.process_file(str(self.path)).toxml())

    def check_time(self) -> None:
        if time.thread_time() > self.end:
            raise HarmfulExpression("it takes too long")

    def evaluate(self, text: str, symbols: Any) -> Any:
        """The value of `${text}` among the properties of its place."""

        def lookup(name: str) -> Any:
            value = symbols
            for piece in name.split("."):
                table = value
                if not isinstance(table, self.xacro.Table):
                    raise KeyError(piece)
                while isinstance(table, self.xacro.Table) and not dict.__contains__(table, piece):
                    table = table.parent
                if not isinstance(table, self.xacro.Table) or table is self.xacro._global_symbols:
                    raise KeyError(piece)
                value = table[piece]
            return value

        return evaluate(text, lookup, self.functions(), self.check_time)

    def functions(self) -> dict[str, Any]:
        arguments = self.xacro.substitution_args_context["arg"]
        return {
            "load_yaml": self.load_yaml,
            "abs_filename": self.xacro.abs_filename_spec,
            "arg": lambda name: _typed(arguments[name]),
            "find": self.find,
            "optenv": lambda name, default="": default,
        }

    def substitute(self, text: str) -> str:
        """`$(arg name)`, `$(find package)`, `$(eval expression)`; `$(optenv name default)` is its
        default.
        """
        command, _, rest = text[2:-1].strip().partition(" ")
        arguments = self.xacro.substitution_args_context["arg"]
        if command == "eval":

            def lookup(name: str) -> Any:
                return _typed(arguments[name])

            return str(evaluate(rest, lookup, self.functions(), self.check_time))
        if command == "arg" and rest.strip() in arguments:
            return str(arguments[rest.strip()])
        if command == "arg":
            raise HarmfulExpression(f"the argument {rest.strip()!r} has no value")
        if command == "find":
            return self.find(rest.strip())
        if command == "optenv":
            return " ".join(rest.split()[1:])
        raise HarmfulExpression(f"$({command} …) is no part of a description")

    def find(self, name: str) -> str:
        """The folder of a package: the description's own, or one that is installed."""
        if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise HarmfulExpression(f"{name!r} is no name of a package")
        path = self.own / "package.xml"
        named = None
        with suppress(InputError):
            named = read_xml(
                read_text(path, "", largest=LARGEST_YAML), path, "", RobotError
            ).findtext("name")
        own_folder = [self.own] if name in (self.own.name, named) else []
        for folder in [*own_folder, *(home / name for home in _installed())]:
            if folder.is_dir():
                return str(folder)
        raise HarmfulExpression(f"the package {name!r} is not installed")

    def read(self, name: str, largest: int) -> str:
        """The text of a file of the description or of an installed package."""
        place = real_path(name)
        homes = (self.own, real_path(self.path).parent, *_installed())
        inside = any(place.is_relative_to(home) for home in homes)
        if place != real_path(self.path) and (place.suffix.lower() not in INCLUDED or not inside):
            raise HarmfulExpression(
                f"{name} is no part of the description: it lies outside of its package"
            )
        if not place.exists():
            raise self.xacro.XacroException(f"{name} is not there", exc=FileNotFoundError())
        text = read_text(place, "give a plain file", largest=min(largest, self.left))
        self.left -= len(text)
        return text

    def parse(self, text: Any, name: str | None = None) -> Any:
        """The XML document of a file, as `xacro.parse`."""
        if len(self.xacro.filestack) > DEEPEST:
            raise HarmfulExpression(f"{name} is included by what it includes")
        try:
            text = self.read(str(name), LARGEST)
        except self.xacro.XacroException:
            self.xacro.filestack.pop()
            raise
        require_no_entities(text, str(name), "write them out", RobotError)
        return xml.dom.minidom.parseString(text)

    def included(self, name: str, symbols: Any) -> Iterator[str]:
        """The files that an `<xacro:include>` names, which may have `*` in the last part of its
        path.
        """
        path = Path(self.xacro.abs_filename_spec(str(self.xacro.eval_text(name, symbols))))
        if not any(mark in path.name for mark in "*?["):
            yield str(path)
            return
        if not real_path(path.parent).is_relative_to(self.own):
            raise HarmfulExpression(f"{path} lies outside of its package")
        yield from sorted(map(str, path.parent.glob(path.name)))

    def load_yaml(self, name: str) -> Any:
        """The tables of a YAML file; no aliases, which multiply, and no tags but units."""
        import yaml

        class Loader(yaml.SafeLoader):
            def compose_node(self, parent: Any, index: Any) -> Any:
                if self.check_event(yaml.AliasEvent):
                    raise HarmfulExpression(f"{name} has an alias: write it out")
                return super().compose_node(parent, index)

        def with_unit(scale: float) -> Any:
            return lambda loader, node: (
                scale
                * float(evaluate(loader.construct_scalar(node), NO_NAMES, {}, self.check_time))
            )

        for unit, scale in UNITS.items():
            Loader.add_constructor(f"!{unit}", with_unit(scale))
        return require_plain(
            yaml.load(self.read(self.xacro.abs_filename_spec(name), LARGEST_YAML), Loader)
        )


def _typed(value: str) -> Any:
    """An argument as `$(eval …)` sees it: a number or a truth value where it reads as one."""
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(value.lower(), value)


def _installed() -> list[Path]:
    """The folders of installed packages."""
    return [
        real_path(folder) / below
        for name, below in INSTALLED.items()
        for folder in os.environ.get(name, "").split(os.pathsep)
        if folder
    ]
