"""A headless Chromium as a person uses it: keys, files, drops. Speaks the DevTools protocol over tornado's client.

Source: Chrome DevTools Protocol (Runtime.evaluate, DOM.setFileInputFiles, Input.dispatchKeyEvent,
Input.dispatchDragEvent).
"""

from __future__ import annotations

import asyncio
import json
import shutil
import urllib.request
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.accessible import BROWSERS

# Longest time that the page may take for a step on a busy machine [s].
PATIENCE = 150.0
CODES = {"Tab": 9, "Enter": 13, " ": 32, "ArrowRight": 39}


class Tab:
    """One page of the browser."""

    def __init__(self, connection: WebSocketClientConnection) -> None:
        self.connection = connection
        self.number = 0

    async def call(self, method: str, **given: Any) -> dict[str, Any]:
        """Asks the browser for something and waits for its answer."""
        self.number += 1
        await self.connection.write_message(json.dumps({"id": self.number, "method": method, "params": given}))
        while True:
            message = await self.connection.read_message()
            assert message is not None, "the browser is gone"
            answer = json.loads(message)
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    async def evaluate(self, script: str) -> Any:
        """The value of a script on the page."""
        answer = await self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    async def until(self, script: str) -> Any:
        """Waits until a script's value is true."""
        for _ in range(int(PATIENCE / 0.2)):
            if value := await self.evaluate(script):
                return value
            await asyncio.sleep(0.2)
        raise AssertionError(f"never true: {script}; {await self.evaluate('document.body.innerText')}")

    async def choose(self, selector: str, files: Sequence[Path]) -> None:
        """Chooses files in an input, as the system's dialogue does."""
        root = await self.call("DOM.getDocument")
        found = await self.call("DOM.querySelector", nodeId=root["root"]["nodeId"], selector=selector)
        await self.call("DOM.setFileInputFiles", nodeId=found["nodeId"], files=[str(file) for file in files])

    async def drop(self, selector: str, files: Sequence[Path]) -> None:
        """Drops files on an element."""
        box = await self.evaluate(
            f"(() => {{ const one = document.querySelector('{selector}').getBoundingClientRect();"
            " return [one.x + one.width / 2, one.y + one.height / 2]; })()"
        )
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            await self.call("Input.dispatchDragEvent", type=kind, x=box[0], y=box[1], data=data)

    async def press(self, key: str) -> None:
        """Presses a key."""
        code = CODES[key]
        text = {"Enter": "\r", " ": " "}.get(key, "")
        given = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        await self.call("Input.dispatchKeyEvent", type="keyDown", text=text, **given)
        await self.call("Input.dispatchKeyEvent", type="keyUp", **given)

    async def type(self, text: str) -> None:
        """Types into what has the focus."""
        await self.call("Input.insertText", text=text)

    async def tab_to(self, identifier: str, most: int = 40) -> None:
        """Presses Tab until an element has the focus."""
        for _ in range(most):
            if await self.evaluate("document.activeElement.id") == identifier:
                return
            await self.press("Tab")
        raise AssertionError(f"the keyboard never reaches {identifier}")


@asynccontextmanager
async def open_tab(address: str, folder: Path) -> AsyncIterator[Tab]:
    """A browser with one page; skips where there is no browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium here")
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
    command += [f"--user-data-dir={folder}", "--window-size=1200,1600", "about:blank"]
    quiet = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(*command, stdout=quiet, stderr=quiet)
    try:
        port = folder / "DevToolsActivePort"
        for _ in range(int(PATIENCE / 0.2)):
            if port.exists() and port.read_text().strip():
                break
            await asyncio.sleep(0.2)
        number = port.read_text().split()[0]
        listed = await asyncio.to_thread(
            lambda: json.loads(urllib.request.urlopen(f"http://127.0.0.1:{number}/json/list").read())
        )
        page = next(one for one in listed if one["type"] == "page")
        connection = await websocket_connect(page["webSocketDebuggerUrl"], max_message_size=1 << 28)
        tab = Tab(connection)
        await tab.call("Page.navigate", url=address)
        await tab.until("document.readyState === 'complete' && !!document.querySelector('main')")
        yield tab
    finally:
        process.terminate()
        await process.wait()
