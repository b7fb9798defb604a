"""Our own evaluator of xacro's expressions: a whitelist over their syntax trees; Python's `eval`
never sees them.

Values are numbers, texts, truth values, None, and lists, tuples and tables of these. A dot looks up
a key of a table, never an attribute of an object; a call runs one of the functions below; every
intermediate value is bounded in size.
"""

from __future__ import annotations

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

# Longest expression; numbers of more bits, and texts and lists of more parts, are in no
# description.
LONGEST = 4096
MOST_BITS = 1024
MOST_PARTS = 20_000
# Nodes evaluated within one expression; deepest tree; largest exponent.
MOST_STEPS = 100_000
DEEPEST = 100
LARGEST_POWER = 16
# Digits that `round` keeps, before and after the point.
MOST_DIGITS = 300

Value = TypeVar("Value")
Lookup = Callable[[str], object]
Functions = Mapping[str, Callable[..., Any]]


class HarmfulExpression(Exception):
    """An expression or a file's name that no description of a robot needs."""


MATHEMATICS = (
    "acos asin atan atan2 ceil copysign cos cosh degrees exp fabs floor fmod hypot isfinite isnan "
    "log log10 log2 pow radians sin sinh sqrt tan tanh"
)
CONSTANTS: dict[str, float | bool] = {
    name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")
}
CONSTANTS |= {"true": True, "false": False}
# Names whose dotted members are the same functions and constants.
NAMESPACES = ("math", "python", "xacro")
# Signs of Python's syntax, and the functions of `operator` that work them out.
PLAIN = {
    "Add": "add",
    "Sub": "sub",
    "Div": "truediv",
    "FloorDiv": "floordiv",
    "UAdd": "pos",
    "USub": "neg",
    "Eq": "eq",
    "NotEq": "ne",
    "Lt": "lt",
    "LtE": "le",
    "Gt": "gt",
    "GtE": "ge",
    "Not": "not_",
    "Is": "is_",
    "IsNot": "is_not",
}


def require_plain(value: Value) -> Value:
    """Passes a value on if it is plain data of not too many parts all in all.

    Raises:
        HarmfulExpression: It is, or holds, an object of another kind, a number of too many digits,
            or too many parts.
    """
    left: list[object] = [value]
    count = 0
    while left:
        current = left.pop()
        count += len(current) if isinstance(current, str) else 1
        _require(count <= MOST_PARTS, "an expression grows beyond any description")
        _require(
            type(current) is not int or current.bit_length() <= MOST_BITS,
            "a number of too many digits",
        )
        if isinstance(current, dict):
            left += [*current.keys(), *current.values()][: MOST_PARTS + 1]
        elif isinstance(current, list | tuple) and type(current) in (list, tuple):
            left += current[: MOST_PARTS + 1]
        else:
            plain = type(current) in (int, float, str, bool, type(None))
            _require(plain, f"a value of the kind {type(current).__name__}")
    return value


def _require(fits: bool, what: str) -> bool:
    """True where something is as it must be.

    Raises:
        HarmfulExpression: It is not; says what.
    """
    if not fits:
        raise HarmfulExpression(what)
    return True


def _times(a: Any, b: Any) -> Any:
    for sequence, other in ((a, b), (b, a)):
        if isinstance(sequence, str | list | tuple):
            fits = isinstance(other, int) and len(sequence) * other <= MOST_PARTS
            _require(fits, "a text or list of too many parts")
    return a * b


def _power(a: Any, b: Any) -> Any:
    fits = isinstance(b, int | float) and abs(b) <= LARGEST_POWER
    return _require(fits, f"a power that is no number up to {LARGEST_POWER}") and a**b


def _tokenize(text: str, separators: str = ",; ", skip_empty: bool = True) -> list[str]:
    for separator in separators[1:]:
        text = text.replace(separator, separators[0])
    return [piece for piece in text.split(separators[0]) if piece or not skip_empty]


def _round(value: Any, digits: int = 0) -> Any:
    _require(abs(digits) <= MOST_DIGITS, "round to too many digits")
    return round(value, digits) if digits else round(value)


def _replace(text: str, old: str, new: str) -> str:
    _require(len(text) * (len(new) + 1) <= MOST_PARTS, "a text of too many parts")
    return text.replace(old, new)


