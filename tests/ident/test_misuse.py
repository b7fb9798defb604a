"""A mistyped number is told in our own words: which option, what was given, and what to give."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import pytest
import typer

from ident.misuse import misuse

PACKAGES = ("ident", "plan")
# What the library that parses the command line would say.
OF_THE_LIBRARY = ("Input should", "Invalid value", "unable to parse", "Missing argument", "Missing option")


def commands() -> Iterator[tuple[str, Any]]:
    """All commands of both packages, each with its name."""
    for package in PACKAGES:
        group: Any = typer.main.get_command(import_module(f"{package}.cli.app").app)
        for name, command in group.commands.items():
            yield f"{package} {name}", command


def number_options() -> list[tuple[str, Any, Any]]:
    """Every option that is a number: the command's name, the command, the option."""
    found = []
    for name, command in commands():
        for option in command.params:
            kind = str(option.type_descriptor.annotation)
            if ("int" in kind or "float" in kind) and option.param_type_name == "option":
                found.append((name, command, option))
    return found


def told(name: str, command: Any, arguments: list[str]) -> str:
    """The line that a command line ends in."""
    with pytest.raises(Exception) as raised:  # noqa: PT011
        command.make_context(name, arguments)
    return misuse(raised.value, name)


@pytest.mark.parametrize("value", ["abc", "1,5", "10Hz"])
def test_no_number_is_told_for_every_option_that_takes_one(value: str) -> None:
    """Law: the line names the option and what it was given, and says that a number is wanted."""
    options = number_options()
    assert len(options) > 50
    for name, command, option in options:
        given = f"{option.opts[-1]}={value}"
        required = [
            f"{other.opts[-1]}=x" if other.param_type_name == "option" else "x"
            for other in command.params
            if other.required and other is not option
        ]
        line = told(name, command, [given, *required])
        assert line.startswith(f"{max(option.opts, key=len)}: '{value}' is no "), line
        assert "give a " in line
        assert "number" in line
        assert not any(words in line for words in OF_THE_LIBRARY), line
        assert "\n" not in line


@pytest.mark.parametrize(
    ("name", "arguments", "wanted"),
    [
        ("ident open", ["--port=99999"], "--port: '99999' is out of bounds; give a number from 0 to 65535"),
        ("ident simulate", ["--runs=1.5"], "--runs: '1.5' is no whole number; give a whole number"),
        ("ident fit", ["x.csv"], "--out: it is not given; add it"),
        ("ident inspect", [], "sessions: it is not given; add it"),
        ("ident inspect", ["x.csv", "--nosuch"], "No such option: --nosuch"),
    ],
)
def test_what_is_wrong_is_told_with_its_remedy(name: str, arguments: list[str], wanted: str) -> None:
    """Law: bounds, whole numbers and what is missing have words of their own."""
    line = told(name, dict(commands())[name], arguments)
    assert line.startswith(wanted)
    assert line.endswith(" --help")
