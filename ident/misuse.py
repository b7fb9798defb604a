"""What is wrong with a command line, in our own words: where, what, and the remedy.

The library that parses the line words each fault by the check that failed ("Input should be a valid
number, unable to parse string as a number"), and leaves out what was given.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ident.errors import InputError

# Kinds of faults, as the library names them, of what is no number at all.
NO_NUMBER = ("float_type", "float_parsing")
NO_WHOLE_NUMBER = ("int_type", "int_parsing", "int_parsing_size", "int_from_float")
NOT_FINITE = ("finite_number",)
NO_SWITCH = ("bool_type", "bool_parsing")
OUT_OF_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")


class Option(Protocol):
    """An option or argument of a command, as the library has it."""

    name: str
    opts: list[str]
    min: float | None
    max: float | None


class Misuse(Protocol):
    """What the library raises where a command line is no command."""

    message: str
    ctx: object
    __cause__: BaseException | None

    def format_message(self) -> str:
        """The fault in the library's words."""


Fault = Mapping[str, object]


def misuse(error: Misuse, command: str) -> str:
    """The line that tells a fault of the command line.

    Args:
        error: The library's exception.
        command: Name of the command, where the exception names none.
    """
    path = getattr(error.ctx, "command_path", command)
    option: Option | None = getattr(error, "param", None)
    if option is None:
        return f"{error.format_message().rstrip('.')}; see {path} --help"
    what, remedy = _told(error, option)
    place = max(option.opts, key=len, default=option.name)
    return str(InputError(place, what, f"{remedy}; see {path} --help"))


def _fault_of(error: Misuse) -> Fault | None:
    """The first fault of a value, with its kind and what was given; None where it has no such."""
    faults = getattr(error.__cause__, "errors", None)
    return next(iter(faults()), None) if callable(faults) else None


def _told(error: Misuse, option: Option) -> tuple[str, str]:
    """What is wrong with an option, and what to give instead."""
    fault = _fault_of(error)
    if fault is not None:
        return _told_of_value(fault, option)
    if type(error).__name__ == "MissingParameter":
        return "it is not given", "add it"
    return error.message.rstrip("."), "give another value"


def _told_of_value(fault: Fault, option: Option) -> tuple[str, str]:
    """What is wrong with a value, and what to give instead."""
    given = f"'{fault['input']}'"
    kind = fault["type"]
    if kind in NO_WHOLE_NUMBER:
        return f"{given} is no whole number", f"give a whole number{_bounds_of(option)}"
    if kind in NO_NUMBER:
        return f"{given} is no number", f"give a number{_bounds_of(option)}, without its unit"
    if kind in NOT_FINITE:
        return f"{given} is no finite number", f"give a number{_bounds_of(option)}"
    if kind in OUT_OF_BOUNDS:
        return f"{given} is out of bounds", f"give a number{_bounds_of(option)}"
    if kind in NO_SWITCH:
        return f"{given} is neither yes nor no", "give yes or no"
    return f"{given}: {str(fault['msg']).rstrip('.')}", "give another value"


def _bounds_of(option: Option) -> str:
    """Between which numbers an option's value lies, in words that follow `a number`."""
    ends = (("from", option.min), ("to", option.max))
    return "".join(f" {word} {end}" for word, end in ends if end is not None)