# What a call may run. Each reaches nothing beyond its arguments, in time and memory that grow with
# their sizes.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in MATHEMATICS.split()},
    **{
        kind.__name__: kind
        for kind in (abs, all, any, bool, dict, float, int, len, list, max, min, sorted, str, tuple)
    },
    "enumerate": lambda values: [*enumerate(values)],
    "range": lambda *ends: (
        _require(len(range(*ends)) <= MOST_PARTS, "a range of too many parts") and [*range(*ends)]
    ),
    "reversed": lambda values: [*reversed(values)],
    "round": _round,
    "sum": lambda values: sum(values),
    "zip": lambda *lists: [*zip(*lists, strict=False)],
    "tokenize": _tokenize,
    "dotify": dict,
    "fatal": lambda *words: _require(
        False, "the description itself says: " + " ".join(map(str, words))
    ),
    **dict.fromkeys(("message", "warning", "error"), lambda *words: ""),
}
# Methods of texts and tables, by the kind of their object.
METHODS: dict[tuple[type, str], Callable[..., Any]] = {
    **{
        (str, name): getattr(str, name)
        for name in ("endswith", "lower", "split", "startswith", "strip", "upper")
    },
    (str, "replace"): _replace,
    (dict, "get"): dict.get,
    (dict, "items"): lambda table: [*table.items()],
    (dict, "keys"): lambda table: [*table],
    (dict, "values"): lambda table: [*table.values()],
}
OPERATORS: dict[type, Callable[..., Any]] = {
    **{getattr(ast, name): getattr(operator, function) for name, function in PLAIN.items()},
    ast.Mult: _times,
    ast.Mod: lambda a, b: (
        _require(isinstance(a, int | float), "% of a text: use str() and +") and a % b
    ),
    ast.Pow: _power,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}


def evaluate(
    text: str, lookup: Lookup, functions: Functions, check_time: Callable[[], None]
) -> Any:
    """The value of an expression.

    Args:
        text: The expression, without its `${` and `}`.
        lookup: The value of a property; raises KeyError for a name that is none.
        functions: Further functions that it may call, beside `FUNCTIONS`.
        check_time: Raises where the description has taken too long.

    Raises:
        HarmfulExpression: It holds what no description needs.
        SyntaxError: It is no expression.
    """
    _require(len(text) <= LONGEST, "an expression of too many characters")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tree = ast.parse(text.strip(), mode="eval")
    try:
        return _Evaluator(lookup, {**FUNCTIONS, **functions}, check_time).value(tree.body)
    except HarmfulExpression as error:
        raise HarmfulExpression(f"{error} in {text.strip()[:80]!r}") from None


