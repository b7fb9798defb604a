"""The house stays as plain as it is: tests/layout.py measures it against tests/layout.toml."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.house.effects import effect_classes, named_classes
from tests.house.numbers import bare_numbers, is_number, number_constants
from tests.house.plainness import (
    MOST_COLUMNS,
    MOST_DENSITY,
    any_annotations,
    code_lines,
    has_late_constants,
    names_twice,
    nested_comprehensions,
    node_density,
    parallel_assignments,
    statement_sizes,
    vague_names,
)
from tests.house.rooms import arrows, depth
from tests.house.sources import ROOT, Source, read_sources
from tests.house.traces import TRACER, measure_traces
from tests.layout import RECORD, beyond, measure, with_numbers

# Folders that hold to 100 columns, by a ruff.toml of their own; the list may only grow.
NARROW = ("ident", "plan", "tests/house")
# Folders of no more syntax nodes a code line than plain code has; the list may only grow.
PLAIN = (
    *("ident/api", "ident/cli", "ident/closed_loop", "ident/effects", "ident/local_page"),
    *("plan/cli",),
)
RECORDED = tomllib.loads(RECORD.read_text(encoding="utf-8"))["recorded"]
REMEDY = "write it more plainly, or raise the number in tests/layout.toml and say why"


def source_of(text: str, path: str = "ident/here.py") -> Source:
    return Source(Path(path), text, ast.parse(text), "ident.here")


def write_rooms(folder: Path, **rooms: str) -> None:
    (folder / "ident").mkdir(exist_ok=True)
    for room, text in rooms.items():
        (folder / "ident" / f"{room}.py").write_text(text)


def test_no_room_leads_back_to_itself() -> None:
    assert depth(arrows(read_sources(ROOT))) > 0


def test_the_source_keeps_its_figures() -> None:
    twice = names_twice(read_sources(ROOT))
    assert not beyond(measure(ROOT), RECORDED), f"{REMEDY}; names given twice: {twice}"


@pytest.mark.parametrize("folder", NARROW)
def test_a_folder_in_100_columns_stays_so(folder: str) -> None:
    """Law: the formatter and the linter hold it to 100 columns, and its lines are no longer."""
    settings = tomllib.loads((ROOT / folder / "ruff.toml").read_text(encoding="utf-8"))
    assert settings["line-length"] == MOST_COLUMNS
    for path in (ROOT / folder).rglob("*.py"):
        lines = path.read_text(encoding="utf-8").splitlines()
        assert max(map(len, lines), default=0) <= MOST_COLUMNS, path


@pytest.mark.parametrize("folder", PLAIN)
def test_a_folder_in_plain_code_stays_so(folder: str) -> None:
    inside = [source for source in read_sources(ROOT) if source.path.is_relative_to(folder)]
    assert 0.0 < node_density(inside) <= MOST_DENSITY


def test_a_fit_and_a_diagnosis_pass_no_more_files_than_they_did() -> None:
    assert not beyond(measure_traces(ROOT, ("fit", "diagnose")), RECORDED), REMEDY


@pytest.mark.slow
def test_a_comparison_and_a_plan_pass_no_more_files_than_they_did() -> None:
    assert not beyond(measure_traces(ROOT, ("fit", "compare", "solve")), RECORDED), REMEDY


def test_a_figure_may_fall_and_not_rise() -> None:
    assert not beyond({"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0})
    assert beyond({"a": 1.5}, {"a": 1.0}) == ["a: 1.5, recorded 1"]
    assert beyond({"a": 1.5}, {}) == ["a: 1.5, not recorded yet"]


def test_recording_writes_what_was_measured_and_nothing_else() -> None:
    text = "# why\n[recorded]\na = 9  # a word\nb = 5.5\n"
    recorded = with_numbers(text, {"a": 12, "b": 5.25, "c": 1})
    assert recorded == "# why\n[recorded]\na = 12  # a word\nb = 5.25\nc = 1\n"


def test_comments_blank_lines_and_docstrings_are_no_code() -> None:
    assert code_lines(source_of('"""What."""\n\n# why\nx = (\n    1,\n)\n')) == 3


def test_a_statement_has_the_same_nodes_however_it_is_broken_into_lines() -> None:
    wide = source_of("x = f(a, b)\n")
    narrow = source_of("x = f(\n    a,\n    b,\n)\n")
    assert statement_sizes(wide) == statement_sizes(narrow)


def test_a_compound_statement_is_no_larger_for_its_body() -> None:
    assert statement_sizes(source_of("while a:\n    f()\n")) == [3, 4]


def test_a_vague_name_counts_where_it_is_bound() -> None:
    text = "def f(one):\n    found = [at for at in one]\n    return found\n"
    assert vague_names(source_of(text)) == 3


def test_a_swap_and_an_unpacking_are_no_parallel_assignments() -> None:
    assert parallel_assignments(source_of("a, b = b, a\na, b = f()\n")) == 0
    assert parallel_assignments(source_of("a, b = 1, 2\n")) == 1


def test_only_the_inner_comprehension_is_nested() -> None:
    assert nested_comprehensions(source_of("[[x for x in y] for y in z]\n")) == 1
    assert nested_comprehensions(source_of("[x for x in z]\n")) == 0


def test_a_constant_belongs_above_the_first_function() -> None:
    function = "def f():\n    pass\n"
    assert has_late_constants(source_of(f"{function}LEAST = 1\n"))
    assert not has_late_constants(source_of(f"LEAST = 1\n{function}"))


def test_any_counts_in_every_annotation() -> None:
    text = "x: Any = 1\ndef f(a: list[Any], b: int) -> Any:\n    return Any\n"
    assert any_annotations(source_of(text)) == 3


@pytest.mark.parametrize("text", ["-0.5", "2 * 60"])
def test_a_number_is_made_of_numerals(text: str) -> None:
    assert is_number(ast.parse(text, mode="eval").body)


def test_constants_of_one_statement_are_counted_each() -> None:
    assert number_constants(source_of("LEAST, MOST, NAME = 1, 2.0, 'a'\nSAME = 3\n")) == 3


def test_a_number_counts_whether_it_has_a_name_or_not() -> None:
    named = source_of("LEAST = 7.5\ndef f(x):\n    return 2 * x[0] - LEAST\n")
    bare = source_of("def f(x):\n    return 2 * x[0] - 7.5\n")
    for source in (named, bare):
        assert number_constants(source) + bare_numbers(source) == 1


@pytest.mark.parametrize("text", ["True", "x + 1", "[1]"])
def test_what_is_not_of_numerals_alone_is_no_number(text: str) -> None:
    assert not is_number(ast.parse(text, mode="eval").body)


def test_an_effect_is_found_through_its_parents_and_named_by_imports_and_uses() -> None:
    laws = source_of("class A(Effect): ...\nclass B(A): ...\nclass C: ...\n", "ident/effects/a.py")
    classes = effect_classes([laws])
    assert classes == {"B"}
    user = source_of("from ident.effects.a import A, B\nx = B()\n")
    assert named_classes(user, classes) == 2


def test_the_way_down_is_counted(tmp_path: Path) -> None:
    write_rooms(tmp_path, a="from ident.b import x", b="from ident.c import x", c="x = 1")
    sources = read_sources(tmp_path)
    assert arrows(sources) == {("ident.a", "ident.b"), ("ident.b", "ident.c")}
    assert depth(arrows(sources)) == 3
    read_sources.cache_clear()
    write_rooms(tmp_path, c="import ident.a")
    assert depth(arrows(read_sources(tmp_path))) == 0
    read_sources.cache_clear()


def test_a_trace_holds_calls_between_files_and_no_library_in_between(tmp_path: Path) -> None:
    """A call that comes back through a library is the caller's own."""
    app = "from ident.cli.far import far\ndef app(standalone_mode):\n    sorted([1], key=far)\n"
    (tmp_path / "ident" / "cli").mkdir(parents=True)
    (tmp_path / "ident" / "__init__.py").touch()
    (tmp_path / "ident" / "cli" / "app.py").write_text(app)
    (tmp_path / "ident" / "cli" / "far.py").write_text("def far(x):\n    return x\n")
    out = tmp_path / "trace.json"
    command = [sys.executable, TRACER, tmp_path, out, "ident"]
    subprocess.run(command, check=True, capture_output=True)
    assert json.loads(out.read_text()) == {"files": 3, "arrows": 1, "status": 0}
