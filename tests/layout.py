"""Measures the two packages against the budget of layout.toml: lines by part, call traces, sizes, names, dependencies.

    python tests/layout.py              # the table
    python tests/layout.py --traces     # with the files and arrows of three whole commands (half a minute)
    python tests/layout.py --record     # also lowers what layout.toml allows to what was measured

A room is a package, or a module that stands alone, at the top of `ident` or `plan`; an arrow of the layout is one
room's import of another's, an arrow of a trace one file's call into another file, or its first import of it.
"""

import ast
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from statistics import quantiles

ROOT = Path(__file__).parents[1]
BUDGET = Path(__file__).with_suffix(".toml")
PACKAGES = ("ident", "plan")
MOST_PARAMETERS = 6
Function = ast.FunctionDef | ast.AsyncFunctionDef

# A command under a profiler that notes which of our files run, and which of them asks which: by a call or by an import.
# The clock of its progress stands still: how often that is told depends on the machine's load.
TRACED = """
import json, sys, time
sys.path.insert(0, {root!r})
from importlib import import_module
from pathlib import Path
from threading import setprofile
PLACES = tuple({root!r} + "/" + name for name in ("ident/", "plan/"))
files, arrows, codes = set(), set(), {{}}

def ours(code):
    if code not in codes:
        codes[code] = code.co_filename if code.co_filename.startswith(PLACES) else None
    return codes[code]

def note(frame, event, argument):
    if event == "call" and (file := ours(frame.f_code)):
        files.add(file)
        caller = frame.f_back
        while caller is not None and not ours(caller.f_code):
            caller = caller.f_back
        if caller is not None and ours(caller.f_code) != file:
            arrows.add((ours(caller.f_code), file))

sys.argv = {arguments!r}
time.monotonic = lambda: 0.0
setprofile(note)
sys.setprofile(note)
app = import_module({module!r} + ".cli.app").app
status = app(standalone_mode=False)
sys.setprofile(None)
Path({out!r}).write_text(json.dumps([len(files), len(arrows), status or 0]))
"""


@dataclass(frozen=True)
class Source:
    """A module: where it is, its text, and what it says."""

    path: Path
    text: str
    tree: ast.Module
    room: str

    @property
    def lines(self) -> int:
        return len(self.text.splitlines())

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


@cache
def read_sources(folder: Path) -> list[Source]:
    """All modules of both packages."""
    found = []
    for package in PACKAGES:
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            room = ".".join(parts[:2]) if parts[1:] != ("__init__",) else package
            text = path.read_text(encoding="utf-8")
            found.append(Source(path.relative_to(folder), text, ast.parse(text), room))
    return found


def arrows(sources: list[Source]) -> set[tuple[str, str]]:
    """Pairs of rooms of which the first imports the second; the doors of the packages, which offer all, left out."""
    rooms = {one.room for one in sources} - set(PACKAGES)
    pairs = {(one.room, ".".join(name.split(".")[:2])) for one in sources for name in one.imports()}
    return {(first, second) for first, second in pairs if first != second and {first, second} <= rooms}


def depth(pairs: set[tuple[str, str]]) -> int:
    """Floors: rooms on the longest way down; 0 where the arrows run in a circle."""
    below: dict[str, set[str]] = {room: set() for pair in pairs for room in pair}
    for first, second in pairs:
        below[first].add(second)
    floors: dict[str, int] = {}
    while len(floors) < len(below):
        ready = [room for room, under in below.items() if room not in floors and under <= floors.keys()]
        if not ready:
            return 0
        floors.update({room: 1 + max((floors[one] for one in below[room]), default=0) for room in ready})
    return max(floors.values(), default=0)


def body_lines(function: Function) -> int:
    """Lines of a function's body without its docstring."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return 1 + (body[-1].end_lineno or 0) - body[0].lineno if body else 0


def parameters(function: Function) -> int:
    """How many a caller may give, the object itself not counted."""
    given = function.args
    named = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return sum(name not in ("self", "cls") for name in named)


def is_annotated(function: Function) -> bool:
    """Whether the result and every argument but self have a type."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return function.returns is not None and all(one.annotation or one.arg in ("self", "cls") for one in named)


def called_once(source: Source) -> list[str]:
    """Private functions, methods left out, whose name the module uses a single time."""
    private = [one.name for one in source.tree.body if isinstance(one, Function) and re.match(r"_[^_]", one.name)]
    used: Counter[str] = Counter()
    for node in source.nodes:
        if isinstance(node, ast.Name | ast.Attribute):
            used[node.id if isinstance(node, ast.Name) else node.attr] += 1
    return [name for name in private if used[name] == 1]


def docstrings(source: Source) -> Iterator[ast.Constant]:
    """The text of every docstring."""
    for node in source.nodes:
        if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node) is not None:
            assert isinstance(node.body[0], ast.Expr)
            assert isinstance(node.body[0].value, ast.Constant)
            yield node.body[0].value


def explaining_lines(source: Source) -> int:
    """Lines of docstrings, and lines that hold a comment alone."""
    inside = sum(1 + (one.end_lineno or 0) - one.lineno for one in docstrings(source))
    return inside + len(re.findall(r"(?m)^ *#", source.text))


def quoted_ids(source: Source, ids: frozenset[str]) -> int:
    """How often a literal of the module is the id of an effect."""
    literals = (node.value for node in source.nodes if isinstance(node, ast.Constant))
    return sum(value in ids for value in literals if isinstance(value, str))


def names_twice(sources: list[Source]) -> dict[str, list[str]]:
    """Public classes whose name stands in more than one module."""
    places: dict[str, list[str]] = {}
    for one in sources:
        for node in one.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(one.path))
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}


