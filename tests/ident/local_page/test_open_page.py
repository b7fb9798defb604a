"""The local page in a real browser: drop, check, put a line in by a button, diagnose, download; by keys alone too."""

from __future__ import annotations

import asyncio
import json
import urllib.error
import urllib.request
import zipfile
from collections.abc import Awaitable, Callable
from importlib.resources import files
from io import BytesIO
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.local_page.desk import Desk, lines_of, plain_name
from ident.local_page.server import serve
from tests.ident import wrong_friction as arm
from tests.ident.local_page.browser import Tab, open_tab


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path]:
    """Runs with the torque of joint_2 the wrong way round, and the URDF."""
    folder = tmp_path_factory.mktemp("given")
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.state_friction())
    more = [tuple(1.5 * one for one in row) for row in (arm.DAMPING, arm.FRICTION)]
    session = arm.record(arm.load(arm.state_friction(*more)), folder / "session", runs=6, seconds=6.0)
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    for file in session.iterdir():
        table = pq.read_table(file)
        place = table.column_names.index("joint_2/effort")
        turned = pc.negate(table.column("joint_2/effort"))
        pq.write_table(table.set_column(place, "joint_2/effort", turned), file)
    return sorted(session.iterdir()), urdf


def use(desk: Desk, folder: Path, act: Callable[[Tab, str], Awaitable[None]]) -> None:
    """Serves a desk and lets somebody act on its page."""

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        server = asyncio.create_task(serve(desk, 0, address.set_result))
        try:
            async with open_tab(await address, folder / "profile") as tab:
                await act(tab, await address)
        finally:
            server.cancel()
            await asyncio.gather(server, return_exceptions=True)

    asyncio.run(run())


def test_drop_check_correct_diagnose_and_download(given: tuple[list[Path], Path], tmp_path: Path) -> None:
    runs, urdf = given
    desk = Desk(tmp_path)

    async def act(tab: Tab, address: str) -> None:
        await tab.drop("#drop-log", runs)
        await tab.until("document.querySelector('#log-given').textContent.includes('run_05')")
        await tab.drop("#drop-robot", [urdf])
        await tab.until("!!document.querySelector('#issues .line')")
        assert "Not yet fit" in await tab.evaluate("document.querySelector('#checked').textContent")
        await tab.evaluate("document.querySelector('#issues .line').click()")
        await tab.until("document.querySelector('#checked').textContent.startsWith('Fit for a diagnosis: 6 runs')")
        assert await tab.evaluate("document.querySelector('#toml').value") == "[effort_sign]\njoint_2 = -1\n"
        await tab.evaluate("document.querySelector('#diagnose').click()")
        headline = await tab.until("(document.querySelector('.headline') || {}).textContent")
        assert headline.startswith("Friction is 1.5 times what your URDF says at every joint")
        names = await tab.evaluate("[...document.querySelectorAll('#files a')].map(one => one.download)")
        assert set(names) == {"session.toml", "why.json", "why.html", "patched.zip"}
        sizes = await tab.evaluate(
            "Promise.all([...document.querySelectorAll('#files a')].map(async one => "
            "[one.download, (await (await fetch(one.href)).arrayBuffer()).byteLength]))"
        )
        assert all(size > 10 for _, size in sizes)
        packed = await asyncio.to_thread(lambda: urllib.request.urlopen(f"{address}files/patched.zip").read())
        assert {"robot.urdf", "robot.xml", "parameters.toml"} <= set(zipfile.ZipFile(BytesIO(packed)).namelist())
        assert json.loads((tmp_path / "why.json").read_text())["verdict"] == "no_gap"
        await violations(tab)

    use(desk, tmp_path, act)
    assert all(path.exists() for path in runs)
    assert not (runs[0].parent / "session.toml").exists()  # nothing is written where the user's files lie


