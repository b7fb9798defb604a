"""The colours of pages stand in one place, and every page has those that it asks for."""

import re
from importlib.resources import files
from pathlib import Path

import pytest

from ident.local_page.server import COLOURS_GO_HERE
from ident.show.palette import DARK, LIGHT, PRINTED, style_colours

ROOT = Path(__file__).parents[3]
TEMPLATES = Path(str(files("ident.show.report").joinpath("templates")))
LOCAL_PAGE = Path(str(files("ident.local_page").joinpath("page.html")))
SOURCES = [LOCAL_PAGE, *sorted(TEMPLATES.iterdir())]
HEXADECIMAL = re.compile(r"#[0-9a-fA-F]{6}\b|#[0-9a-fA-F]{3}\b")
ASKED_FOR = re.compile(r"var\(--([a-z-]+)\)")
# Set by a cell for itself: how much of it is shaded.
OF_A_CELL = {"dense"}
each_source = pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)


def test_light_dark_and_printed_pages_have_the_same_colours() -> None:
    assert list(DARK) == list(LIGHT)
    assert list(PRINTED) == list(LIGHT)


def test_print_comes_last() -> None:
    """Law: who prefers dark pages prints light ones; of rules that both hold the last one counts."""
    css = style_colours()
    assert css.index(f"--paper: {DARK['paper']}") < css.rindex(f"--paper: {LIGHT['paper']}")
    assert css.index("prefers-color-scheme") < css.index("print")


@each_source
def test_no_page_has_a_colour_of_its_own(source: Path) -> None:
    assert HEXADECIMAL.findall(source.read_text(encoding="utf-8")) == []


@each_source
def test_a_page_asks_for_no_colour_that_there_is_not(source: Path) -> None:
    text = source.read_text(encoding="utf-8")
    assert set(ASKED_FOR.findall(text)) <= set(LIGHT) | OF_A_CELL


def test_the_local_page_says_where_its_colours_go() -> None:
    assert LOCAL_PAGE.read_text(encoding="utf-8").count(COLOURS_GO_HERE) == 1


def test_the_documentation_has_the_links_of_the_pages() -> None:
    css = (ROOT / "docs" / "site.css").read_text(encoding="utf-8")
    red, green, blue = bytes.fromhex(LIGHT["link"][1:])
    assert f"--bs-link-color: {LIGHT['link']};" in css
    assert f"--bs-link-color-rgb: {red}, {green}, {blue};" in css
