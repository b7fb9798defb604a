"""How plainly packages are written, one beside the other, whatever their size.

    python -m tests.house.beside ident plan pink=/path/to/pink httpx=/path/to/httpx
    python -m tests.house.beside --columns 88 ident plan sklearn=/path/to/sklearn

Every package is a folder, with a name before it or the folder's own. Counts are per thousand lines
of code, so that a large package stands beside a small one. Wide lines hold more: with `--columns`
all packages are formatted alike, in a copy, before they are counted.
"""

import argparse
import ast
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

from tests.house import plainness
from tests.house.sources import Source, total

# Syntax nodes of a statement that is hard to take in at once.
LARGE = 40
Count = Callable[[Source], int]
PER_THOUSAND: dict[str, Count] = {
    "lines over 100 columns": plainness.long_lines,
    "bindings of vague names": plainness.vague_names,
    "parallel assignments": plainness.parallel_assignments,
    "nested comprehensions": plainness.nested_comprehensions,
    "functions of more than six parameters": plainness.wide_functions,
    "files with constants below a function": plainness.has_late_constants,
    "`Any` in annotations": plainness.any_annotations,
}


def read_package(folder: Path) -> list[Source]:
    """The modules of a package, its tests left out."""
    sources = []
    for path in sorted(folder.rglob("*.py")):
        if "tests" in path.relative_to(folder).parts:
            continue
        text = path.read_text(encoding="utf-8")
        sources.append(Source(path.relative_to(folder), text, ast.parse(text), folder.name))
    return sources


def density_without_annotations(sources: list[Source]) -> float:
    """Syntax nodes a line of code, annotations left out: shapes in types are no steps."""
    nodes = 0
    for source in sources:
        nodes += len(source.nodes)
        for annotation in plainness.annotations(source):
            nodes -= sum(1 for _ in ast.walk(annotation))
    return nodes / total(plainness.code_lines, sources)


def format_alike(folder: Path, columns: int, scratch: Path) -> Path:
    """A copy of a package, formatted in so many columns."""
    copy = copytree(folder, scratch / folder.name)
    command = [sys.executable, "-m", "ruff", "format", "--quiet", "--isolated"]
    subprocess.run([*command, f"--line-length={columns}", str(copy)], check=True)
    return copy


def longest_function(source: Source) -> int:
    """Lines of the longest function of a module."""
    lengths = [(node.end_lineno or 0) - node.lineno + 1 for node in source.functions()]
    return max(lengths, default=0)


def figures_of(folder: Path) -> dict[str, float]:
    """The figures of a package."""
    sources = read_package(folder)
    lines = total(plainness.code_lines, sources)
    sizes = [size for source in sources for size in plainness.statement_sizes(source)]
    figures: dict[str, float] = {
        "lines of code": lines,
        "nodes a code line": round(plainness.node_density(sources), 1),
        "the same without annotations": round(density_without_annotations(sources), 1),
    }
    figures["nodes a statement"] = round(sum(sizes) / len(sizes), 1)
    large = sum(size > LARGE for size in sizes)
    figures["statements of more than 40, per thousand"] = round(1000.0 * large / len(sizes), 1)
    for name, count in PER_THOUSAND.items():
        figures[name] = round(1000.0 * total(count, sources) / lines, 1)
    figures["lines of the longest function"] = max(map(longest_function, sources))
    return figures


def main() -> None:
    """Prints one row a figure, one column a package."""
    parser = argparse.ArgumentParser(description="how plainly packages are written")
    parser.add_argument("packages", nargs="+", metavar="[NAME=]FOLDER")
    parser.add_argument("--columns", type=int, help="format all in so many columns first")
    options = parser.parse_args()
    columns: dict[str, dict[str, float]] = {}
    for package in options.packages:
        name, _, place = package.rpartition("=")
        folder = Path(place)
        with tempfile.TemporaryDirectory() as scratch:
            if options.columns:
                folder = format_alike(folder, options.columns, Path(scratch))
            columns[name or folder.name] = figures_of(folder)
    print(f"{'':<40}" + "".join(f"{title:>13}" for title in columns))
    for row in next(iter(columns.values())):
        cells = "".join(f"{figures[row]:>13g}" for figures in columns.values())
        print(f"{row:<40}{cells}")


if __name__ == "__main__":
    main()
