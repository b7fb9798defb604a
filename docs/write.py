"""Writes what of the documentation is made from code and data: figures of the checks, references, a notebook.

    python docs/write.py            # figures into README.md and docs/*.md, references into docs/reference/
    python docs/write.py --check    # status 1 where a figure on a page is not that of docs/figures.toml
    python docs/write.py --sixty    # runs README's first snippet, and writes what it prints below it
    python docs/write.py --picture  # draws before and after of a shipped recording, for the front page
    python docs/write.py --page     # takes a picture of that recording's page in headless Chromium, likewise

Figures stand on a page between `<!-- figures: NAME -->`, or `<!-- in short: NAME -->`, and `<!-- end of figures -->`;
nobody types them there.
"""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

import typer

HERE = Path(__file__).parent
ROOT = HERE.parent
PAGES = (ROOT / "README.md", *sorted(HERE.glob("*.md")))
NOTEBOOKS = (ROOT / "examples" / "real_panda.ipynb",)
BLOCK = re.compile(r"(<!-- (figures|in short): (\w+) -->\n).*?(<!-- end of figures -->)", re.DOTALL)
SIXTY = re.compile(r"(<!-- sixty -->\n```python\n(.*?)```\n).*?(<!-- end of sixty -->)", re.DOTALL)
# What of a page its picture shows: what stands below its head, to about the second joint of its first table [px]; no
# wider, for a phone shows it half as large.
PAGE_WIDTH, PAGE_HEIGHT = 720, 540
NO_HEAD = "<style>body > header { display: none; }</style></head>"
CHROMIUM = ("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
# As much of what a snippet prints as a front page shows: the verdict with what to do, and of the numbers these lines.
SHOWN_LINES = 5
# Intervals, which stand where the whole of a table does.
INTERVAL = re.compile(r" \([^)]*\)")
HEAD = "<!-- written by docs/write.py -->\n"


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of Markdown."""
    cells = [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    lines = [columns, ["---"] * len(columns), *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def figures(data: Mapping[str, Any]) -> str:
    """One table of the data file in plain words; the command, date and commit that it is of are folded."""
    shown = table(data["columns"], data["rows"])
    made = f"By `{data['command']}`, {data['date']}, commit {data['commit']}."
    words = " ".join(word for word in (data["about"], made, data.get("note", "")) if word)
    if data.get("folded"):
        return f"{data['plain']}\n\n{folded(words + table_as_html(data))}"
    return f"{data['plain']}\n\n{shown}\n{folded(words)}"


def in_short(data: Mapping[str, Any]) -> str:
    """The same without intervals, and without what only who repeats a measurement needs."""
    rows = [[INTERVAL.sub("", cell) for cell in row] for row in data["rows"]]
    return f"{data['plain']}\n\n{table(data['columns'], rows)}"


def folded(text: str) -> str:
    """What only who repeats a measurement needs, in HTML, which every reader of Markdown passes on."""
    inside = re.sub(r"`([^`]*)`", lambda code: f"<code>{escape(code[1])}</code>", text)
    return f"<details><summary>How it was measured</summary><p>{inside}</p></details>\n"


def table_as_html(data: Mapping[str, Any]) -> str:
    """A table within HTML."""
    head = "".join(f"<th>{escape(str(cell))}</th>" for cell in data["columns"])
    rows = ["".join(f"<td>{escape(str(cell))}</td>" for cell in row) for row in data["rows"]]
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f"</p><table><tr>{head}</tr>{body}</table><p>"


def with_figures(text: str, data: Mapping[str, Any]) -> str:
    """A page with its blocks of figures as the data file has them."""

    def filled(block: re.Match[str]) -> str:
        makes = figures if block[2] == "figures" else in_short
        return f"{block[1]}{makes(data[block[3]])}{block[4]}"

    return BLOCK.sub(filled, text)


def with_output(text: str) -> str:
    """The front page with the first lines that its first snippet prints now."""
    (snippet,) = (found[2] for found in SIXTY.finditer(text))
    done = subprocess.run([sys.executable, "-c", snippet], cwd=ROOT, capture_output=True, text=True, check=True)
    verdict, numbers, *_ = done.stdout.strip().split("\n\n")
    lines = numbers.splitlines()[:SHOWN_LINES]
    shown = "\n".join([verdict, "", *lines, "  …"])
    return SIXTY.sub(lambda block: f"{block[1]}\n```text\n{shown}\n```\n{block[3]}", text)


def draw_before_and_after(place: Path) -> None:
    """Torque of the leading joint over its worst run, and what URDF, tuned model and named effects are off by."""
    import numpy as np
    from matplotlib.figure import Figure

    from ident.api.diagnosing import examine
    from ident.command_options import DiagnoseOptions
    from ident.show.report.traces import COLOURS, gather_traces, label

    found = examine(ROOT / "logs" / "tm5_900" / "sealed_2", "tm5-900", DiagnoseOptions())
    assert found.analysis is not None
    traces = gather_traces(found.analysis)
    assert traces is not None
    run, joint = traces.runs[0], traces.shown[0]
    measured = run.values["measured"][:, joint]
    judged = np.flatnonzero(np.isfinite(run.values["tuned"][:, joint]))
    shown = slice(max(judged[0] - 20, 0), judged[-1] + 20)
    figure = Figure(figsize=(8.0, 3.6), layout="constrained", facecolor="white")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    for name in traces.curves:
        values = run.values[name][:, joint]
        upper.plot(run.time[shown], values[shown], color=COLOURS[name], linewidth=1.4, label=label(name))
        if name != "measured":
            lower.plot(run.time[shown], (measured - values)[shown], color=COLOURS[name], linewidth=1.4)
    upper.set_ylabel(f"torque of {traces.joints[joint]} [N m]")
    lower.set_ylabel("error [N m]")
    lower.set_xlabel(f"time in {run.name} of sealed_2 [s]")
    figure.legend(*upper.get_legend_handles_labels(), fontsize=9, loc="outside upper center", ncols=2, frameon=False)
    for axes in (upper, lower):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(place, metadata={"Date": None, "Title": "armgap"})


def picture_page(place: Path) -> None:
    """The first screen of a shipped recording's page."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "why.html"
        start = "from ident.cli.start import main; main()"
        given = ["diagnose", "logs/tm5_900/sealed_2", "--robot", "tm5-900", "--html", str(page)]
        subprocess.run([sys.executable, "-c", start, *given], cwd=ROOT, check=True)
        take_picture(page, place)


def take_picture(page: Path, place: Path) -> None:
    """The first screen of a page below its head, as Chromium shows it."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        copy, shot = Path(folder) / "copy.html", Path(folder) / "page.png"
        copy.write_text(page.read_text(encoding="utf-8").replace("</head>", NO_HEAD, 1), encoding="utf-8")
        size = f"--window-size={PAGE_WIDTH},{PAGE_HEIGHT}"
        given = [f"--user-data-dir={folder}", size, f"--screenshot={shot}", copy.as_uri()]
        subprocess.run([*CHROMIUM, *given], check=True)
        whole = Image.open(shot).convert("RGB")
        whole.quantize(128, kmeans=1).save(place, optimize=True)


def describe_command(package: str, name: str, command: Any) -> str:
    """A command with its arguments and options."""
    rows = []
    for option in command.params:
        if option.name == "help":
            continue
        names = ", ".join(f"`{one}`" for one in (*option.opts, *option.secondary_opts) if one.startswith("-"))
        needed = "needed" if option.required else "" if option.default in (None, (), "") else f"`{option.default}`"
        rows.append((names or f"`{option.name}`", getattr(option, "help", "") or "", needed))
    return f"## {package} {name}\n\n{command.help}\n\n{table(('', 'what', 'default'), rows)}"


def commands() -> str:
    """All commands of both packages, from the code that parses them."""
    from ident.cli.app import app as ident_app
    from plan.cli.app import app as plan_app

    sections = [
        describe_command(package, name, command)
        for package, app in (("ident", ident_app), ("plan", plan_app))
        for name, command in sorted(typer.main.get_command(app).commands.items())  # type: ignore[attr-defined]
    ]
    return HEAD + "# Commands\n\nEvery command has `--help`.\n\n" + "\n".join(sections)


def session_keys() -> str:
    """The keys of session.toml."""
    from ident.recordings.session_toml import KEYS

    lines = "Every key may be left out. `ident new` writes the file with its guesses.\n\n"
    columns, columns_of = ("key", "what", "unit", "if left out", "example"), ("meaning", "unit", "default")
    rows = [(f"`{name}`", *map(key.get, columns_of), f"`{key['example']}`") for name, key in KEYS.items()]
    return HEAD + "# session.toml\n\n" + lines + table(columns, rows)


def scene_keys() -> str:
    """The tables and keys of scene.toml."""
    from plan.problem.scene_keys import KEYS

    parts = []
    for name, keys in KEYS.items():
        title = f"[{name}]" if name else "At the top"
        parts.append(f"## {title}\n\n" + table(("key", "what"), [(f"`{key}`", one.says) for key, one in keys.items()]))
    return HEAD + "# scene.toml\n\nUnits stand in the names of the keys.\n\n" + "\n".join(parts)


def settings() -> str:
    """The numbers by which a diagnosis decides."""
    from ident.diagnosis.settings import DiagnosisSettings

    columns, parts = ("meaning", "value", "unit", "source"), []
    for group, rows in groupby(DiagnosisSettings().describe(), lambda one: one["name"].rpartition(".")[0]):
        own = [(f"`{one['name'].rpartition('.')[2]}`", *map(one.get, columns)) for one in rows]
        parts.append(f"## {group.replace('.', ', ').replace('_', ' ') or 'all stages'}\n\n{table(('', *columns), own)}")
    return HEAD + "# Settings of a diagnosis\n\n" + "\n".join(parts)


def notebook(path: Path, folder: Path) -> str:
    """A notebook with its stored output as a page; its pictures are written beside it."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    parts = [HEAD]
    for number, cell in enumerate(cells):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            if "text" in output:
                parts.append(f"```text\n{''.join(output['text']).rstrip()}\n```")
            picture = output.get("data", {}).get("image/png")
            if picture is not None:
                drawn = folder / f"{path.stem}_{number}.png"
                drawn.write_bytes(base64.b64decode(picture))
                parts.append(f"![What the lines above draw]({drawn.name})")
    return "\n\n".join(parts) + "\n"


def main(options: list[str]) -> int:
    """Writes, or checks, all pages; see the module."""
    data = tomllib.loads((HERE / "figures.toml").read_text(encoding="utf-8"))
    stale = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fresh = with_figures(text, data)
        if fresh != text:
            stale.append(page.name)
            if "--check" not in options:
                page.write_text(fresh, encoding="utf-8")
    if "--check" in options:
        print(
            f"not as docs/figures.toml: {', '.join(stale)}" if stale else "all figures are those of docs/figures.toml"
        )
        return 1 if stale else 0
    if "--picture" in options:
        draw_before_and_after(HERE / "before_after.svg")
        return 0
    if "--page" in options:
        picture_page(HERE / "page.png")
        return 0
    if "--sixty" in options:
        front = ROOT / "README.md"
        front.write_text(with_output(front.read_text(encoding="utf-8")), encoding="utf-8")
        return 0
    made = {"commands": commands(), "session_toml": session_keys(), "scene_toml": scene_keys(), "settings": settings()}
    reference = HERE / "reference"
    reference.mkdir(exist_ok=True)
    made |= {path.stem: notebook(path, reference) for path in NOTEBOOKS}
    for name, text in made.items():
        (reference / f"{name}.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
