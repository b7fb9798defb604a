"""What axe-core has to say of a page in headless Chromium: contrast, names, order of headings, landmarks, tables.

Source: Deque, axe-core (the rules of WCAG 2 and best practice).
"""

import html
import json
import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# What axe finds is written into the page itself, whose text the browser prints.
RUN = """<script>axe.run({resultTypes: ["violations"]}).then(found => {
  const told = document.createElement("pre");
  told.id = "axe";
  told.textContent = JSON.stringify(found.violations.map(one => [one.id, one.nodes.map(node => node.html)]));
  document.body.appendChild(told);
});</script>"""
# Time that scripts of a page may take, by its own clock [ms].
SCRIPT_TIME = 60_000


# A phone's width [px], and what asks a page that is shown so wide for its own.
PHONE = 390
FRAMED = """<body style="margin: 0"><iframe id="page" src="{page}" style="width: {width}px; height: 800px; border: 0">
</iframe><script>document.getElementById("page").addEventListener("load", event => {{
  const shown = event.target.contentDocument;
  shown.querySelectorAll("details").forEach(one => one.open = true);
  document.body.dataset.width = shown.scrollingElement.scrollWidth;
  const cut = [...shown.querySelectorAll(".scroll")].filter(one => one.scrollWidth > one.clientWidth);
  document.body.dataset.cut = cut.map(one => one.getAttribute("aria-label")).join(";");
}});</script></body>"""


def width_on_a_phone(page: Path, folder: Path) -> int:
    """How wide a page is on a phone with all of its parts open [px]: more than `PHONE` is to be scrolled sideways.

    Args:
        page: The page.
        folder: Where a page with it inside may be written.
    """
    return int(_framed(page, folder, PHONE, "width"))


def tables_cut(page: Path, folder: Path, width: int) -> list[str]:
    """What is to be scrolled sideways within a page of a width [px] with all of its parts open: labels of its boxes.

    Args:
        page: The page.
        folder: Where a page with it inside may be written.
        width: How wide it is shown.
    """
    return [label for label in _framed(page, folder, width, "cut").split(";") if label]


def _framed(page: Path, folder: Path, width: int, asked: str) -> str:
    """What is found of a page that is shown in a frame of a width [px], all of its parts open."""
    framed = folder / f"framed_{page.name}"
    framed.write_text(FRAMED.format(page=page.as_uri(), width=width), encoding="utf-8")
    text = _shown(framed, folder, ["--allow-file-access-from-files"])
    found = re.search(rf'data-{asked}="([^"]*)"', text)
    assert found is not None, "the page did not load"
    return html.unescape(found[1])


def find_violations(page: Path, folder: Path, dark: bool = False) -> list[str]:
    """Rules that a page breaks, each with the elements that do; skips where browser or axe-core is missing.

    Args:
        page: The page.
        folder: Where a copy of it with axe-core inside may be written.
        dark: Whether its reader prefers dark pages.
    """
    axe = files(pytest.importorskip("axe_core_python")).joinpath("axe.min.js").read_text(encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    assert "</body>" in text
    judged = folder / f"judged_{page.name}"
    script = axe.replace("</script>", "<\\/script>")
    judged.write_text(text.replace("</body>", f"<script>{script}</script>{RUN}</body>"), encoding="utf-8")
    wish = ["--blink-settings=preferredColorScheme=0"] if dark else []
    seen = re.search(r'<pre id="axe">(.*?)</pre>', _shown(judged, folder, wish), re.DOTALL)
    assert seen is not None, "axe-core did not finish"
    return [f"{rule}: {'; '.join(nodes)}" for rule, nodes in json.loads(html.unescape(seen[1]))]


def after_script(page: Path, folder: Path, script: str) -> str:
    """The page's text once its own scripts and then another one have run; skips where there is no browser."""
    text = page.read_text(encoding="utf-8")
    acted = folder / f"acted_{page.name}"
    acted.write_text(text.replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    return _shown(acted, folder, [])


def _shown(page: Path, folder: Path, wishes: list[str]) -> str:
    """A page's text as it is once its scripts have run."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium here")
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += [*wishes, f"--virtual-time-budget={SCRIPT_TIME}", "--dump-dom", page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=240, check=True).stdout
