"""Nothing is used that is not declared; a missing extra is one line that says what to install."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from ident.process import EXTRA_OF, missing_extra
from tests.layout import ROOT, Source, read_sources

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
KNOWN = packages_distributions()
# Packages whose name is not the one they are installed by, where no metadata says so.
INSTALLED_AS = {
    "pinocchio": "pin",
    "yaml": "pyyaml",
    "rerun": "rerun-sdk",
    "mujoco": "mujoco",
    "backports": "backports.zstd",
}
# Asked for by name where the user has them: neither is ours to install.
OPTIONAL = {"ompl", "robot_descriptions"}


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=~! ]", one)[0].lower().replace("_", "-") for one in requirements}


def outside(source: Source) -> set[str]:
    """Top names of other people's packages that a module imports; what only type checkers read is left out."""
    skipped = {
        inner
        for node in ast.walk(source.tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for line in node.body
        for inner in ast.walk(line)
    }
    found = set()
    for node in ast.walk(source.tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
    return found - {"ident", "plan"} - set(sys.stdlib_module_names)


def distribution(package: str) -> str:
    return INSTALLED_AS.get(package, KNOWN.get(package, [package])[0]).lower().replace("_", "-")


def test_everything_used_is_declared_in_the_core_or_in_the_extra_that_its_message_names() -> None:
    used = set().union(*map(outside, read_sources(ROOT))) - OPTIONAL
    core = names(PROJECT["dependencies"])
    undeclared = {
        package
        for package in used
        if distribution(package) not in (names(EXTRAS[EXTRA_OF[package]]) if package in EXTRA_OF else core)
    }
    assert not undeclared


def test_the_core_holds_nothing_that_an_extra_holds_and_all_holds_every_extra() -> None:
    groups = {*EXTRA_OF.values()}
    assert not {one for group in groups for one in names(EXTRAS[group])} & names(PROJECT["dependencies"])
    assert groups == {*re.findall(r"\w+", EXTRAS["all"][0].partition("[")[2])}


@pytest.mark.parametrize("package", ["torch", "rerun.blueprint"])
def test_a_missing_extra_is_one_line_with_what_to_install(package: str) -> None:
    error = ModuleNotFoundError(f"No module named {package!r}", name=package)
    seen = str(missing_extra(error))
    assert f"armgap[{EXTRA_OF[package.partition('.')[0]]}]" in seen
    assert "\n" not in seen


def test_another_missing_module_is_our_own_fault() -> None:
    assert missing_extra(ModuleNotFoundError("No module named 'ident.nothing'", name="ident.nothing")) is None
    assert missing_extra(ValueError("torch")) is None


def test_the_lock_file_holds_every_dependency() -> None:
    locked = names(Path(ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines())
    declared = names(PROJECT["dependencies"]).union(*(names(EXTRAS[group]) for group in [*EXTRA_OF.values(), "dev"]))
    assert declared - locked == set()
