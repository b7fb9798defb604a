"""Commands out of options: each field of a dataclass of options is one option of the command, with its help."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

T = TypeVar("T")


def takes(kind: type) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Makes a command of a function whose argument `options` is of a kind of options: one option a field."""

    def made(function: Callable[..., T]) -> Callable[..., T]:
        names = [one.name for one in fields(kind)]

        def command(**given: Any) -> T:
            return function(options=kind(**{name: given.pop(name) for name in names}), **given)

        signature = inspect.signature(function, eval_str=True)
        own = [one for one in signature.parameters.values() if one.name != "options"]
        command.__signature__ = signature.replace(parameters=[*own, *_parameters(kind)])  # type: ignore[attr-defined]
        command.__name__, command.__doc__, command.__annotations__ = function.__name__, function.__doc__, {}
        return command

    return made


def _parameters(kind: type) -> list[inspect.Parameter]:
    hints, found = get_type_hints(kind), []
    for one in fields(kind):
        meta = one.metadata
        shown = typer.Option(*meta["names"], help=meta["help"], **meta["bounds"])
        annotation = Annotated.__class_getitem__((hints[one.name], shown))  # type: ignore[attr-defined]
        place = inspect.Parameter.POSITIONAL_OR_KEYWORD
        found.append(inspect.Parameter(one.name, place, default=one.default, annotation=annotation))
    return found
