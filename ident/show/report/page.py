"""The page: sections in order, one template each, everything inline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ident.errors import plural
from ident.files import atomic_write
from ident.show import palette
from ident.show.report import words

# What templates colour with.
COLOURS = ("MEASURED", "NAMED", "NOISE", "RUNG_MEANINGS", "FLEXIBLE", "TUNED", "model_colour", "rung_colours")


@dataclass(frozen=True, eq=False)
class Section:
    """One section of a page."""

    anchor: str  # its address on the page
    title: str  # its heading
    template: str  # file name of its template
    values: Mapping[str, Any]  # what the template gets


def write_report(path: str | Path, title: str, sections: Sequence[Section | None], subtitle: str = "") -> Path:
    """Writes one self-contained HTML page, whole or not at all.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_page(title, sections, subtitle))


def save_page(path: str | Path, page: str) -> Path:
    """Writes a page's text, whole or not at all."""
    with atomic_write(Path(path)) as part:
        part.write_text(page, encoding="utf-8")
    return Path(path)


def render_page(title: str, sections: Sequence[Section | None], subtitle: str = "") -> str:
    """The page as text."""
    environment = Environment(
        loader=PackageLoader("ident.show.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
    )
    own = {name: one for name, one in vars(words).items() if getattr(one, "__module__", "") == words.__name__}
    environment.filters |= own
    environment.filters |= {"breakable": breakable, "coded": coded, "plural": plural, "rung": palette.rung_name}
    environment.globals |= {name: getattr(palette, name) for name in COLOURS} | {"pairs": words.pairs}
    bodies = [
        {
            "anchor": one.anchor,
            "title": one.title,
            "html": Markup(environment.get_template(one.template).render(one.values)),
        }
        for one in sections
        if one is not None
    ]
    return environment.get_template("page.html").render(title=title, subtitle=subtitle, sections=bodies)


def breakable(name: str) -> Markup:
    """A name that may break after its underscores: joint names are long, phones are narrow."""
    return Markup(escape(name).replace("_", Markup("_<wbr>")))


def coded(text: str) -> Markup:
    """A sentence with what stands between backticks as code: commands to be run as they stand."""
    parts = str(escape(text)).split("`")
    whole = [f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts[: len(parts) // 2 * 2 + 1])]
    return Markup("".join(whole))
