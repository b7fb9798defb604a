"""Commands in a folder full of files that libraries would obey: nothing is read there, nothing is started.

`docs/security.md` lists what each library reads by itself.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import typer
from rosbags.rosbag2 import StoragePlugin

import ident.cli.app
import ident.cli.simulated
import plan.cli.app
from ident.process import SIGNALLED
from ident.recordings.load import load_session
from ident.robot.names import data_path
from plan.planners.reference import Reference
from tests import traps
from tests.ident.foreign import write_bag
from tests.ident.recordings.test_bags import rows_of
from tests.plan.worlds import ledger, problem

PRECIOUS = "what is precious"
IPOPT_OPTIONS = "output_file victim.txt\nfile_print_level 12\nhsllib ./evil.so\nlinear_solver ma27\n"
MATPLOTLIB_PARAMETERS = "text.usetex: True\ntext.latex.preamble: \\input{evil}\nbackend: module://evil\n"
DRAWING = """
from pathlib import Path

def app(**given):
    from ident.show.report.figures import make_panel, to_svg
    figure, axes = make_panel("x", "y")
    axes.plot([0, 1], [0, 1])
    Path("page.svg").write_text(to_svg(figure, "a line"))
    from plan.show.pictures import plt, save_figure
    figure, axes = plt.subplots()
    axes.plot([0, 1], [0, 1])
    save_figure(figure, Path("plan.svg").absolute())