class _Evaluator(ast.NodeVisitor):
    """Walks down one syntax tree; holds the variable of its comprehension, its depth and
    its steps.
    """

    def __init__(
        self, lookup: Lookup, functions: Functions, check_time: Callable[[], None]
    ) -> None:
        self.lookup = lookup
        self.functions = functions
        self.check_time = check_time
        self.local: dict[str, object] = {}
        self.depth = self.steps = 0

    def value(self, node: ast.AST) -> Any:
        """What a part of an expression's syntax tree comes to: a number, text, list or table.

        Raises:
            HarmfulExpression: It nests or works longer than a description may, or is no plain
                value.
        """
        self.depth = self.depth + 1
        self.steps = self.steps + 1
        _require(self.depth <= DEEPEST and self.steps <= MOST_STEPS, "too many steps")
        self.check_time()
        result = require_plain(self.visit(node))
        self.depth -= 1
        return result

    def generic_visit(self, node: ast.AST) -> object:
        raise HarmfulExpression(f"{type(node).__name__} has no place")

    def visit_Constant(self, node: ast.Constant) -> object:
        return node.value

    def visit_Name(self, node: ast.Name) -> object:
        if node.id in self.local:
            return self.local[node.id]
        try:
            return self.lookup(node.id)
        except KeyError:
            if node.id in CONSTANTS:
                return CONSTANTS[node.id]
            raise HarmfulExpression(f"no property {node.id!r}") from None

    def visit_Attribute(self, node: ast.Attribute) -> object:
        """`table.key`, `namespace.property`, `math.pi`."""
        names = _names(node)
        if names[0] not in self.local:
            try:
                return self.lookup(".".join(names))
            except KeyError:
                if len(names) == 2 and names[0] in NAMESPACES and names[1] in CONSTANTS:
                    return CONSTANTS[names[1]]
        table = self.value(node.value)
        _require(isinstance(table, dict) and node.attr in table, f"no key {node.attr!r}")
        return table[node.attr]

    def visit_Call(self, node: ast.Call) -> object:
        given = [self.value(argument) for argument in node.args]
        _require(all(keyword.arg is not None for keyword in node.keywords), "** has no place")
        keywords = {str(keyword.arg): self.value(keyword.value) for keyword in node.keywords}
        names = _names(node.func)
        if len(names) == 1 or (len(names) == 2 and names[0] in NAMESPACES):
            known = names[-1] in self.functions and (not keywords or names[-1] == "dict")
            _require(known, f"a call of {names[-1]!r} has no place")
            return self.functions[names[-1]](*given, **keywords)
        if not isinstance(node.func, ast.Attribute) or keywords:
            raise HarmfulExpression("a call of a value has no place")
        owner = self.value(node.func.value)
        method = dict if isinstance(owner, dict) else type(owner), node.func.attr
        _require(method in METHODS, f"a call of {node.func.attr!r} has no place")
        return METHODS[method](owner, *given)

    def visit_Subscript(self, node: ast.Subscript) -> object:
        owner = self.value(node.value)
        if not isinstance(node.slice, ast.Slice):
            return owner[self.value(node.slice)]
        ends = (node.slice.lower, node.slice.upper, node.slice.step)
        return owner[slice(*(None if end is None else self.value(end) for end in ends))]

    def visit_BinOp(self, node: ast.BinOp) -> object:
        return self.operator(node.op)(self.value(node.left), self.value(node.right))

    def visit_UnaryOp(self, node: ast.UnaryOp) -> object:
        return self.operator(node.op)(self.value(node.operand))

    def visit_Compare(self, node: ast.Compare) -> object:
        left = self.value(node.left)
        result: object = True
        for sign, other in zip(node.ops, node.comparators, strict=True):
            right = self.value(other)
            result = self.operator(sign)(left, right)
            if not result:
                break
            left = right
        return result

    def operator(self, sign: ast.AST) -> Callable[..., Any]:
        _require(type(sign) in OPERATORS, f"{type(sign).__name__} has no place")
        return OPERATORS[type(sign)]

    def visit_BoolOp(self, node: ast.BoolOp) -> object:
        result: object = None
        for operand in node.values:
            result = self.value(operand)
            if bool(result) is isinstance(node.op, ast.Or):
                break
        return result

    def visit_IfExp(self, node: ast.IfExp) -> object:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def visit_List(self, node: ast.List | ast.Tuple) -> object:
        elements = [self.value(element) for element in node.elts]
        return elements if isinstance(node, ast.List) else tuple(elements)

    visit_Tuple = visit_List

    def visit_Dict(self, node: ast.Dict) -> object:
        _require(None not in node.keys, "** has no place")
        return {
            self.value(key): self.value(entry)
            for key, entry in zip(node.keys, node.values, strict=True)
            if key
        }

    def visit_JoinedStr(self, node: ast.JoinedStr) -> object:
        inner = [value for value in node.values if isinstance(value, ast.FormattedValue)]
        _require(
            not any(field.format_spec or field.conversion >= 0 for field in inner),
            "a format: use round()",
        )
        parts = [
            piece.value if isinstance(piece, ast.FormattedValue) else piece for piece in node.values
        ]
        return "".join(str(self.value(piece)) for piece in parts)

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp) -> object:
        """One loop over a list, worked out here: no frame, no generator."""
        loop = node.generators[0]
        if (
            len(node.generators) > 1
            or loop.is_async
            or not isinstance(loop.target, ast.Name)
            or self.local
        ):
            raise HarmfulExpression("more than one loop")
        elements = []
        for item in self.value(loop.iter):
            self.local = {loop.target.id: item}
            if all(self.value(test) for test in loop.ifs):
                elements.append(self.value(node.elt))
        self.local = {}
        return elements

    visit_GeneratorExp = visit_ListComp


def _names(node: ast.AST) -> list[str]:
    """`a.b.c` as its names; ["", …] where its root is no name."""
    tail: list[str] = []
    while isinstance(node, ast.Attribute):
        tail = [node.attr, *tail]
        node = node.value
    return [node.id if isinstance(node, ast.Name) else "", *tail]