def test_the_keyboard_alone_will_do(given: tuple[list[Path], Path], tmp_path: Path) -> None:
    """Law: every step to the files taken is reached by Tab and done by Enter or Space; a wrong name is told."""
    runs, urdf = given
    desk = Desk(tmp_path, runs[0].parent)

    async def act(tab: Tab, _: str) -> None:
        await violations(tab)
        await tab.tab_to("robot-name")
        await tab.type("no_such_robot")
        await tab.press("Enter")
        await tab.until("document.querySelector('#give-error').textContent.includes('What to do')")
        await tab.evaluate("document.querySelector('#robot-name').value = ''")
        await tab.type(str(urdf))
        await tab.press("Enter")
        await tab.until("!!document.querySelector('#issues .line')")
        await tab.press("Tab")
        for _step in range(20):
            if await tab.evaluate("document.activeElement.className") == "line":
                break
            await tab.press("Tab")
        await tab.press(" ")
        await tab.until("document.querySelector('#checked').textContent.startsWith('Fit for')")
        await tab.tab_to("diagnose")
        await tab.press("Enter")
        await tab.until("!document.querySelector('#take').hidden && !!document.querySelector('.headline')")
        await tab.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path / "taken"))
        for _step in range(40):
            if await tab.evaluate("document.activeElement.download || ''") == "patched.zip":
                break
            await tab.press("Tab")
        await tab.press("Enter")
        for _step in range(150):
            if (tmp_path / "taken" / "patched.zip").is_file():
                break
            await asyncio.sleep(0.2)
        assert zipfile.is_zipfile(tmp_path / "taken" / "patched.zip")
        await violations(tab)

    use(desk, tmp_path, act)


async def violations(tab: Tab) -> None:
    """axe-core finds nothing on the page as it is."""
    package = pytest.importorskip("axe_core_python")
    await tab.evaluate(files(package).joinpath("axe.min.js").read_text(encoding="utf-8"))
    found = await tab.evaluate(
        "axe.run({resultTypes: ['violations'], iframes: false}).then(found => "
        "found.violations.map(one => [one.id, one.nodes.map(node => node.html)]))"
    )
    assert found == []


def test_no_other_site_is_answered(tmp_path: Path) -> None:
    """Law: another host's name, and an address without the word, get nothing."""

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        server = asyncio.create_task(serve(Desk(tmp_path), 0, address.set_result))
        place = await address

        def status(url: str, host: str = "") -> int:
            request = urllib.request.Request(url, headers={"Host": host} if host else {})
            try:
                return int(urllib.request.urlopen(request).status)
            except urllib.error.HTTPError as error:
                return error.code

        assert await asyncio.to_thread(status, place) == 200
        assert await asyncio.to_thread(status, place, "attacker.example") == 403
        assert await asyncio.to_thread(status, place.rpartition("/")[0].rpartition("/")[0] + "/state") == 404
        assert await asyncio.to_thread(status, f"{place}files/..%2F..%2Fetc%2Fpasswd") == 404
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)

    asyncio.run(run())


def test_lines_of_a_remedy_can_be_put_in() -> None:
    issue = {"remedy": 'write `angle_unit = "deg"` at the top of session.toml', "joints": []}
    assert lines_of(issue) == ['angle_unit = "deg"']
    mount = {"remedy": "write `gravity_mps2 = [9.81, 0, 0]` in session.toml", "joints": []}
    assert lines_of(mount) == ["gravity_mps2 = [9.81, 0, 0]"]
    sign = {"remedy": "write `effort_sign = {joint_2 = -1}` (or remove it)", "joints": ["joint_2"]}
    assert lines_of(sign) == ["effort_sign = {joint_2 = -1}"]
    assert lines_of(sign, "[effort_sign]\njoint_2 = -1\n") == ["effort_sign = {joint_2 = 1}"]
    two = {"remedy": 'write `order = {a = "b", b = "a"}` and `effort_order = {a = "a"}`', "joints": []}
    assert [line.partition(" ")[0] for line in lines_of(two)] == ["order", "effort_order"]


@pytest.mark.parametrize("line", ["", "nonsense", "no_such_key = 1", "angle_unit = "])
def test_a_line_that_is_none_changes_nothing(tmp_path: Path, line: str) -> None:
    desk = Desk(tmp_path)
    desk.write_line('angle_unit = "deg"')
    text = desk.session_file.read_text()
    if line:
        with pytest.raises(InputError):
            desk.write_line(line)
    assert desk.session_file.read_text() == text


@pytest.mark.parametrize("name", ["../../etc/passwd", "C:\\logs\\run.csv", "a/b/run.parquet"])
def test_a_dropped_file_stays_in_its_folder(tmp_path: Path, name: str) -> None:
    desk = Desk(tmp_path)
    desk.take_log(name, b"x")
    assert [path.parent for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / "log"]
    for bad in ("", "..", ".hidden", "a/"):
        if bad != "a/":
            with pytest.raises(InputError):
                plain_name(bad)
