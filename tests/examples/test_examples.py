"""What the README, the how-tos and the example scripts tell a reader to type does what they say."""

from __future__ import annotations

import html
import inspect
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import ident
import plan
from ident.cli import app as ident_app
from ident.robot.names import data_path
from plan.cli import app as plan_app
from tests.examples import find_and_patch_an_effect, panda_from_a_bag, plan_with_the_patched_model

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SNIPPETS = re.findall(
    r"^## … (.*?)\n.*?```python\n(.*?)```", (HERE / "README.md").read_text(), re.DOTALL | re.MULTILINE
)
PAGES = [ROOT / "README.md", ROOT / "logs" / "README.md", HERE / "README.md"]
COMMANDS = {"ident": ident_app.app, "plan": plan_app.app}
LONGEST_SCRIPT = 40


INLINE = re.compile(r"`((?:ident|plan) [a-z]+ [^`…]+)`")


def told_commands() -> list[str]:
    """Commands of ours on the pages: lines indented as code, without what is remarked behind them, and those within a

    sentence that say more than their name.
    """
    found = []
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            command = line.strip().partition("  #")[0].strip()
            if line.startswith("    ") and command.split(" ")[0] in COMMANDS and "…" not in command:
                found.append(command)
            found += INLINE.findall(line)
    return list(dict.fromkeys(found))


@pytest.mark.parametrize("command", told_commands())
def test_every_told_command_is_one_with_these_options(command: str) -> None:
    package, name, *arguments = shlex.split(command)
    group = typer.main.get_command(COMMANDS[package])
    chosen = group.commands[name]  # type: ignore[attr-defined]
    context = chosen.make_context(name, arguments)
    assert context.params


@pytest.mark.parametrize(("title", "snippet"), SNIPPETS, ids=[title for title, _ in SNIPPETS])
def test_snippets_of_the_how_tos_run(title: str, snippet: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(snippet, title, "exec"), {"__name__": title})


def test_readme_shows_python_that_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With recordings of the shipped arm in place of the reader's."""
    (snippet,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    one_run = sorted(data_path("logs/tm5_900/E1").glob("*.parquet"))[0]
    snippet = snippet.replace('"my_session"', repr(str(one_run))).replace('"my_arm.urdf"', '"tm5-900"')
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet, "README", "exec"), {"__name__": "readme"})


def test_scripts_are_short_enough_to_be_read() -> None:
    for script in HERE.glob("*.py"):
        if not script.name.startswith(("test_", "__", "write_")):
            assert len(script.read_text().splitlines()) <= LONGEST_SCRIPT


@pytest.mark.slow
def test_an_effect_is_found_and_patched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    find_and_patch_an_effect.main(tmp_path)
    assert "spring_torque" in capsys.readouterr().out
    assert (tmp_path / "patch" / "robot.urdf").is_file()
    assert (tmp_path / "patch.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_plan_on_the_patched_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan_with_the_patched_model.main(data_path("urdf/tm5_900.urdf"), tmp_path)
    assert capsys.readouterr().out.startswith("solved")
    assert (tmp_path / "plan.json").is_file()


@pytest.mark.real
@pytest.mark.slow
def test_a_panda_from_a_bag(real_data: Path, tmp_path: Path) -> None:
    panda_from_a_bag.main(real_data / "panda/unisa_fer/panda_exciting_trajectory.db3", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} >= {"model", "why.json", "why.png"}


@pytest.mark.slow
def test_the_reference_has_every_public_name_with_its_text(tmp_path: Path) -> None:
    """As `make api` writes it; in a process of its own, for it loads all names of both packages."""
    subprocess.run([sys.executable, HERE / "write_api.py", tmp_path], check=True, cwd=ROOT)
    for package in (ident, plan):
        page = (tmp_path / f"{package.__name__}.html").read_text(encoding="utf-8")
        for name in package.__all__:
            text = inspect.getdoc(getattr(package, name))
            assert f'id="{name}"' in page
            assert text is not None
            assert html.escape(text.split(".")[0].split("`")[0].split("\n")[0][:30], quote=False) in page
