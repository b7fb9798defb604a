"""How plainly a module is written: its density, names, statements and annotations."""

import ast
import io
import tokenize

from tests.house.sources import Function, Source

MOST_COLUMNS = 100
# Syntax nodes a code line that plain code holds at the most.
MOST_DENSITY = 10
INFERENCE = "ident/inference"
MOST_PARAMETERS = 6
# Pronouns that stood for values of the field; a name says what the value is.
VAGUE_NAMES = {"one", "found", "own", "at", "kept", "part"}
# Tokens that are no code.
SILENT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
NO_STATEMENTS = (*(ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef), ast.Import, ast.ImportFrom)
# Fields of a compound statement that hold further statements.
BODIES = ("body", "orelse", "finalbody", "handlers", "cases")
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


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


def statement_sizes(source: Source) -> list[int]:
    """Syntax nodes of each statement, the bodies of compound ones left out.

    However a statement is broken into lines, it has the same. Definitions, imports and docstrings
    are none.
    """
    sizes = []
    for node in source.nodes:
        if not isinstance(node, ast.stmt) or isinstance(node, NO_STATEMENTS):
            continue
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            sizes.append(statement_size(node))
    return sizes


def statement_size(statement: ast.stmt) -> int:
    """Syntax nodes of one statement without those of its bodies."""
    size = 1
    for field, value in ast.iter_fields(statement):
        values = value if isinstance(value, list) else [value]
        if field not in BODIES:
            nodes = [node for node in values if isinstance(node, ast.AST)]
            size += sum(len(list(ast.walk(node))) for node in nodes)
    return size


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


def annotations(source: Source) -> list[ast.expr]:
    """All annotations of parameters, results and names."""
    expressions: list[ast.expr] = []
    for node in source.nodes:
        given = node.returns if isinstance(node, Function) else getattr(node, "annotation", None)
        if given is not None:
            expressions.append(given)
    return expressions


def any_annotations(source: Source) -> int:
    """How often an annotation says `Any`."""
    count = 0
    for annotation in annotations(source):
        for node in ast.walk(annotation):
            count += isinstance(node, ast.Name) and node.id == "Any"
    return count


def names_twice(sources: list[Source]) -> dict[str, list[str]]:
    """Public classes whose name stands in more than one module."""
    places: dict[str, list[str]] = {}
    for source in sources:
        for node in source.tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(source.path))
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}
