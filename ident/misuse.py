"""What is wrong with a command line, in our own words: where, what, and the remedy.

The library that parses the line words each fault by the check that failed ("Input should be a valid
number, unable to parse string as a number"), and leaves out what was given.
"""

from __future__ import annotations

from typing import Any

from ident.errors import InputError

# Kinds of faults, as the library names them, of what is no number at all.
NO_NUMBER = ("float_type", "float_parsing")
NO_WHOLE_NUMBER = ("int_type", "int_parsing", "int_parsing_size", "int_from_float")
NOT_FINITE = ("finite_number",)
NO_SWITCH = ("bool_type", "bool_parsing")
OUT_OF_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")


def misuse(error: Any, command: str) -> str:
    """The line that tells a fault of the command line.

    Args:
        error: The library's exception.
        command: Name of the command, where the exception names none.
    """
    path = getattr(getattr(error, "ctx", None), "command_path", command)
    option = getattr(error, "param", None)
    if option is None:
        return f"{str(error.format_message()).rstrip('.')}; see {path} --help"
    what, remedy = _told(_fault_of(error), option, error)
    return str(InputError(_name_of(option), what, f"{remedy}; see {path} --help"))


def _fault_of(error: Any) -> dict[str, Any] | None:
    """The first fault of a value, with its kind and what was given; None where nothing was given."""
    faults = getattr(error.__cause__, "errors", None)
    return next(iter(faults()), None) if callable(faults) else None


def _name_of(option: Any) -> str:
    """An option or argument as the user writes it."""
    return str(max(option.opts, key=len)) if option.opts else str(option.name)


def _told(fault: dict[str, Any] | None, option: Any, error: Any) -> tuple[str, str]:
    """What is wrong with an option, and what to give instead."""
    if fault is None:
        is_missing = type(error).__name__ == "MissingParameter"
        what = "it is not given" if is_missing else str(error.message).rstrip(".")
        return what, "add it" if is_missing else "give another value"
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


def _bounds_of(option: Any) -> str:
    """Between which numbers an option's value lies, in words that follow `a number`."""
    least = getattr(option, "min", None)
    most = getattr(option, "max", None)
    ends = [f"{word} {end}" for word, end in (("from", least), ("to", most)) if end is not None]
    return "".join(f" {end}" for end in ends)
