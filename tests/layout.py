"""Measures how plainly the two packages are written, against the numbers of layout.toml.

    python tests/layout.py                      # the table
    python tests/layout.py --traces             # with the call traces of four whole commands
    python tests/layout.py --against COMMIT     # with the same of an earlier commit beside it
    python tests/layout.py --record             # writes today's numbers, whatever they are

What is counted stands in tests/house, a file a subject.
Nothing counts lines of code: code may grow where it becomes plainer.
"""

import argparse
import io
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, too, it finds its parts

from tests.house import effects, numbers, plainness, rooms
from tests.house.sources import ROOT, Source, read_sources, total
from tests.house.traces import Figures, measure_traces

RECORD = Path(__file__).with_suffix(".toml")


def measure_plainness(sources: list[Source]) -> Figures:
    """How plainly the modules are written."""
    return {
        "nodes_per_code_line": round(plainness.node_density(sources), 2),
        "files_of_inference_over_10_nodes": total(plainness.is_dense, sources),
        "lines_over_100_columns": total(plainness.long_lines, sources),
        "bindings_of_vague_names": total(plainness.vague_names, sources),
        "parallel_assignments": total(plainness.parallel_assignments, sources),
        "nested_comprehensions": total(plainness.nested_comprehensions, sources),
        "functions_of_more_than_six_parameters": total(plainness.wide_functions, sources),
        "files_with_constants_below_a_function": total(plainness.has_late_constants, sources),
        "any_annotations": total(plainness.any_annotations, sources),
        "public_class_names_given_twice": len(plainness.names_twice(sources)),
    }


def measure_effects(folder: Path, sources: list[Source]) -> Figures:
    """What the class of an effect holds, and how often effects are named elsewhere."""
    attributes, methods = effects.count_members(sources)
    ids = effects.effect_ids(folder)
    classes = effects.effect_classes(sources)
    elsewhere = [source for source in sources if not effects.is_effect_home(source)]
    return {
        "attributes_of_effect": attributes,
        "methods_of_effect": methods,
        "effect_ids_quoted_elsewhere": total(lambda source: effects.quoted_ids(source, ids), elsewhere),
        "effect_classes_named_elsewhere": total(lambda source: effects.named_classes(source, classes), elsewhere),
    }


def measure(folder: Path) -> Figures:
    """What the text of a working tree holds; names as in layout.toml."""
    sources = read_sources(folder)
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = numbers.settings_rows(folder)
    return {
        **measure_plainness(sources),
        **measure_effects(folder, sources),
        "settings_that_decide": rows + total(numbers.written_settings, sources),
        "settings_read_without_a_type": rows,
        "numbers_in_code": total(numbers.number_constants, sources) + total(numbers.bare_numbers, sources),
        "floors_of_rooms": rooms.depth(rooms.arrows(sources)),
        "mandatory_dependencies": len(project["dependencies"]),
    }


def beyond(measured: Figures, recorded: Figures) -> list[str]:
    """Figures that passed what is recorded, and those that are not, in words."""
    words = []
    for name, number in measured.items():
        if name not in recorded:
            words.append(f"{name}: {number:g}, not recorded yet")
        elif number > recorded[name]:
            words.append(f"{name}: {number:g}, recorded {recorded[name]:g}")
    return words


def with_numbers(text: str, measured: Figures) -> str:
    """The record's text with today's numbers; rows that it lacks are put at its end."""
    missing = []
    for name, number in measured.items():
        row = re.compile(rf"(?m)^{name} = [-+.e\d]+")
        if row.search(text):
            text = row.sub(f"{name} = {number:g}", text, count=1)
        else:
            missing.append(f"{name} = {number:g}\n")
    return text + "".join(missing)


def unpack(commit: str, folder: Path) -> None:
    """Puts the tree of a commit into a folder."""
    done = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True)
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        archive.extractall(folder, filter="data")


def measure_all(folder: Path, traces: bool) -> Figures:
    """All figures of a working tree."""
    figures = measure(folder)
    if traces:
        figures |= measure_traces(folder)
    return figures


def print_table(columns: dict[str, Figures]) -> None:
    """One row a figure, one column a tree."""
    names = Counter(name for figures in columns.values() for name in figures)
    print(f"{'':<40}" + "".join(f"{title:>14}" for title in columns))
    for name in names:
        numbers = [figures.get(name) for figures in columns.values()]
        cells = ["" if number is None else f"{number:g}" for number in numbers]
        print(f"{name:<40}" + "".join(f"{cell:>14}" for cell in cells))


def main() -> None:
    """Prints the table; see the module."""
    parser = argparse.ArgumentParser(description="how plainly the two packages are written")
    parser.add_argument("--traces", action="store_true", help="trace whole commands, too")
    parser.add_argument("--against", metavar="COMMIT", help="put this commit beside it")
    parser.add_argument("--record", action="store_true", help="write today's numbers and traces")
    options = parser.parse_args()
    traces = options.traces or options.record
    columns: dict[str, Figures] = {}
    if options.against:
        with tempfile.TemporaryDirectory() as scratch:
            unpack(options.against, Path(scratch))
            columns[options.against[:12]] = measure_all(Path(scratch), traces)
    text = RECORD.read_text(encoding="utf-8")
    columns["recorded"] = tomllib.loads(text).get("recorded", {})
    columns["now"] = measure_all(ROOT, traces)
    print_table(columns)
    if options.record:
        RECORD.write_text(with_numbers(text, columns["now"]), encoding="utf-8")


if __name__ == "__main__":
    main()
