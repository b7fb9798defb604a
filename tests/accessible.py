"""What axe-core has to say of a page in headless Chromium: contrast, names, order of headings, landmarks, tables.

Source: Deque, axe-core (the rules of WCAG 2 and best practice).
"""

from __future__ import annotations

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


def find_violations(page: Path, folder: Path, dark: bool = False) -> list[str]:
    """Rules that a page breaks, each with the elements that do; skips where browser or axe-core is missing.

    Args:
        page: The page.
        folder: Where a copy of it with axe-core inside may be written.
        dark: Whether its reader prefers dark pages.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium here")
    axe = files(pytest.importorskip("axe_core_python")).joinpath("axe.min.js").read_text(encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    assert "</body>" in text
    judged = folder / f"judged_{page.name}"
    script = axe.replace("</script>", "<\\/script>")
    judged.write_text(text.replace("</body>", f"<script>{script}</script>{RUN}</body>"), encoding="utf-8")
    wish = ["--blink-settings=preferredColorScheme=0"] if dark else []
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += [*wish, f"--virtual-time-budget={SCRIPT_TIME}", "--dump-dom", judged.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True).stdout
    told = re.search(r'<pre id="axe">(.*?)</pre>', shown, re.DOTALL)
    assert told is not None, "axe-core did not finish"
    return [f"{rule}: {'; '.join(nodes)}" for rule, nodes in json.loads(html.unescape(told[1]))]
