"""The page's server: loopback alone, under an address that nobody can guess, one user, one log at a
time.

A page of another site can neither guess the address nor, by another name for this machine, be
answered: the host of a request has to be the loopback's own.
"""

from __future__ import annotations

import asyncio
import json
import logging
import secrets
import tempfile
import webbrowser
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler

from ident.errors import InputError
from ident.local_page.desk import PAGE, Desk
from ident.records import as_json
from ident.show.palette import style_colours

LOOPBACK = "127.0.0.1"
# The largest recording that a browser may hand over [bytes]; larger ones are given on the command
# line.
LARGEST = 1 << 30
# In its style sheet; what it gives way to.
COLOURS_GO_HERE = "/* Colours: ident/show/palette.py. */"
KINDS = {
    ".json": "application/json",
    ".html": "text/html",
    ".toml": "text/plain",
    ".zip": "application/zip",
}
# What a page may load: nothing but what is in it, and this server.
POLICY = (
    "default-src 'self' 'unsafe-inline' data:; frame-ancestors 'self'; "
    "base-uri 'none'; form-action 'none'"
)


class Handler(RequestHandler):
    """Base: answers in JSON, refuses other hosts."""

    def initialize(self, desk: Desk, pool: ThreadPoolExecutor, hosts: set[str]) -> None:
        self.desk = desk
        self.pool = pool
        self.hosts = hosts

    def prepare(self) -> None:
        if self.request.host not in self.hosts:
            raise HTTPError(403)

    def set_default_headers(self) -> None:
        self.set_header("Content-Security-Policy", POLICY)
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    async def answer(self, work: Callable[[], Any]) -> None:
        """Does some work beside the server's loop, and sends its result; the user's mistakes with
        status 400.
        """
        try:
            result = await asyncio.get_running_loop().run_in_executor(self.pool, work)
        except InputError as error:
            self.set_status(400)
            result = {
                "error": str(error),
                "where": error.where,
                "what": error.what,
                "remedy": error.remedy,
            }
        self.write(as_json(result if result is not None else {}, None))
        self.set_header("Content-Type", "application/json")


class Front(Handler):
    """Answers `/` with the page's HTML, in the package's colours."""

    def get(self) -> None:
        page = files("ident.local_page").joinpath("page.html").read_text(encoding="utf-8")
        self.write(page.replace(COLOURS_GO_HERE, style_colours()))


class State(Handler):
    """What is given and how far a diagnosis has come."""

    def get(self) -> None:
        progress = self.desk.progress
        given = {
            "log": None if self.desk.log is None else self.desk.log.name,
            "robot": None if self.desk.robot is None else Path(self.desk.robot).name,
        }
        self.write(as_json({**vars(progress), **given, "files": self.desk.files}, None))
        self.set_header("Content-Type", "application/json")


class Take(Handler):
    """A file that was dropped or chosen."""

    async def post(self, kind: str) -> None:
        name = self.get_query_argument("name")
        content = self.request.body
        take = self.desk.take_log if kind == "log" else self.desk.take_robot
        await self.answer(partial(take, name, content))


class Act(Handler):
    """A step that takes a word or nothing."""

    async def post(self, step: str) -> None:
        given = json.loads(self.request.body or b"{}")
        word = str(given.get("word", ""))
        steps: dict[str, Callable[[], Any]] = {
            "robot_name": partial(self.desk.name_robot, word),
            "other_log": self.desk.forget_log,
            "check": self.desk.check,
            "line": partial(self.desk.write_line, word),
            "text": partial(self.desk.replace_text, word),
        }
        if step != "diagnose":
            await self.answer(steps[step])
            return
        if not self.desk.progress.running:
            self.desk.progress.running = True
            self.pool.submit(self.desk.diagnose)
        self.write("{}")


class Finished(Handler):
    """A finished file."""

    def get(self, name: str) -> None:
        if name not in self.desk.files:
            raise HTTPError(404)
        self.set_header("Content-Type", KINDS[Path(name).suffix])
        if name == PAGE and "show" in self.request.query_arguments:
            self.set_header("Content-Security-Policy", f"sandbox allow-scripts; {POLICY}")
        else:
            self.set_header("Content-Disposition", f'attachment; filename="{name}"')
        self.write((self.desk.folder / name).read_bytes())


def make_application(
    desk: Desk, pool: ThreadPoolExecutor, token: str, hosts: set[str]
) -> Application:
    """The server's application: every address begins with a word that only the user's browser was
    told.
    """
    known = {"desk": desk, "pool": pool, "hosts": hosts}
    begin = rf"/{token}"
    steps = "robot_name|other_log|check|line|text|diagnose"
    return Application(
        [
            (rf"{begin}/", Front, known),
            (rf"{begin}/state", State, known),
            (rf"{begin}/take/(log|robot)", Take, known),
            (rf"{begin}/({steps})", Act, known),
            (rf"{begin}/files/([\w.]+)", Finished, known),
        ]
    )


async def serve(desk: Desk, port: int, started: Callable[[str], None]) -> None:
    """Serves until it is cancelled.

    Args:
        desk: The log and robot.
        port: Where to listen; any free one if 0.
        started: Called with the address.

    Raises:
        InputError: The port is taken.
    """
    for name in ("tornado.access", "tornado.general"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # the page tells what is wrong
    try:
        sockets = bind_sockets(port, LOOPBACK)
    except OSError as error:
        raise InputError(
            f"--port {port}", f"can't be listened at ({error.strerror})", "choose another one"
        ) from None
    number = sockets[0].getsockname()[1]
    token = secrets.token_urlsafe(16)
    hosts = {f"{LOOPBACK}:{number}", f"localhost:{number}"}
    # Two: a diagnosis, and what is asked in the meantime.
    with ThreadPoolExecutor(2) as pool:
        server = HTTPServer(
            make_application(desk, pool, token, hosts),
            max_body_size=LARGEST,
            max_buffer_size=LARGEST,
        )
        server.add_sockets(sockets)
        try:
            started(f"http://{LOOPBACK}:{number}/{token}/")
            await asyncio.Event().wait()
        finally:
            server.stop()


def open_page(
    log: Path | None, robot: str | None, port: int, browser: bool, tell: Callable[[str], None]
) -> None:
    """Opens the page and serves it until Ctrl-C.

    Args:
        log, robot: What is given already.
        port: Where to listen; any free one if 0.
        browser: Whether the user's browser is to be opened.
        tell: Called with the address.
    """
    with tempfile.TemporaryDirectory(prefix="armgap-") as folder:
        desk = Desk(Path(folder), log)
        if robot is not None:
            desk.name_robot(robot)

        def started(address: str) -> None:
            tell(address)
            if browser:
                webbrowser.open(address)

        asyncio.run(serve(desk, port, started))
