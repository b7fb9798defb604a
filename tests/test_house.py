"""The layout keeps what was reached: measured by tests/layout.py against the budget of tests/layout.toml."""

import tomllib
from pathlib import Path

import pytest

from tests.layout import (
    BUDGET,
    ROOT,
    arrows,
    beyond,
    depth,
    lines_by_part,
    lower,
    measure,
    measure_traces,
    names_twice,
    read_sources,
)

RULES = tomllib.loads(BUDGET.read_text(encoding="utf-8"))
REMEDY = "take something out, or raise the number in tests/layout.toml and say why"


def test_no_room_leads_back_to_itself() -> None:
    assert depth(arrows(read_sources(ROOT))) > 0


def test_no_public_class_name_is_given_a_second_time() -> None:
    assert not names_twice(read_sources(ROOT))


def test_every_part_keeps_its_lines() -> None:
    found = lines_by_part(read_sources(ROOT), RULES)
    assert not found.pop("unassigned"), "give every module a part in tests/layout.toml"
    assert not beyond(found, RULES), REMEDY


def test_the_source_keeps_its_figures() -> None:
    assert not beyond(measure(ROOT), RULES), REMEDY


@pytest.mark.slow
def test_a_command_passes_no_more_files_than_it_did() -> None:
    assert not beyond(measure_traces(), RULES), REMEDY


def test_the_budget_is_lowered_and_never_raised() -> None:
    text = 'a = { now = 9, target = 3 }\n"b, c" = { now = 5, target = 1, of = ["x"] }\nd = { now = 4, target = 4 }\n'
    assert lower(text, {"a": 7, "b, c": 8, "d": 2}) == text.replace("now = 9", "now = 7")


def test_shares_may_not_fall_and_the_rest_may_not_grow() -> None:
    rules = {"parts": {"a": {"now": 1.0}}, "figures": {"x_share": {"now": 0.5}}}
    assert not beyond({"a": 1.0, "x_share": 0.5}, rules)
    assert len(beyond({"a": 2.0, "x_share": 0.4}, rules)) == 2


def test_the_way_down_is_counted(tmp_path: Path) -> None:
    for room, text in (("a", "from ident.b import x"), ("b", "from ident.c import x"), ("c", "x = 1")):
        (tmp_path / "ident").mkdir(exist_ok=True)
        (tmp_path / "ident" / f"{room}.py").write_text(text)
    sources = read_sources(tmp_path)
    assert arrows(sources) == {("ident.a", "ident.b"), ("ident.b", "ident.c")}
    assert depth(arrows(sources)) == 3
    read_sources.cache_clear()
    (tmp_path / "ident" / "c.py").write_text("import ident.a")
    assert depth(arrows(read_sources(tmp_path))) == 0
