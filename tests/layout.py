"""Measures how plainly the two packages are written, against the numbers of layout.toml.

    python tests/layout.py                      # the table
    python tests/layout.py --traces             # with the call traces of four whole commands
    python tests/layout.py --against COMMIT     # with the same of an earlier commit beside it
    python tests/layout.py --record             # writes today's numbers, whatever they are

A room is a package, or a module that stands alone, at the top of `ident` or `plan`. An arrow of the
layout is one room's import of another's; one of a trace is told in trace_command.py.
Nothing counts lines of code: code may grow where it becomes plainer.
"""

import argparse
import ast
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tokenize
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECORD = Path(__file__).with_suffix(".toml")
TRACER = Path(__file__).with_name("trace_command.py")
PACKAGES = ("ident", "plan")
# Commands that are traced, in the order in which one needs another.
TRACED = ("fit", "diagnose", "compare", "solve")
MOST_COLUMNS = 100
# Syntax nodes a code line that files of the inference should hold at the most.
MOST_DENSITY = 10
INFERENCE = "ident/inference"
MOST_PARAMETERS = 6
# Pronouns that stood for values of the field; a name says what the value is.
VAGUE_NAMES = {"one", "found", "own", "at", "kept", "part"}
# Where effects may be named: the laws, and the simulated arm that has laws of its own.
EFFECT_HOMES = ("ident/effects", "ident/laws", "ident/simulation")
EFFECT_BASE = Path("ident/effects/base.py")
EFFECT_ROWS = Path("ident/effects/effects.toml")
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
# Tokens that are no code.
SILENT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
Function = ast.FunctionDef | ast.AsyncFunctionDef
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
Figures = dict[str, float]


@dataclass(frozen=True)
class Source:
    """A module: where it is, its text, and what it says."""

    path: Path
    text: str
    tree: ast.Module
    room: str

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All that it says, walked once."""
        return list(ast.walk(self.tree))

    def functions(self) -> Iterator[Function]:
        return (node for node in self.nodes if isinstance(node, Function))

    def imports(self) -> Iterator[str]:
        """Dotted names that it imports."""
        for node in self.nodes:
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module
            elif isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)

    def constants(self) -> Iterator[tuple[ast.stmt, ast.expr]]:
        """Assignments of the module's constants, and what they are given."""
        for statement in self.tree.body:
            if isinstance(statement, ast.Assign):
                target = statement.targets[0]
            elif isinstance(statement, ast.AnnAssign):
                target = statement.target
            else:
                continue
            if not isinstance(target, ast.Name) or statement.value is None:
                continue
            if CONSTANT.fullmatch(target.id):
                yield statement, statement.value


@cache
def read_sources(folder: Path) -> list[Source]:
    """All modules of both packages."""
    sources = []
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            room = ".".join(parts[:2]) if parts[1:] != ("__init__",) else package
            text = path.read_text(encoding="utf-8")
            sources.append(Source(path.relative_to(folder), text, ast.parse(text), room))
    return sources


