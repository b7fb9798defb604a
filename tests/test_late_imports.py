"""No module of ours is imported upwards by a string, but for three that are lawful.

Imports inside functions are no secret: import-linter counts them as any other. An import by a
string it does not see.
"""

import ast
import tomllib
from collections.abc import Iterator

import pytest

from tests.house.sources import ROOT, Source, read_sources

# What may be reached by a string from below, from which rooms, and why it is lawful.
LAWFUL = {
    # A result prints and draws itself; the libraries for it are loaded when it is asked to.
    "show": {
        "ident.results",
        "ident.diagnosis",
        "plan.experiment",
        "plan.problem",
        "plan.solving",
    },
    # A diagnosis writes its own patch: `Diagnosis.patch`.
    "api": {"ident.diagnosis"},
    # A command's start brings up its app once the process is made safe.
    "cli": {"ident.process"},
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LINTER = PROJECT["tool"]["importlinter"]


def floors(package: str) -> dict[str, int]:
    """The floor of each room of a package, from the top, as import-linter has them."""
    (contract,) = (
        contract
        for contract in LINTER["contracts"]
        if contract["id"] in ("layers", "plan-layers") and contract["containers"] == [package]
    )
    levels = {}
    for floor, row in enumerate(contract["layers"]):
        for room in row.replace(":", "|").split("|"):
            levels[f"{package}.{room.strip(' ()')}"] = floor
    return levels


FLOORS = floors("ident") | floors("plan")
LOWEST = max(FLOORS.values()) + 1


def text_of(node: ast.expr) -> str:
    """A string, or what an f-string begins with."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr) and node.values:
        return text_of(node.values[0])
    return ""


def imported_by_string(source: Source) -> Iterator[str]:
    """Modules that a module imports by a string, or names for others to import so."""
    for node in source.nodes:
        if isinstance(node, ast.Call) and node.args:
            called = node.func
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            if name == "import_module":
                yield text_of(node.args[0])
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if getattr(target, "id", "") == "SHOWN_BY" and node.value is not None:
                yield text_of(node.value)


def is_upward(source: Source, module: str) -> bool:
    """Whether a module stands above the one that imports it; what is in no layer is lowest."""
    room = ".".join(module.split(".")[:2])
    if room not in FLOORS or room == source.room:
        return False
    return FLOORS[room] < FLOORS.get(source.room, LOWEST)


def upward(sources: list[Source]) -> set[tuple[str, str]]:
    """Rooms that import one above them by a string, and the latter's name."""
    pairs = set()
    for source in sources:
        for module in imported_by_string(source):
            if is_upward(source, module):
                pairs.add((source.room, module.split(".")[1]))
    return pairs


def test_no_import_by_a_string_goes_up_but_for_the_lawful_ones() -> None:
    found = upward(read_sources(ROOT))
    unlawful = [(room, above) for room, above in found if room not in LAWFUL.get(above, ())]
    assert not unlawful, "import it plainly, from below; or list it here and say why"


@pytest.mark.parametrize("above", ["show", "api"])
def test_what_is_lawful_is_made_use_of(above: str) -> None:
    """Law: the list holds no more than there is."""
    used = {room for room, name in upward(read_sources(ROOT)) if name == above}
    assert used == LAWFUL[above]


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ('import_module("ident.api.fitting")', 1),
        ('importlib.import_module(f"ident.show.{name}")', 1),
        ('class Sum:\n    SHOWN_BY = "ident.show.results"', 1),
        ('import_module("ident.robot.arm")', 0),
        ('import_module("torch")', 0),
    ],
)
def test_an_import_by_a_string_is_seen(text: str, count: int) -> None:
    path = ROOT / "ident" / "model" / "here.py"
    source = Source(path.relative_to(ROOT), text, ast.parse(text), "ident.model")
    assert len(upward([source])) == count
