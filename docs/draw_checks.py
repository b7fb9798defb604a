"""Writes docs/checks.md: the order of the telemetry checks, read from the code that calls them.

    python docs/draw_checks.py

Every function of `ident.checks` that `inspect_alone` calls stands there once, where it is called first, with what its
docstring says of it.
"""

import ast
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
OUT = HERE / "checks.md"
MODULE = "ident.checks.inspection"
PACKAGE = "ident.checks."
# Where the order starts; functions of its own module that it calls are read in their place.
DOOR = "inspect_alone"
HEAD = """# The order of the telemetry checks

Each check sees the rows and columns that the ones above it left standing, and what it condemns or mends is gone for
those below. Log and URDF are read by one search over their conventions before anything is held against the model; the
torque is judged last. This page is written by `python docs/draw_checks.py` from the calls in
`ident/checks/inspection.py`.
"""


def read_module(module: str) -> ast.Module:
    """The syntax tree of a module of ours."""
    folder = ROOT.joinpath(*module.split("."))
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    return ast.parse(path.read_text(encoding="utf-8"))


def functions_of(module: str) -> dict[str, ast.FunctionDef]:
    """A module's functions by name."""
    body = read_module(module).body
    return {statement.name: statement for statement in body if isinstance(statement, ast.FunctionDef)}


def imported_checks() -> dict[str, str]:
    """Module of each function of the checks that the order is made of."""
    modules = {}
    for statement in read_module(MODULE).body:
        if isinstance(statement, ast.ImportFrom) and (statement.module or "").startswith(PACKAGE):
            known = functions_of(statement.module or "")
            modules.update({alias.name: statement.module or "" for alias in statement.names if alias.name in known})
    return modules


def first_sentence(module: str, name: str) -> str:
    """What a function says of itself first."""
    words = " ".join((ast.get_docstring(functions_of(module)[name]) or "").split())
    return words.partition(". ")[0].rstrip(".")


def names_in_order(function: ast.FunctionDef) -> list[str]:
    """Names that a function uses, in the order of its lines."""
    names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
    names.sort(key=lambda node: (node.lineno, node.col_offset))
    return [node.id for node in names]


def read_order(door: str = DOOR) -> list[tuple[str, str]]:
    """Module and name of each check, in the order in which they are asked."""
    modules, inside = imported_checks(), functions_of(MODULE)
    order: dict[str, str] = {}
    for name in names_in_order(inside[door]):
        if name in modules:
            order.setdefault(name, modules[name])
        elif name in inside and name != door:
            for module, check in read_order(name):
                order.setdefault(check, module)
    return [(module, name) for name, module in order.items()]


def draw() -> str:
    """The page."""
    lines = [HEAD]
    for number, (module, name) in enumerate(read_order(), start=1):
        file = module.removeprefix(PACKAGE).replace(".", "/")
        lines.append(f"{number}. `{name}` ({file}): {first_sentence(module, name)}.")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    OUT.write_text(draw(), encoding="utf-8")