def docstring_lines(source: Source) -> set[int]:
    """Numbers of the lines that docstrings take."""
    lines: set[int] = set()
    for node in source.nodes:
        if not isinstance(node, ast.Module | ast.ClassDef | Function):
            continue
        if ast.get_docstring(node) is not None:
            text = node.body[0]
            lines.update(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return lines


def code_lines(source: Source) -> int:
    """Lines that hold code; blank lines, comments and docstrings are none."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source.text).readline):
        if token.type not in SILENT:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstring_lines(source))


def node_density(sources: list[Source]) -> float:
    """Syntax nodes a line of code."""
    nodes = sum(len(source.nodes) for source in sources)
    lines = sum(code_lines(source) for source in sources)
    return nodes / lines if lines else 0.0


def is_dense(source: Source) -> bool:
    """Whether a file of the inference has more nodes a line than it should."""
    return source.path.is_relative_to(INFERENCE) and node_density([source]) > MOST_DENSITY


def long_lines(source: Source) -> int:
    """Lines of more than `MOST_COLUMNS` characters."""
    return sum(len(line) > MOST_COLUMNS for line in source.text.splitlines())


def vague_names(source: Source) -> int:
    """Bindings of a name that does not say what the value is."""
    count = 0
    for node in source.nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            count += node.id in VAGUE_NAMES
        elif isinstance(node, ast.arg):
            count += node.arg in VAGUE_NAMES
    return count


def parallel_assignments(source: Source) -> int:
    """Assignments of several written-out values in one statement; a swap is none."""
    count = 0
    for node in source.nodes:
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
            continue
        target = node.targets[0]
        if isinstance(target, ast.Tuple):
            given = {ast.unparse(value) for value in node.value.elts}
            count += given != {ast.unparse(name) for name in target.elts}
    return count


def nested_comprehensions(source: Source) -> int:
    """Comprehensions that stand inside another."""
    inner: set[ast.AST] = set()
    for node in source.nodes:
        if isinstance(node, Comprehension):
            inside = (other for other in ast.walk(node) if other is not node)
            inner.update(other for other in inside if isinstance(other, Comprehension))
    return len(inner)


def parameters(function: Function) -> int:
    """How many a caller may give, the object itself not counted."""
    given = function.args
    names = [argument.arg for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return sum(name not in ("self", "cls") for name in names)


def wide_functions(source: Source) -> int:
    """Functions of more than `MOST_PARAMETERS` parameters."""
    return sum(parameters(function) > MOST_PARAMETERS for function in source.functions())


def has_late_constants(source: Source) -> bool:
    """Whether a constant of the module stands below its first function or method."""
    first = min((function.lineno for function in source.functions()), default=None)
    if first is None:
        return False
    return any(statement.lineno > first for statement, _ in source.constants())


def any_annotations(source: Source) -> int:
    """How often an annotation says `Any`."""
    annotations: list[ast.expr] = []
    for node in source.nodes:
        given = node.returns if isinstance(node, Function) else getattr(node, "annotation", None)
        if given is not None:
            annotations.append(given)
    count = 0
    for annotation in annotations:
        for node in ast.walk(annotation):
            count += isinstance(node, ast.Name) and node.id == "Any"
    return count


def effect_body(sources: list[Source]) -> list[ast.stmt]:
    """Statements of the class `Effect`."""
    for source in sources:
        if source.path == EFFECT_BASE:
            for node in source.tree.body:
                if isinstance(node, ast.ClassDef) and node.name == "Effect":
                    return node.body
    raise LookupError(f"no class Effect in {EFFECT_BASE}: say in tests/layout.py where it is now")


def effect_ids(folder: Path) -> set[str]:
    """Ids of the effects, as their rows give them."""
    return set(tomllib.loads((folder / EFFECT_ROWS).read_text(encoding="utf-8"))["effects"])


def effect_classes(sources: list[Source]) -> set[str]:
    """Names of the effects' classes; those that others derive from are none."""
    parents: dict[str, set[str]] = {}
    for source in sources:
        for node in source.nodes:
            if isinstance(node, ast.ClassDef):
                bases = {base.id for base in node.bases if isinstance(base, ast.Name)}
                parents.setdefault(node.name, set()).update(bases)
    family = {"Effect"}
    grown = True
    while grown:
        heirs = {name for name, bases in parents.items() if bases & family}
        grown = not heirs <= family
        family |= heirs
    inherited = set().union(*parents.values())
    return family - inherited


def is_effect_home(source: Source) -> bool:
    """Whether effects may be named in the module."""
    return any(source.path.is_relative_to(home) for home in EFFECT_HOMES)


def quoted_ids(source: Source, ids: set[str]) -> int:
    """How often a literal of the module is the id of an effect."""
    literals = (node.value for node in source.nodes if isinstance(node, ast.Constant))
    return sum(value in ids for value in literals if isinstance(value, str))


def named_classes(source: Source, classes: set[str]) -> int:
    """How often the module names one of the classes, imports included."""
    count = 0
    for node in source.nodes:
        if isinstance(node, ast.Name):
            count += node.id in classes
        elif isinstance(node, ast.Attribute):
            count += node.attr in classes
        elif isinstance(node, ast.ImportFrom):
            count += sum(alias.name in classes for alias in node.names)
    return count


def is_number(value: ast.expr) -> bool:
    """Whether an expression is made of numerals alone."""
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left) and is_number(value.right)
    if not isinstance(value, ast.Constant) or isinstance(value.value, bool):
        return False
    return isinstance(value.value, int | float)


def number_constants(source: Source) -> int:
    """Constants of the module that are numbers."""
    return sum(is_number(value) for _, value in source.constants())


def written_settings(source: Source) -> int:
    """Settings that a field gives in Python: `number(value, unit, meaning, source)`."""
    calls = (node for node in source.nodes if isinstance(node, ast.Call))
    named = (call for call in calls if isinstance(call.func, ast.Name))
    return sum(call.func.id == "number" and bool(call.args or call.keywords) for call in named)


def count_rows(table: dict[str, object]) -> int:
    """Rows with a value, in a table of settings and in those below it."""
    if "value" in table:
        return 1
    return sum(count_rows(entry) for entry in table.values() if isinstance(entry, dict))


def settings_rows(folder: Path) -> int:
    """Rows of all files of settings."""
    rows = 0
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("settings.toml")):
            rows += count_rows(tomllib.loads(path.read_text(encoding="utf-8")))
    return rows


def names_twice(sources: list[Source]) -> dict[str, list[str]]:
    """Public classes whose name stands in more than one module."""
    places: dict[str, list[str]] = {}
    for source in sources:
        for node in source.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(source.path))
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}


