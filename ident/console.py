"""The console of both commands: names from files are shown as they are, and give no orders to the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from ident.errors import visible

# Where output is no terminal there is no edge: lines are this long [columns].
WIDE = 160


class PlainConsole(Console):
    """A console without markup: `[x]`, `:x:` and control characters in a text are part of it. Style by `styled`."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(visible(text, lines=True), **options)


def make_console() -> PlainConsole:
    """Standard output; wide where it is no terminal."""
    console = PlainConsole(markup=False, emoji=False)
    return console if console.is_terminal else PlainConsole(markup=False, emoji=False, width=WIDE)


def styled(*parts: str | tuple[str, str]) -> Text:
    """A text of plain parts and (part, style) pairs."""
    shown = (visible(part, lines=True) if isinstance(part, str) else (visible(part[0]), part[1]) for part in parts)
    return Text.assemble(*shown)