def part_of(path: Path, parts: dict[str, dict[str, object]]) -> str:
    """The part of the budget that a module belongs to: that of the longest of the prefixes."""
    fitting = [
        (len(prefix), name)
        for name, part in parts.items()
        for prefix in part["of"]  # type: ignore[attr-defined]
        if path.is_relative_to(prefix) or path.is_relative_to(f"{prefix}.py")
    ]
    return max(fitting)[1] if fitting else "unassigned"


def lines_by_part(sources: list[Source], budget: dict[str, dict[str, dict[str, object]]]) -> dict[str, int]:
    """Lines of every part of the budget, and of what belongs to none."""
    found = dict.fromkeys([*budget["parts"], "unassigned"], 0)
    for one in sources:
        found[part_of(one.path, budget["parts"])] += one.lines
    return found


def measure(folder: Path) -> dict[str, float]:
    """What the text of a working tree holds; names as in layout.toml."""
    budget = tomllib.loads(BUDGET.read_text(encoding="utf-8"))
    sources = read_sources(folder)
    functions = list(chain.from_iterable(one.functions() for one in sources))
    laws = tuple(budget["effects"]["homes"])
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = sum(one.lines for one in sources)
    ids = frozenset(budget["effects"]["ids"])
    return {
        "lines": lines,
        "lines_of_tests": sum(
            len(path.read_text(encoding="utf-8").splitlines()) for path in (folder / "tests").rglob("*.py")
        ),
        "lines_of_readme": len((folder / "README.md").read_text(encoding="utf-8").splitlines()),
        "lines_of_longest_file": max(one.lines for one in sources),
        "body_lines_p90": round(quantiles(map(body_lines, functions), n=10)[-1]),
        "explaining_share": round(sum(map(explaining_lines, sources)) / lines, 4),
        "annotated_share": round(sum(map(is_annotated, functions)) / len(functions), 4),
        "classes": sum(isinstance(node, ast.ClassDef) for one in sources for node in one.nodes),
        "functions_of_more_than_six_parameters": sum(parameters(one) > MOST_PARAMETERS for one in functions),
        "private_helpers_called_once": sum(len(called_once(one)) for one in sources),
        "effect_ids_quoted_elsewhere": sum(
            quoted_ids(one, ids) for one in sources if not str(one.path).startswith(laws)
        ),
        "mandatory_dependencies": len(project["dependencies"]),
    }


def trace(package: str, *arguments: object) -> dict[str, int]:
    """Files entered and file-to-file arrows of one whole command, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "trace.json"
        given = [package, *map(str, arguments)]
        script = TRACED.format(root=str(ROOT), module=package, arguments=given, out=str(out))
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
        if not out.is_file():
            raise RuntimeError(f"{' '.join(given)} ended early: {done.stderr[-2000:]}")
        files, pairs, status = json.loads(out.read_text())
    assert not status, f"{' '.join(given)}: status {status}"
    return {"files": files, "arrows": pairs}


def measure_traces() -> dict[str, int]:
    """The same of a diagnosis, a fit without a net and a plan, on the shipped recordings."""
    logs = ROOT / "logs" / "tm5_900"
    with tempfile.TemporaryDirectory() as folder:
        model, scene = Path(folder) / "model", ROOT / "tests" / "plan" / "data" / "obstacle.toml"
        fit = ("ident", "fit", logs / "T1", logs / "T2", "--robot", "tm5-900", "--net", "none", "--out", model)
        commands = {
            "fit": fit,
            "diagnose": ("ident", "diagnose", logs / "sealed_1", "--robot", "tm5-900"),
            "solve": ("plan", "solve", scene, "--model", model, "--seconds", 60),
        }
        found = {name: trace(*command) for name, command in commands.items()}
    return {f"{unit}_of_{name}": number for name, one in found.items() for unit, number in one.items()}


def lower(text: str, measured: dict[str, float]) -> str:
    """The budget's text with every number that fell put to what was measured, but not below its target."""

    def rewrite(line: re.Match[str]) -> str:
        name, now, target = line["name"].strip('"'), float(line["now"]), float(line["target"])
        return f"{line['head']}{min(now, max(measured.get(name, now), target)):g}, target = {line['target']}"

    number = r"[\d.]+"
    head = r'^(?P<head>(?P<name>"[^"\n]+"|\w+) *= *\{ *now *= *)'
    return re.sub(rf"(?m){head}(?P<now>{number}), target = (?P<target>{number})", rewrite, text)


def beyond(measured: dict[str, float], budget: dict[str, dict[str, dict[str, float]]]) -> list[str]:
    """What is beyond the budget, in words: shares may not fall below it, everything else may not pass it."""
    allowed = {**budget["parts"], **budget["figures"]}
    return [
        f"{name}: {number:g}, allowed {allowed[name]['now']:g}"
        for name, number in measured.items()
        if (number < allowed[name]["now"] if name.endswith("_share") else number > allowed[name]["now"])
    ]


def main(options: list[str]) -> None:
    """Prints the table; see the module."""
    text = BUDGET.read_text(encoding="utf-8")
    budget = tomllib.loads(text)
    sources = read_sources(ROOT)
    measured: dict[str, float] = {**lines_by_part(sources, budget), **measure(ROOT)}
    if "--traces" in options:
        measured |= measure_traces()
    print(f"{'':<52}{'now':>9}{'allowed':>9}{'target':>9}")
    for name, number in measured.items():
        allowed = {**budget["parts"], **budget["figures"]}.get(name, {"now": 0, "target": 0})
        print(f"{name:<52}{number:>9g}{allowed['now']:>9g}{allowed['target']:>9g}")
    print(f"{'floors of rooms':<52}{depth(arrows(sources)):>9}")
    if "--record" in options:
        BUDGET.write_text(lower(text, measured), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
