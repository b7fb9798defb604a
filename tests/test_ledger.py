"""The ledger of promises: each line names tests that are there, and each library of ours has its line."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs/security.md").read_text(encoding="utf-8")
LIBRARIES, PROMISES = "## What libraries read by themselves", "## Promises, and the tests that hold them"
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")
# Libraries of ours that read no settings: each was looked at among the traps, by watched files and traced calls.
SILENT = ("tomli-w", "jinja2", "markupsafe", "filterpy", "lz4", "backports.zstd", "PyYAML", "daqp", "toppra", "plyfile")
SILENT += ("pypcd4", "ruckig", "typing_extensions", "armgap")
CALLED = {"distributed": "Dask", "rerun-sdk": "Rerun", "onnxruntime": "ONNX Runtime", "cma": "pycma"}
CALLED |= {"pin": "Pinocchio"}


def rows(title: str) -> list[list[str]]:
    """The cells of a section's table, its head left out."""
    section = TEXT.partition(title)[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@pytest.mark.parametrize("promise", rows(PROMISES), ids=lambda row: row[0][:40])
def test_each_promise_names_tests_that_are_there(promise: list[str]) -> None:
    tests = TEST.findall(promise[-1])
    assert tests, promise
    for file, name in tests:
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, (file, name)


def test_each_library_says_from_where_it_reads_and_what_stops_it() -> None:
    told = rows(LIBRARIES)
    assert all(len(row) == 4 and all(row) for row in told)
    names = " ".join(row[0] for row in told).lower()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    used = list(project["dependencies"])
    for extra in ("net", "sim", "view", "bags", "plan", "open", "onnx", "usd", "monitor"):
        used += project["optional-dependencies"][extra]
    for requirement in used:
        name = re.split(r"[\[<>=!~ ]", requirement)[0]
        assert name in SILENT or CALLED.get(name, name).lower() in names, name


def test_each_limit_of_the_front_page_has_its_line() -> None:
    """Law: a limit that README gains asks for a line of the ledger."""
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    section = front.partition("\n## Limits\n")[2].partition("\n## ")[0]
    limits = [line for line in section.splitlines() if line.startswith("- ")]
    lines = [row for row in rows(PROMISES) if "(README, Limits)" in row[0]]
    assert len(lines) >= len(limits) > 0


def test_each_shipped_recording_is_described() -> None:
    """Law: `logs/README.md` names every folder beside it, and says that they are simulated."""
    logs = ROOT / "logs"
    text = (logs / "README.md").read_text(encoding="utf-8")
    assert "simulated" in text.lower()
    names = [path.name for path in (logs / "tm5_900").iterdir() if path.is_dir()]
    assert names
    for name in names:
        assert f"`{name}`" in text or f"/{name}`" in text, name