"""
TASK = """
robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [80, 30, -90]
duration_s = 0.65
"""
CYCLE = """
robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [50, 0, -120]
duration_s = 4.0
[[leg]]
deg = [80, 30, -90]
"""
# Each command by its arguments: {c} is a folder of good files, {r} of recordings, {o} one for what is written.
LIGHT = {
    "inspect": "ident inspect {r}/E1 --mend {o}/mended --json {o}/a.json",
    "inspect a bag": "ident inspect {c}/bag_SQLITE3 --robot tm5-900",
    "new": "ident new {o}/run.csv",
    "evaluate": "ident evaluate {r}/E1 --model {c}/model --html {o}/a.html",
    "patch": "ident patch {c}/diagnosis.json --robot tm5-900 --out {o}/patch",
    "patch into a URDF": "ident patch {c}/diagnosis.json --robot tm5-900 --out {o}/patch --into {o}/own.urdf",
    "patch into an MJCF": "ident patch {c}/diagnosis.json --robot tm5-900 --out {o}/patch --into {o}/own.xml",
    "score a board": "ident board score {c}/boards/board {c}/boards/entry --kept {c}/boards/kept --html {o}/a.html",
    "export": "ident export {c}/model --out {o}/export",
    "export a graph": "ident export {c}/model --out {o}/export --format onnx",
    "view": "ident view {r}/E1 --model {c}/model --rrd {o}/a.rrd",
    "schema": "ident schema diagnosis",
    "servo": "ident servo {r}/E1",
    "excite": "plan excite --separate backlash,payload --evaluations 8 --minutes 0.2 --out {o}/motion",
    "verify": "ident verify {c}/model {r}/E2 --limits {c}/limits.toml",
    "a xacro file": "ident inspect {r}/E1 --robot {c}/arm.xacro",
    "plan's schema": "plan schema result",
}
LONG = {
    "demo": "ident demo --out {o}/demo",
    "fit": "ident fit {r}/E1 --out {o}/model",
    "fit the paper's net": "ident fit {r}/E1 --out {o}/model --net paper",
    "diagnose": "ident diagnose {r}/E1 --html {o}/a.html --rrd {o}/a.rrd",
    "compare": "ident compare {r}/E1 {r}/payload_516g --out {o}/compared",
    "ranges": "ident ranges {r}/sealed_1 {r}/sealed_2 {r}/sealed_3",
    "watch": "ident watch {r} --store {o}/store --once",
    "simulate": "ident simulate --out {o}/session",
    "blind": "ident blind --cases 2 --workers 2 --out {o}/blind",
    "close": "ident close --out {o}/closed --arms 1 --rounds 2",
    "solve": "plan solve {o}/task.toml --model {c}/model --method reference --picture {o}/a.png --rrd {o}/a.rrd",
    "solve by evolution": "plan solve {o}/task.toml --model {c}/model --method cma --beyond --evaluations 200",
    "solve by learning": "plan solve {o}/task.toml --model {c}/model --method ppo --beyond --evaluations 60",
    "board": "ident board make {o}/board --cases 1 --seed 1 --worlds development",
    "cycle": "plan cycle {o}/cycle.toml --out {o}/motions --evaluations 40",
    "plan's compare": "plan compare {o}/task.toml --model {c}/model --out {o}/compared",
    "paper": "plan paper --model {c}/model --out {o}/paper --epochs 1 --generations 1 --trials 1 --levels 2",
}
# What a command starts on purpose: Python processes that do its work.
WORKERS = {"blind": "loky|resource_tr"}
# What is only looked for: settings of numba's, which are refused where they are there; the folder of a log that pycma
# is told not to write; the files that torch's own operators say they come from, which are asked for and not opened; and
# a file by the robot's name, which goes behind the names of robots.
ONLY_LOOKED_FOR = {".numba_config.yaml", "outcmaes", "_ops.py", "_classes.py", "tm5-900"}
PROGRAM = "#!/bin/sh\necho started >> {log}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which the test stands."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_gradient_reference_reads_no_options_of_the_folder(folder: Path) -> None:
    """Law: an `ipopt.opt` empties no file, loads no library and changes no plan."""
    task = problem(vias=2, duration=0.9, grows=False)
    before = Reference(starts=1).run([task], ledger(), np.random.default_rng(0)).best
    (folder / "ipopt.opt").write_text(IPOPT_OPTIONS)
    (folder / "victim.txt").write_text(PRECIOUS)
    after = Reference(starts=1).run([task], ledger(), np.random.default_rng(0)).best
    assert (folder / "victim.txt").read_text() == PRECIOUS
    assert after.cost == before.cost


def test_pictures_obey_no_parameters_of_the_folder_nor_of_the_user(folder: Path) -> None:
    """Law: a `matplotlibrc` starts no LaTeX, imports nothing and changes no picture."""
    for name in ("before", "after", "apps", "programs", "home/.config/matplotlib"):
        (folder / name).mkdir(parents=True)
    (folder / "apps/drawing.py").write_text(DRAWING)
    started = folder / "started"
    for name in ("latex", "dvipng", "dvisvgm", "kpsewhich"):
        program = folder / "programs" / name
        program.write_text(PROGRAM.format(log=started))
        program.chmod(0o755)
    environment = {
        **os.environ,
        "HOME": str(folder / "home"),
        "PATH": f"{folder / 'programs'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join([str(traps.ROOT), str(folder / "apps")]),
    }
    line = [sys.executable, "-P", "-c", "from ident.process import run_command; run_command('ident', 'drawing')"]
    subprocess.run(line, check=True, cwd=folder / "before", env=environment)
    (folder / "after/matplotlibrc").write_text(MATPLOTLIB_PARAMETERS)
    (folder / "after/evil.py").write_text(f"open({str(started)!r}, 'w')")
    (folder / "home/.config/matplotlib/matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    subprocess.run(line, check=True, cwd=folder / "after", env={**environment, "MPLBACKEND": "module://evil"})
    assert not started.exists()
    for name in ("page.svg", "plan.svg"):
        assert (folder / "after" / name).read_bytes() == (folder / "before" / name).read_bytes()


@pytest.mark.parametrize("name", [*LIGHT, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_commands_take_nothing_from_the_folder_where_they_are_started(name: str, corpus: Path, tmp_path: Path) -> None:
    """Law: among traps a command opens nothing, changes nothing, starts nothing and calls nobody.

    In the user's home it keeps nothing but this package's cache.
    """
    given, out = tmp_path / "traps", tmp_path / "out"
    out.mkdir()
    for good in (corpus / "run.csv", corpus / "own/own.urdf", corpus / "own/own.xml"):
        shutil.copy(good, out / good.name)
    (out / "task.toml").write_text(TASK)
    (out / "cycle.toml").write_text(CYCLE)
    traps.set_traps(given)
    words = (LIGHT | LONG)[name].format(c=corpus, r=data_path("logs/tm5_900"), o=out).split()
    seen = traps.run_among_traps(words[0], words[1:], given, tmp_path / "watch")
    assert not re.search(r"Traceback|--help", seen.output), traps.told(seen)
    started = [line for line in seen.started if not re.search(WORKERS.get(name, "nothing of it"), line)]
    assert (seen.touched, started) == ([], []), traps.told(seen)
    assert seen.looked <= ONLY_LOOKED_FOR, traps.told(seen)
    assert (seen.homed, seen.called) == ([], []), traps.told(seen)
    assert seen.status in (0, 2, 3), traps.told(seen)


# What libraries look for beside what they are given: SQLite, Arrow, readers of robots, Python.
BESIDE = ("run.db3-journal", "run.db3-wal", "run.db3-shm", "_metadata", "_common_metadata")
BESIDE += ("arm.srdf", "package.xml", "CMakeLists.txt", "materials.xml", "__init__.py", "numpy.py")


@pytest.mark.slow
def test_beside_what_is_named_nothing_is_looked_for(tmp_path: Path) -> None:
    """Law: of the folder where a bag and a URDF lie, only these are asked for, and settings."""
    given = tmp_path / "given"
    names = {"run.db3", "arm.urdf", "traps"}
    given.mkdir()
    run = load_session(data_path("logs/tm5_900/E1/01_trajectory_1.parquet")).runs[0]
    write_bag(tmp_path / "bag", rows_of(run), StoragePlugin.SQLITE3)
    (tmp_path / "bag/bag.db3").rename(given / "run.db3")
    shutil.copy(data_path("urdf/tm5_900.urdf"), given / "arm.urdf")
    for name in BESIDE:
        (given / name).write_bytes(b"evil")
    traps.set_traps(given / "traps")
    words = ["inspect", given / "run.db3", "--robot", given / "arm.urdf"]
    seen = traps.Seen()
    with traps.watching(given, seen):
        done = traps.run_among_traps("ident", words, given / "traps", tmp_path / "watch")
    assert done.status == 0, traps.told(done)
    assert set(seen.touched) <= names | {"the folder"}, seen.touched
    trace = tmp_path / "watch/trace"
    if trace.exists():
        looked = traps.names_within(trace.read_text(errors="replace").splitlines(), given)
        assert looked <= names | ONLY_LOOKED_FOR | {"session.toml", "run.toml"}, looked


def test_the_local_page_takes_nothing_from_that_folder(tmp_path: Path) -> None:
    """Law: among traps the page is served and checks a log, opens nothing and starts nothing."""
    answers: list[bytes] = []

    def ask(line: str) -> None:
        address = line.split()[0]
        for request in ("", "state", "files/evil"):
            try:
                with urllib.request.urlopen(address + request) as answer:
                    answers.append(answer.read())
            except urllib.error.HTTPError as error:
                answers.append(b"" if error.code == 404 else error.read())
        with urllib.request.urlopen(address + "check", data=b"{}") as answer:
            answers.append(answer.read())

    traps.set_traps(tmp_path / "traps")
    words = ["open", data_path("logs/tm5_900/E1"), "tm5-900", "--no-browser"]
    seen = traps.run_among_traps("ident", words, tmp_path / "traps", tmp_path / "watch", ask)
    page, state, absent, checked = answers
    assert b"<html" in page.lower(), traps.told(seen)
    assert json.loads(state)["log"] == "E1"
    assert absent == b""
    assert isinstance(json.loads(checked), dict)
    assert (seen.touched, seen.started) == ([], []), traps.told(seen)
    assert "Traceback" not in seen.output, traps.told(seen)
    assert seen.status == SIGNALLED + signal.SIGINT, traps.told(seen)


def test_each_command_is_run_among_traps() -> None:
    """Law: no command of either program is left out."""
    run = {"ident open"}
    for line in (LIGHT | LONG).values():
        run.add(" ".join(line.split()[:2]))
    for name, module in (("ident", ident.cli.app), ("plan", plan.cli.app)):
        commands = typer.main.get_command(module.app).list_commands(None)
        assert {f"{name} {command}" for command in commands} <= run


def test_the_watch_sees_what_is_opened_and_started(tmp_path: Path) -> None:
    """Law: a command that obeys a trap, or starts a program, would be seen; below Python too."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/trap").write_text("")
    seen = traps.Seen()
    with traps.watching(tmp_path / "folder", seen):
        subprocess.run(["cat", tmp_path / "folder/trap"], check=True)
        (tmp_path / "folder/new").touch()
    assert {"trap", "new"} <= set(seen.touched)


def test_the_watch_sees_what_is_only_looked_for() -> None:
    """Law: names from where the process stands and from the root, of files that are not there, too."""
    calls = [
        '7 newfstatat(AT_FDCWD, "cma_signals.in", 0x7f, 0) = -1 ENOENT (No such file or directory)',
        '7 access("./plug/in.so", R_OK) = -1 ENOENT (No such file or directory)',
        '7 openat(AT_FDCWD, "/cell/sub/../lib.so", O_RDONLY) = 3',
        '7 openat(AT_FDCWD, "/usr/lib/lib.so", O_RDONLY) = 3',
        '7 unlinkat(5, "session.toml", 0) = 0',
        '7 newfstatat(3, "", {st_mode=S_IFREG}, AT_EMPTY_PATH) = 0',
        '7 execve("/usr/bin/true", ["true"], 0x7f) = 0',
    ]
    assert traps.names_within(calls, Path("/cell")) == {"cma_signals.in", "plug", "lib.so"}
