"""What the README, the documentation and the example scripts show a reader does what they say."""

import base64
import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from docs import write
from docs.run_notebook import run_cell
from examples import find_and_patch_an_effect, panda_from_a_bag, plan_with_the_patched_model
from ident.cli import app as ident_app
from ident.robot.names import data_path
from plan.cli import app as plan_app

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").glob("*.md"))
SNIPPETS = [
    (f"{page.stem} {number}", snippet)
    for page in DOCS
    for number, snippet in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
]
PAGES = [ROOT / "README.md", ROOT / "logs" / "README.md", *DOCS]
COMMANDS = {"ident": ident_app.app, "plan": plan_app.app}
LONGEST_SCRIPT = 40


INLINE = re.compile(r"`((?:ident|plan) [a-z]+ [^`…]+)`")


def shown_commands() -> list[str]:
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


@pytest.mark.parametrize("command", shown_commands())
def test_every_shown_command_is_one_with_these_options(command: str) -> None:
    package, name, *arguments = shlex.split(command)
    group = typer.main.get_command(COMMANDS[package])
    chosen = group.commands[name]  # type: ignore[attr-defined]
    context = chosen.make_context(name, arguments)
    assert context.params


@pytest.mark.parametrize(("title", "snippet"), SNIPPETS, ids=[title for title, _ in SNIPPETS])
def test_snippets_of_the_documentation_run(title: str, snippet: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(snippet, title, "exec"), {"__name__": title})


def test_readme_shows_python_that_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With recordings of the shipped arm in place of the reader's."""
    snippet = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[-1]
    one_run = sorted(data_path("logs/tm5_900/E1").glob("*.parquet"))[0]
    snippet = snippet.replace('"my_session"', repr(str(one_run))).replace('"my_arm.urdf"', '"tm5-900"')
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet, "README", "exec"), {"__name__": "readme"})


def test_scripts_are_short_enough_to_be_read() -> None:
    for script in (ROOT / "examples").glob("*.py"):
        assert len(script.read_text().splitlines()) <= LONGEST_SCRIPT


def test_every_figure_on_a_page_is_that_of_the_data_file() -> None:
    assert write.main(["--check"]) == 0


def test_the_front_page_is_short_and_shows_few_numbers() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    sure = text.partition("## How sure")[2].partition("\n## ")[0]
    plain = re.sub(r"`[^`]*`|commit \w+|\d{4}-\d\d-\d\d|Seed \d+", "", sure)
    assert len(re.findall(r"\d[\d.,]*", plain)) <= 40


def test_pictures_of_how_sure_count_what_the_tables_say() -> None:
    """Law: a bar's right answers over all are the percentage of its row, and no bar has other recordings."""
    sure = tomllib.loads((ROOT / "docs" / "figures.toml").read_text(encoding="utf-8"))["sure"]
    answers = [answer for _, answer in sure["rows"]]
    for (_, right, silent, wrong), answer in zip(sure["outcomes"][:2], answers[:2], strict=True):
        share, count = re.match(r"(\d+) % of (\d+)", answer).groups()  # type: ignore[union-attr]
        assert right + silent + wrong == int(count)
        assert round(100.0 * right / int(count)) == int(share)
    for (_, right, _, wrong), answer in zip(sure["outcomes"][2:], answers[3:5], strict=True):
        assert answer == f"{wrong} of {right + wrong}"


def test_stored_outputs_are_of_the_cells_that_stand_there() -> None:
    """A notebook of a real arm keeps what it printed: every cell ran, in order, and shows no place of a machine."""
    text = (ROOT / "examples" / "real_panda.ipynb").read_text(encoding="utf-8")
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert all(cell["outputs"] for cell in cells[1:])
    assert "/tmp" not in text
    assert "/home" not in text


def test_a_notebooks_outputs_are_what_its_cells_print_and_show() -> None:
    names: dict[str, object] = {}
    printed = run_cell("x = 3\nprint('a')\nprint(x)", names, 1)
    assert printed == [{"name": "stdout", "output_type": "stream", "text": ["a\n", "3\n"]}]
    (shown,) = run_cell("x + 1", names, 2)
    assert shown["data"] == {"text/plain": ["4"]}
    (drawn,) = run_cell("from matplotlib.figure import Figure\nFigure()", names, 3)
    assert base64.b64decode(drawn["data"]["image/png"]).startswith(b"\x89PNG")


def test_every_link_between_pages_leads_somewhere() -> None:
    for page in [*PAGES, ROOT / "CONTRIBUTING.md"]:
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists() or link.startswith("reference/"), f"{page.name}: {link}"


def test_the_references_have_every_key_and_command() -> None:
    """Made from the tables by which the readers refuse what they do not know."""
    assert "| `columns` |" in write.session_keys()
    assert "| `start_deg` |" in write.scene_keys()
    assert "## ident diagnose" in (found := write.commands())
    assert "`--robot`" in found


@pytest.mark.slow
def test_the_notebook_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads((ROOT / "examples" / "diagnosis.ipynb").read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    exec(compile(code, "notebook", "exec"), {"__name__": "notebook"})
    assert (tmp_path / "out" / "notebook" / "patch" / "robot.urdf").is_file()


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    assert write.main([]) == 0
    build = ["-m", "mkdocs", "build", "--quiet", "--config-file", ".ci/mkdocs.yml", "--site-dir", str(tmp_path)]
    done = subprocess.run([sys.executable, *build], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "diagnose" in (tmp_path / "api.html").read_text(encoding="utf-8")
    # The switch of colours stops at the first element that it doesn't find.
    page, switch = (tmp_path / name for name in ("index.html", "js/darkmode.js"))
    asked = set(re.findall(r"getElementById\('([\w-]+)'\)", switch.read_text(encoding="utf-8")))
    assert asked <= set(re.findall(r'id="([\w-]+)"', page.read_text(encoding="utf-8")))


@pytest.mark.slow
def test_an_effect_is_found_and_patched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    find_and_patch_an_effect.main(tmp_path)
    assert "spring torque in joint_3" in capsys.readouterr().out
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
