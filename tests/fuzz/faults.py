"""Faults of the system, and signals at any moment, under the commands themselves: each run in a forked process.

Laws: exit 0, 2, 3, 74 or 128 and the signal's number, no traceback, at most one line on standard error for what went
wrong, nothing half-written, and nothing of the user's touched.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.process import run_command
from ident.robot.names import data_path
from tests.fuzz.corpus import in_a_child

OUTCOMES = (
    "done",
    "refused",
    "system",
    "stopped",
    "killed",
    "traceback",
    "hang",
    "status",
    "lines",
    "leftovers",
    "user's",
)
GOOD = ("done", "refused", "system", "stopped", "killed")
STATUSES = {0: "done", 2: "refused", 3: "done", 74: "system", 129: "stopped", 130: "stopped", 143: "stopped"}
# A command may take so much processor time, and wait so long on a machine that others use.
SLOWEST_CPU_S, SLOWEST_S = 60, 300.0
Act = Callable[[], None]


@dataclass(frozen=True)
class Ended:
    """How a forked command ended."""

    status: int
    err: str
    hung: bool = False


@dataclass(frozen=True)
class Fault:
    """What is wrong with the machine.

    Attributes:
        name: In the table.
        act: Done in the child before the command.
        option: Given instead of the last output's place.
        kills: Signals that come at a random moment.
    """

    name: str
    act: Act = lambda: None
    place: Callable[[Path], Path] = lambda folder: folder / "out.json"
    kills: tuple[int, ...] = ()


def faults() -> list[Fault]:
    """All of them."""
    return [
        Fault("none"),
        Fault("files may have 1 kB", lambda: _limit(resource.RLIMIT_FSIZE, 1000)),
        Fault("files may have nothing", lambda: _limit(resource.RLIMIT_FSIZE, 0)),
        Fault("no handles left", lambda: _limit(resource.RLIMIT_NOFILE, len(os.listdir("/proc/self/fd")) + 1)),
        Fault("no memory left", _little_memory),
        Fault("screen is full", lambda: _screen("/dev/full")),
        Fault("nobody reads", _closed_pipe),
        Fault("no screen at all", _no_screen),
        Fault("a console of ASCII", lambda: _encoding("ascii")),
        Fault("target below a file", place=lambda folder: folder / "notes.txt" / "out.json"),
        Fault("target is a device", place=lambda folder: Path("/dev/null")),
        Fault("target is a folder", place=lambda folder: folder),
        Fault("target is the user's", place=lambda folder: folder / "notes.txt"),
        Fault("target is a pipe", place=_fifo),
        Fault("target is a link", place=_link),
        Fault("target can't be made", place=lambda folder: Path("/proc/out.json")),
        Fault("Ctrl-C", kills=(signal.SIGINT,)),
        Fault("Ctrl-C twice", kills=(signal.SIGINT, signal.SIGINT)),
        Fault("SIGTERM", kills=(signal.SIGTERM,)),
        Fault("SIGKILL", kills=(signal.SIGKILL,)),
    ]


def commands(model: Path) -> dict[str, Callable[[Path, Path], list[str]]]:
    """Commands that take a moment, with the place of their result."""
    run = str(Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet")
    scene = str(Path(__file__).parents[1] / "plan/data/table3.toml")
    robot = ["--robot", "tm5-900"]
    return {
        "ident inspect": lambda at, to: ["inspect", run, *robot, "--mend", str(at / "mended"), "--json", str(to)],
        "ident evaluate": lambda at, to: ["evaluate", run, "--model", str(model), "--json", str(to)],
        "ident export": lambda at, to: ["export", str(model), "--out", str(at / "export"), "--json", str(to)],
        "ident simulate": lambda at, to: [
            *("simulate", "--out", str(at / "made"), "--runs", "1", "--duration", "2"),
            *("--rate", "50", "--json", str(to)),
        ],
        "plan solve": lambda at, to: [
            *("solve", scene, "--method", "toppra", "--objective", "time", "--no-gap", "--json", str(to))
        ],
    }


def fault_table(seconds: float, seed: int) -> tuple[tuple[str, ...], dict[str, list[int]], tuple[str, ...]]:
    """Every fault under a command, drawn anew until the time is up; each fault once at least."""
    table = {fault.name: [0] * len(OUTCOMES) for fault in faults()}
    rng, end, rounds = np.random.default_rng([seed, 1]), time.monotonic() + seconds, 0
    with tempfile.TemporaryDirectory() as place:
        model = Path(place) / "model"
        in_a_child(fit_quickly, model)
        given = commands(model)
        lasting = {name: _time(name, line, Path(place)) for name, line in given.items()}
        while rounds == 0 or time.monotonic() < end:
            for fault in faults():
                if rounds and time.monotonic() > end:
                    break
                name = str(rng.choice(list(given)))
                outcome, evidence = under(fault, name, given[name], Path(place), lasting[name] * rng.random())
                table[fault.name][OUTCOMES.index(outcome)] += 1
                if outcome not in GOOD:
                    print(f"{name}, {fault.name}, {outcome}: {evidence!r}", flush=True)
            rounds += 1
    return OUTCOMES, table, GOOD


def fit_quickly(folder: Path) -> None:
    """A fitted model of the shipped arm, without a net."""
    from ident.model.hybrid import FitOptions, fit_hybrid
    from ident.sessions import open_sessions

    opened = open_sessions([Path(data_path("logs/tm5_900")) / "E1"], "tm5-900")
    fit_hybrid(opened.motions, opened.arm, FitOptions(inertia="nominal", net="none")).model.save(folder)


def under(
    fault: Fault, name: str, line: Callable[[Path, Path], list[str]], place: Path, moment: float
) -> tuple[str, str]:
    """Runs a command under a fault in a fresh folder; the outcome and its evidence."""
    folder = Path(tempfile.mkdtemp(dir=place))
    try:
        (folder / "notes.txt").write_text("mine")
        target = fault.place(folder)
        mine = _listing(folder)
        ended = fork_command(name.split()[0], line(folder, target), fault.act, fault.kills, moment)
        return _judge(ended, folder, mine, bool(fault.kills) and signal.SIGKILL in fault.kills)
    finally:
        shutil.rmtree(folder)


def _judge(ended: Ended, folder: Path, mine: dict[str, str], killed: bool) -> tuple[str, str]:
    if ended.hung:
        return "hang", ended.err
    if "Traceback" in ended.err:
        return "traceback", ended.err[-600:]
    found = _listing(folder)
    if any(found.get(name) != content for name, content in mine.items()):
        return "user's", repr(found)
    if killed and ended.status == -signal.SIGKILL:
        return "killed", ""
    outcome = STATUSES.get(ended.status)
    if outcome is None:
        return "status", f"{ended.status} {ended.err}"
    if any(".armgap-" in name for name in found):
        return "leftovers", repr(sorted(found))
    if outcome != "done" and len(ended.err.strip().splitlines()) > 1:
        return "lines", ended.err
    return outcome, ""


def fork_command(
    name: str, arguments: list[str], act: Act = lambda: None, kills: tuple[int, ...] = (), moment: float = 0.0
) -> Ended:
    """Runs `ident` or `plan` in a child whose libraries are loaded already."""
    with tempfile.TemporaryFile() as told:
        child = os.fork()
        if not child:
            _be_command(name, arguments, act, told.fileno())
        for number in kills:
            time.sleep(moment)
            os.kill(child, number)
        end = time.monotonic() + SLOWEST_S
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended or time.monotonic() > end:
                break
            time.sleep(0.01)
        if not ended:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        told.seek(0)
        err = told.read().decode(errors="backslashreplace")
        code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else -os.WTERMSIG(status)
        return Ended(code, err, not ended or code == -signal.SIGXCPU)


def _be_command(name: str, arguments: list[str], act: Act, told: int) -> None:
    status = 1
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(told, 2)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        sys.argv = [name, *arguments]
        spent = int(time.process_time()) + SLOWEST_CPU_S
        resource.setrlimit(resource.RLIMIT_CPU, (spent, spent + 5))
        act()
        run_command(name, f"{name}.cli.app")
    except SystemExit as error:
        status = int(error.code or 0)
    except BaseException:
        import traceback

        os.write(2, traceback.format_exc().encode())
    os._exit(status)


def _time(name: str, line: Callable[[Path, Path], list[str]], place: Path) -> float:
    """How long a command takes; it must succeed."""
    folder = Path(tempfile.mkdtemp(dir=place))
    begun = time.monotonic()
    ended = fork_command(name.split()[0], line(folder, folder / "out.json"))
    if ended.status or ended.hung:
        raise InputError(name, f"fails without a fault: {ended.err}", "mend it first")
    return time.monotonic() - begun


def _listing(folder: Path) -> dict[str, str]:
    found = {}
    for path in folder.rglob("*"):
        status = path.lstat()
        plain = path.is_file() and not path.is_symlink()
        found[str(path.relative_to(folder))] = path.read_bytes().hex()[:64] if plain else str(status.st_mode)
    return found


def _limit(kind: int, most: int) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(kind, (most, most))


def _little_memory() -> None:
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + 2_000_000, now + 2_000_000))


def _screen(path: str) -> None:
    os.dup2(os.open(path, os.O_WRONLY), 1)


def _closed_pipe() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    os.dup2(writing, 1)


def _no_screen() -> None:
    sys.stdout = None  # as Python has it where descriptor 1 is closed


def _encoding(name: str) -> None:
    sys.stdout = open(1, "w", closefd=False, encoding=name)  # noqa: SIM115


def _fifo(folder: Path) -> Path:
    os.mkfifo(folder / "out.json")
    return folder / "out.json"


def _link(folder: Path) -> Path:
    (folder / "out.json").symlink_to(folder / "notes.txt")
    return folder / "out.json"
