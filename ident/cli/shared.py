"""What the commands share: how an application is made, options out of dataclasses, and how results
are handed over.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_args, get_type_hints

import typer
from typer.core import TyperGroup

from ident.command_options import ROBOT_HELP
from ident.files import deliver, write_record
from ident.outputs import STANDARD_OUTPUT, check_outputs
from ident.results import own_version
from ident.show.console import make_console

if TYPE_CHECKING:
    from click import HelpFormatter

    from ident.results import Result

console = make_console()
# A sentence of any length is shorter.
ANY_LENGTH = 10_000
# Mark of what a command reads that is no path by its type: nothing is written there.
READS = "reads"


def _show_version(context: typer.Context, given: bool) -> None:
    if given:
        print(f"{context.find_root().command.name} (armgap) {own_version()}")
        raise typer.Exit


class _Commands(TyperGroup):
    """Commands whose help is a whole sentence each, over as many lines as it takes."""

    def format_commands(  # type: ignore[override]
        self, ctx: typer.Context, formatter: HelpFormatter
    ) -> None:
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(
                [
                    (name, command.get_short_help_str(ANY_LENGTH))
                    for name, command in commands
                    if command is not None
                ]
            )


def make_app(name: str, purpose: str) -> typer.Typer:
    """An application that shows its help where no command is given, and knows `--version`.

    Args:
        name: The command's name.
        purpose: One sentence for its help.
    """
    app = typer.Typer(
        name=name,
        cls=_Commands,
        help=purpose,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )

    @app.callback(invoke_without_command=True)
    def start(
        context: typer.Context,
        version: Annotated[
            bool,
            typer.Option(
                "--version",
                help="Show the version and exit.",
                callback=_show_version,
                is_eager=True,
            ),
        ] = False,
    ) -> None:
        if context.invoked_subcommand is None:
            print(context.get_help())

    return app


class Writes(NamedTuple):
    """Mark of an argument whose value is a place to write to: a file, or a folder of a kind of
    result.
    """

    kind: str = ""


def commands_of(app: typer.Typer) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that makes commands of functions.

    Each argument that is a dataclass of options becomes one option a field. What is read and where
    is written, by the marks of the arguments, is looked at before anything else. A result that the
    function returns is written and shown; one that does so itself, or more, takes the `json_file`
    and returns nothing.
    """

    def make(function: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(function, eval_str=True)
        plain = [
            parameter.replace(kind=parameter.KEYWORD_ONLY)
            for parameter in signature.parameters.values()
        ]
        kinds: dict[str, Any] = {
            parameter.name: parameter.annotation
            for parameter in plain
            if is_dataclass(parameter.annotation)
        }
        fields_of = {name: _parameters(kind) for name, kind in kinds.items()}
        made = [parameter for parameter in plain if parameter.name not in {"json_file", *kinds}]
        made += chain(*fields_of.values())
        if "json_file" in signature.parameters or signature.return_annotation is not None:
            keyword = inspect.Parameter.KEYWORD_ONLY
            made.append(inspect.Parameter("json_file", keyword, default=None, annotation=JsonFile))

        def run(**given: Any) -> None:
            chosen = {name: value for name, value in given.items() if name in signature.parameters}
            for name, option_fields in fields_of.items():
                # Nothing given is the default; what may be given again comes as a list.
                values = {
                    option.name: given[option.name]
                    for option in option_fields
                    if given[option.name] is not None
                }
                chosen[name] = kinds[name](
                    **{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
                )
            _check_places(made, given)
            result = function(**chosen)
            if result is not None:
                hand_over(result, given["json_file"])

        told = signature.replace(parameters=made, return_annotation=None)
        run.__signature__ = told  # type: ignore[attr-defined]
        run.__name__ = function.__name__.rstrip("_")
        run.__doc__ = function.__doc__
        run.__annotations__ = {}
        return app.command()(run)

    return make


def _check_places(parameters: Sequence[inspect.Parameter], given: Mapping[str, Any]) -> None:
    """Looks at all that a command reads and writes, by the marks of its parameters.

    What is a path by its type is read, where no mark says that it is written.
    """
    read: list[Any] = []
    files: dict[str, Path | None] = {}
    folders: dict[str, tuple[Path | None, str]] = {}
    for name, kind in ((parameter.name, parameter.annotation) for parameter in parameters):
        value = given[name]
        label = "--json" if name == "json_file" else f"--{name}"
        marks = [
            mark
            for mark in getattr(kind, "__metadata__", ())
            if mark == READS or isinstance(mark, Writes)
        ]
        mark = next(iter(marks), READS if "Path" in str(get_args(kind)[:1]) else "")
        if mark == READS:
            read += value if isinstance(value, list) else [value]
        elif isinstance(mark, Writes) and mark.kind:
            folders[label] = value, mark.kind
        elif isinstance(mark, Writes):
            files[label] = value
    check_outputs(read, files, folders)


def _parameters(kind: type) -> list[inspect.Parameter]:
    """One parameter a field that has a help text, the own ones of a class before those of its
    bases.
    """
    hints = get_type_hints(kind)
    stated = vars(kind).get("__annotations__", {})
    parameters = []
    for option in sorted(
        (option for option in fields(kind) if option.metadata.get("help")),
        key=lambda option: option.name not in stated,
    ):
        meta = option.metadata
        shown = typer.Option(*meta["names"], help=meta["help"], **meta["bounds"])
        mark: object = READS if meta["reads"] else ""
        if meta["writes"]:
            mark = Writes(meta["writes"])
        marked = (meta["typed"] or hints[option.name], shown, mark)
        annotation = Annotated.__class_getitem__(marked)  # type: ignore[attr-defined]
        default = None if option.default == () else option.default
        place = inspect.Parameter.KEYWORD_ONLY
        parameters.append(
            inspect.Parameter(option.name, place, default=default, annotation=annotation)
        )
    return parameters


def _clear_output(context: typer.Context, path: Path | None) -> Path | None:
    """Where the record goes to standard output, all else goes to standard error until the command
    ends.
    """
    if path == STANDARD_OUTPUT:
        console.stderr = True
        context.call_on_close(lambda: setattr(console, "stderr", False))
    return path


app = make_app(
    "ident", "Identify a robot arm, and find out why it does not move as its model says."
)
command = commands_of(app)

Sessions = Annotated[
    list[Path], typer.Argument(help="Session folders, or single files.", show_default=False)
]
Model = Annotated[Path, typer.Argument(help="Folder of a fitted model.", show_default=False)]
Robot = Annotated[
    str | None,
    typer.Option("--robot", help=f"{ROBOT_HELP}."),
    READS,
]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write the results to this file; - is standard output.",
        callback=_clear_output,
    ),
    Writes(),
]
Html = Annotated[Path | None, typer.Option(help="Write the page to this file."), Writes()]


def hand_over(
    result: Result,
    json_file: Path | None,
    *writes: Callable[[], object],
    places: dict[str, Path | None] | None = None,
    tell: Callable[[], object] | None = None,
) -> None:
    """Writes a result's record and all else that is to be written, then shows it and where the rest
    lies.

    Args:
        found: The result.
        json_file: Where its record goes.
        writes: What writes the rest.
        places: Where that lies, by what it is.
        tell: Shows the result; as results of its kind are shown if None.
    """

    def show() -> None:
        if tell is None:
            import_module(result.SHOWN_BY).write(console, result)
        else:
            tell()
        for what, path in (places or {}).items():
            if path is not None and path.exists():
                console.print(f"{what} written to {path}", soft_wrap=True)

    deliver(show, lambda: write_record(json_file, result.to_dict()), *writes)
