"""The layout keeps what was reached: measured by tests/house.py, which prints the figures."""

from __future__ import annotations

from pathlib import Path

from tests.house import arrows, depth, measure, names_twice, read_sources

ROOT = Path(__file__).parents[1]
# More are two rooms in one.
MOST_LINES = 400


def test_no_room_leads_back_to_itself() -> None:
    assert depth(arrows(read_sources(ROOT))) > 0


def test_no_public_class_name_is_given_a_second_time() -> None:
    assert not names_twice(read_sources(ROOT))


def test_functions_stay_short_typed_and_files_small() -> None:
    found = measure(ROOT)
    assert int(found["lines of functions, 90 %"]) <= 20
    assert float(found["functions annotated [%]"]) > 98.0  # compiled kernels say shapes in words
    assert int(str(found["lines of the largest file"]).split()[0]) <= MOST_LINES


def test_the_way_down_is_counted(tmp_path: Path) -> None:
    for room, text in (("a", "from ident.b import x"), ("b", "from ident.c import x"), ("c", "x = 1")):
        (tmp_path / "ident").mkdir(exist_ok=True)
        (tmp_path / "ident" / f"{room}.py").write_text(text)
    sources = read_sources(tmp_path)
    assert arrows(sources) == {("ident.a", "ident.b"), ("ident.b", "ident.c")}
    assert depth(arrows(sources)) == 3
    (tmp_path / "ident" / "c.py").write_text("import ident.a")
    assert depth(arrows(read_sources(tmp_path))) == 0