def arrows(sources: list[Source]) -> set[tuple[str, str]]:
    """Pairs of rooms of which the first imports the second.

    The doors of the packages, which offer all, are left out.
    """
    rooms = {source.room for source in sources} - set(PACKAGES)
    pairs = set()
    for source in sources:
        for name in source.imports():
            imported = ".".join(name.split(".")[:2])
            if imported != source.room and {imported, source.room} <= rooms:
                pairs.add((source.room, imported))
    return pairs


def depth(pairs: set[tuple[str, str]]) -> int:
    """Floors: rooms on the longest way down; 0 where the arrows run in a circle."""
    below: dict[str, set[str]] = {}
    for first, second in pairs:
        below.setdefault(first, set()).add(second)
        below.setdefault(second, set())
    floors: dict[str, int] = {}
    while len(floors) < len(below):
        waiting = [room for room in below if room not in floors]
        ready = [room for room in waiting if below[room] <= floors.keys()]
        if not ready:
            return 0
        for room in ready:
            floors[room] = 1 + max((floors[lower] for lower in below[room]), default=0)
    return max(floors.values(), default=0)


def total(count: Callable[[Source], int], sources: list[Source]) -> int:
    """A count over all modules."""
    return sum(map(count, sources))


def measure(folder: Path) -> Figures:
    """What the text of a working tree holds; names as in layout.toml."""
    sources = read_sources(folder)
    body = effect_body(sources)
    ids = effect_ids(folder)
    classes = effect_classes(sources)
    elsewhere = [source for source in sources if not is_effect_home(source)]
    named_uses = [named_classes(source, classes) for source in elsewhere]
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "nodes_per_code_line": round(node_density(sources), 2),
        "files_of_inference_over_10_nodes": total(is_dense, sources),
        "lines_over_100_columns": total(long_lines, sources),
        "bindings_of_vague_names": total(vague_names, sources),
        "parallel_assignments": total(parallel_assignments, sources),
        "nested_comprehensions": total(nested_comprehensions, sources),
        "functions_of_more_than_six_parameters": total(wide_functions, sources),
        "files_with_constants_below_a_function": total(has_late_constants, sources),
        "any_annotations": total(any_annotations, sources),
        "attributes_of_effect": sum(isinstance(line, ast.AnnAssign | ast.Assign) for line in body),
        "methods_of_effect": sum(isinstance(line, Function) for line in body),
        "effect_ids_quoted_elsewhere": sum(quoted_ids(source, ids) for source in elsewhere),
        "effect_classes_named_elsewhere": sum(named_uses),
        "settings_that_decide": settings_rows(folder) + total(written_settings, sources),
        "number_constants": total(number_constants, sources),
        "public_class_names_given_twice": len(names_twice(sources)),
        "floors_of_rooms": depth(arrows(sources)),
        "mandatory_dependencies": len(project["dependencies"]),
    }


def trace(folder: Path, *arguments: object) -> dict[str, int]:
    """Files entered and file-to-file arrows of one whole command, in a process of its own."""
    given = list(map(str, arguments))
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "trace.json"
        done = subprocess.run(
            [sys.executable, str(TRACER), str(folder), str(out), *given],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
        if not out.is_file():
            raise RuntimeError(f"{' '.join(given)} ended early: {done.stderr[-2000:]}")
        counts: dict[str, int] = json.loads(out.read_text(encoding="utf-8"))
    status = counts.pop("status")
    if status:
        raise RuntimeError(f"{' '.join(given)}: status {status}")
    return counts


def measure_traces(folder: Path, names: Sequence[str] = TRACED) -> Figures:
    """Traces of a fit without a net, a diagnosis, a comparison and a plan, on shipped recordings.

    Args:
        folder: A working tree.
        names: Those of `TRACED` that are wanted; a plan needs the fit's model.
    """
    logs = folder / "logs" / "tm5_900"
    scene = folder / "tests" / "plan" / "data" / "obstacle.toml"
    robot = ("--robot", "tm5-900")
    with tempfile.TemporaryDirectory() as scratch:
        model = Path(scratch) / "model"
        fit = ("ident", "fit", logs / "T1", logs / "T2", *robot, "--net", "none", "--out", model)
        commands = {
            "fit": fit,
            "diagnose": ("ident", "diagnose", logs / "sealed_1", *robot),
            "compare": ("ident", "compare", logs / "E1", logs / "E2", *robot),
            "solve": ("plan", "solve", scene, "--model", model, "--seconds", 60),
        }
        traces = {name: trace(folder, *commands[name]) for name in names}
    figures = {}
    for name, counts in traces.items():
        for unit, number in counts.items():
            figures[f"{unit}_of_{name}"] = number
    return figures


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
