"""The page: sections in order, one template each, everything inline."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ident.files import atomic_write
from ident.show.palette import NAMED, NOISE, TREES, TUNED, rung_colours, rung_name
from ident.show.report.numbers import fixed, pair, significant


class Section(ABC):
    """One section of the page: a heading, and what its template is told.

    Attributes:
        anchor: Its address on the page.
        title: Its heading.
        template: File name of its template.
    """

    anchor: ClassVar[str]
    title: ClassVar[str]
    template: ClassVar[str]

    @property
    def is_present(self) -> bool:
        """Whether there is anything to show."""
        return True

    @abstractmethod
    def context(self) -> dict[str, Any]:
        """What the template is told."""


@dataclass(frozen=True, eq=False)
class FilledSection(Section):
    """A section whose template gets values that are known already; left out where there is nothing to show."""

    anchor: str  # type: ignore[misc]
    title: str  # type: ignore[misc]
    template: str  # type: ignore[misc]
    values: Mapping[str, Any]
    is_present: bool = True

    def context(self) -> dict[str, Any]:
        return dict(self.values)


def write_report(path: str | Path, title: str, sections: Sequence[Section], subtitle: str = "") -> Path:
    """Writes one self-contained HTML page, whole or not at all; sections with nothing to show are left out.

    Args:
        path: The file to be written.
        title: Heading of the page.
        sections: What it shows, in this order.
        subtitle: A line under the heading: robot, recordings.

    Raises:
        InputError: The folder can't be written to.
    """
    return save_page(path, render_page(title, sections, subtitle))


def save_page(path: str | Path, page: str) -> Path:
    """Writes a page's text, whole or not at all."""
    with atomic_write(Path(path)) as part:
        part.write_text(page, encoding="utf-8")
    return Path(path)


def render_page(title: str, sections: Sequence[Section], subtitle: str = "") -> str:
    """The page as text."""
    environment = _environment()
    shown = [section for section in sections if section.is_present]
    bodies = [
        {
            "anchor": section.anchor,
            "title": section.title,
            "html": Markup(environment.get_template(section.template).render(section.context())),
        }
        for section in shown
    ]
    return environment.get_template("page.html").render(title=title, subtitle=subtitle, sections=bodies)


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("ident.show.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        fixed=fixed, pair=pair, significant=significant, rung=rung_name, breakable=breakable, coded=coded
    )
    environment.globals |= {"rung_colours": rung_colours, "TUNED": TUNED, "NAMED": NAMED}
    environment.globals |= {"TREES": TREES, "NOISE": NOISE}
    return environment


def breakable(name: str) -> Markup:
    """A name that may break after its underscores: joint names are long, phones are narrow."""
    return Markup(escape(name).replace("_", Markup("_<wbr>")))


def coded(text: str) -> Markup:
    """A sentence with what stands between backticks as code: commands to be run as they stand."""
    parts = str(escape(text)).split("`")
    whole = [f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts[: len(parts) // 2 * 2 + 1])]
    return Markup("".join(whole))
