"""The command that compares two sets of recordings of one arm."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import Cutoff, JsonFile, Robot, SessionFile, Topic, app, console, say_where
from ident.errors import InputError
from ident.files import atomic_folder, deliver, write_record
from ident.outputs import check_outputs
from ident.show.console import progress_line

KIND = "comparison"


@app.command()
def compare(
    before: Annotated[
        list[Path],
        typer.Argument(help="Sessions before, as folders or files; the second of two is after.", show_default=False),
    ],
    after: Annotated[list[Path] | None, typer.Option(help="Sessions after, where either set has several.")] = None,
    robot: Robot = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the result file and the page.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write the page to this file.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    seed: Annotated[int, typer.Option(help="Seed of the sign-flip tests.", min=0)] = 0,
    json_file: JsonFile = None,
) -> None:
    """What changed between two sets of sessions of one arm: at which joint, by how much."""
    from ident.api.comparing import compare as compare_sets
    from ident.show.changes import print_comparison
    from ident.show.report.change_pages import render_comparison_report
    from ident.show.report.page import save_page

    earlier, later = split_sets(before, after)
    read = [*earlier, *later, robot, session_file]
    check_outputs(read, {"--html": html, "--json": json_file}, {"--out": (out, KIND)})
    with progress_line(console, "compare"):
        found = compare_sets(
            list(earlier), list(later), robot, cutoff=cutoff, seed=seed, topic=topic, session_file=session_file
        )
    record = found.to_dict()

    def write_folder() -> None:
        if out is None:
            return
        with atomic_folder(out, KIND) as part:
            text = json.dumps(record, indent=1) + "\n"
            (part / "comparison.json").write_text(text, encoding="utf-8")
            (part / "comparison.html").write_text(render_comparison_report(record), encoding="utf-8")

    def write_page() -> None:
        if html is not None:
            save_page(html, render_comparison_report(record))

    def show() -> None:
        print_comparison(console, record)
        say_where(("page", html), ("result and page", out))

    deliver(show, lambda: write_record(json_file, record), write_page, write_folder)


def split_sets(before: list[Path], after: list[Path] | None) -> tuple[list[Path], list[Path]]:
    """The two sets: what stands before and after `--after`, or the first and the second of two.

    Raises:
        InputError: Neither.
    """
    if after:
        return before, after
    if len(before) != 2:
        raise InputError(
            "compare",
            f"{len(before)} sessions and no --after: it is open which of them are the later ones",
            "give two sessions, or BEFORE … --after AFTER --after …",
        )
    return before[:1], before[1:]
