"""What the commands share: how an application is made, options out of dataclasses, and how results are handed over."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperGroup

from ident.console import make_console
from ident.files import deliver, write_record
from ident.outputs import STANDARD_OUTPUT
from ident.results import own_version

if TYPE_CHECKING:
    from click import HelpFormatter

    from ident.results import Result

T = TypeVar("T")
console = make_console()
# A sentence of any length is shorter.
ANY_LENGTH = 10_000


def _show_version(context: typer.Context, given: bool) -> None:
    if given:
        print(f"{context.find_root().command.name} (armgap) {own_version()}")
        raise typer.Exit


class _Commands(TyperGroup):
    """Commands whose help is a whole sentence each, over as many lines as it takes."""

    def format_commands(self, ctx: typer.Context, formatter: HelpFormatter) -> None:  # type: ignore[override]
        found = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(ANY_LENGTH)) for name, one in found if one is not None])


def make_app(name: str, purpose: str) -> typer.Typer:
    """An application that shows its help where no command is given, and knows `--version`.

    Args:
        name: The command's name.
        purpose: One sentence for its help.
    """
    app = typer.Typer(name=name, cls=_Commands, help=purpose, pretty_exceptions_enable=False, rich_markup_mode=None)

    @app.callback(invoke_without_command=True)
    def start(
        context: typer.Context,
        version: Annotated[
            bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
        ] = False,
    ) -> None:
        if context.invoked_subcommand is None:
            print(context.get_help())

    return app


def takes(function: Callable[..., T]) -> Callable[..., T]:
    """Makes a command of a function: each argument that is a dataclass of options becomes one option a field."""
    signature = inspect.signature(function, eval_str=True)
    plain = [one.replace(kind=one.KEYWORD_ONLY) for one in signature.parameters.values()]
    kinds: dict[str, Any] = {one.name: one.annotation for one in plain if is_dataclass(one.annotation)}
    parameters = {name: _parameters(kind) for name, kind in kinds.items()}

    def command(**given: Any) -> T:
        for name, own in parameters.items():
            values = {one.name: given.pop(one.name) for one in own}
            # Nothing given is the default; what may be given again comes as a list.
            values = {key: tuple(v) if isinstance(v, list) else v for key, v in values.items() if v is not None}
            given[name] = kinds[name](**values)
        return function(**given)

    ahead = [one for one in plain if one.name not in kinds and one.name != "json_file"]
    made = [*ahead, *chain(*parameters.values()), *(one for one in plain if one.name == "json_file")]
    command.__signature__ = signature.replace(parameters=made)  # type: ignore[attr-defined]
    command.__name__, command.__doc__, command.__annotations__ = function.__name__, function.__doc__, {}
    return command


def _parameters(kind: type) -> list[inspect.Parameter]:
    """One parameter a field that has a help text, the own ones of a class before those of its bases."""
    hints, own = get_type_hints(kind), vars(kind).get("__annotations__", {})
    found = []
    for one in sorted((one for one in fields(kind) if "help" in one.metadata), key=lambda one: one.name not in own):
        meta = one.metadata
        shown = typer.Option(*meta["names"], help=meta["help"], **meta["bounds"])
        annotation = Annotated.__class_getitem__((meta["typed"] or hints[one.name], shown))  # type: ignore[attr-defined]
        default = None if one.default == () else one.default
        place = inspect.Parameter.KEYWORD_ONLY
        found.append(inspect.Parameter(one.name, place, default=default, annotation=annotation))
    return found


def _clear_output(context: typer.Context, path: Path | None) -> Path | None:
    """Where the record goes to standard output, all else goes to standard error until the command ends."""
    if path == STANDARD_OUTPUT:
        console.stderr = True
        context.call_on_close(lambda: setattr(console, "stderr", False))
    return path


app = make_app("ident", "Identify a robot arm, and find out why it does not move as its model says.")

Sessions = Annotated[list[Path], typer.Argument(help="Session folders, or single files.", show_default=False)]
Model = Annotated[Path, typer.Argument(help="Folder of a fitted model.", show_default=False)]
Robot = Annotated[
    str | None,
    typer.Option("--robot", help="URDF path, tm5-900, or a name of example-robot-data (panda, baxter:left_w2, …)."),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", help="Write the results to this file; - is standard output.", callback=_clear_output),
]
Html = Annotated[Path | None, typer.Option(help="Write the page to this file.")]


def hand_over(
    found: Result, json_file: Path | None, *writes: Callable[[], object], places: dict[str, Path | None] | None = None
) -> None:
    """Writes a result's record and all else that is to be written, then shows it and where the rest lies."""

    def show() -> None:
        import_module(found.SHOWN_BY).write(console, found)
        for what, path in (places or {}).items():
            if path is not None and path.exists():
                console.print(f"{what} written to {path}", soft_wrap=True)

    deliver(show, lambda: write_record(json_file, found.to_dict()), *writes)
