"""Hostile values for every option of every command, as the commands themselves list them: new ones are covered.

Laws: exit 0, 2 or 3, one line where a value is refused, no traceback, and nothing of the user's touched. A command that
takes a value is stopped once it has worked for a moment.
"""

import gc
import importlib
import os
import pkgutil
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

from ident.process import run_command
from ident.robot.names import data_path
from tests.fuzz.patience import Patience

OUTCOMES = ("done", "refused", "taken", "traceback", "status", "lines", "user's")
GOOD = ("done", "refused", "taken")
NUMBERS = ("nan", "-1", "1e9", "inf", "99999999999999999999", "-0.0")
TEXTS = (".", "nan", "", "x" * 5000, "$(touch RUN)", "[bold]\x1b[31m", "a:b:c:d", "1e9", "-")
PATHS = (".", "/dev/zero", "/proc/self/mem", "nowhere/below", "\x1b[31m", "notes.txt/x", "x" * 5000, "")
# Processor time after which a command counts as having taken its options [s].
MOMENT_S = 0.3
# Between two looks at a command [s].
LOOKING_S = 0.05
# A command may take so much processor time, and wait so long without any.
SLOWEST_CPU_S, SLOWEST_S = 60, 300.0
# Commands that wait for their user once they have taken their options, and for how long that is looked at [s].
SERVERS = ("ident open",)
WAITING_S = 5.0
SKIPPED = ("help", "version", "install_completion", "show_completion")


@dataclass(frozen=True)
class Trial:
    """One command line."""

    command: str  # such as `ident fit`
    option: str  # the option in question
    value: str  # what it is given
    arguments: tuple[str, ...]  # all of the command line


@dataclass(frozen=True)
class Ended:
    """How a forked command ended."""

    status: int
    err: str


def load_all() -> None:
    """Loads every module of both packages, so that children need not."""
    for name in ("ident", "plan"):
        package = importlib.import_module(name)
        for module in pkgutil.walk_packages(package.__path__, f"{name}."):
            importlib.import_module(module.name)
    gc.freeze()  # what is there stays as it is in the children: nothing is copied


def trials(corpus: Path) -> Iterator[Trial]:
    """Every option of every command with every value of its kind.

    Args:
        corpus: Folder of good files, as `tests.fuzz.corpus` writes them.
    """
    run = _recording(corpus)
    run.parent.mkdir(exist_ok=True)
    shutil.copy(Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet", run)
    for package in ("ident", "plan"):
        group: Any = typer.main.get_command(importlib.import_module(f"{package}.cli.app").app)
        for name, command in group.commands.items():
            for chosen in command.params:
                if chosen.name in SKIPPED:
                    continue
                for value in values_for(chosen):
                    line = (name, *_line(command, chosen, value, corpus))
                    yield Trial(f"{package} {name}", chosen.name, value, line)


def values_for(parameter: Any) -> tuple[str, ...]:
    """Values by the kind of an option."""
    kind = str(parameter.type_descriptor.annotation)
    if "int" in kind or "float" in kind:
        return NUMBERS
    if "bool" in kind:
        return ()
    return PATHS if "Path" in kind else TEXTS


def _line(command: Any, chosen: Any, value: str, corpus: Path) -> Iterator[str]:
    """A command line with one hostile value; what the command needs besides is good."""
    options, places = [], []
    for parameter in command.params:
        given = value if parameter is chosen else _good(parameter, corpus)
        if given is None:
            continue
        if parameter.param_type_name == "argument":
            places.append(given)
        else:
            options.append(f"{parameter.opts[-1]}={given}")
    yield from options
    yield from ("--", *places)


def _recording(corpus: Path) -> Path:
    """A copy of a shipped recording: what a command writes beside its input stays out of the shipped ones."""
    return corpus / "recorded" / "01_trajectory_1.parquet"


def _good(parameter: Any, corpus: Path) -> str | None:
    """A good value of what a command must be given, or would else take long with; None for the rest."""
    run = str(_recording(corpus))
    wanted = {
        "sessions": run,
        "session": run,
        "before": run,
        "after": run,
        "folder": str(corpus),
        "model": str(corpus / "model"),
        "diagnosis": str(corpus / "diagnosis.json"),
        "scene": str(corpus / "scene.toml"),
        "limits": str(corpus / "limits.toml"),
        "name": "diagnosis",
        "job": "score",
        "robot": "tm5-900",
        "out": "out",
        "store": "store",
    }
    quick = {"runs": "1", "duration": "1", "rrd": "view.rrd", "cases": "1", "out": "out", "every": "0.001"}
    if parameter.required:
        return wanted.get(parameter.name, str(corpus / "run.csv"))
    return quick.get(parameter.name)


def option_table(
    seconds: float, seed: int, corpus: Path
) -> tuple[tuple[str, ...], dict[str, list[int]], tuple[str, ...]]:
    """Trials in an order drawn anew, until the time is up."""
    load_all()
    drawn = list(trials(corpus))
    np.random.default_rng([seed, 2]).shuffle(drawn)  # type: ignore[arg-type]
    table: dict[str, list[int]] = {}
    end = time.monotonic() + seconds
    for trial in drawn:
        if time.monotonic() > end:
            break
        outcome, evidence = attempt(trial)
        table.setdefault(trial.command, [0] * len(OUTCOMES))[OUTCOMES.index(outcome)] += 1
        if outcome not in GOOD:
            print(f"{trial.command} --{trial.option} {trial.value[:40]!r}: {outcome}: {evidence!r}", flush=True)
    return OUTCOMES, table, GOOD


def attempt(trial: Trial) -> tuple[str, str]:
    """Runs a trial in a fresh folder that holds a file of the user's; the outcome and its evidence."""
    folder = Path(tempfile.mkdtemp())
    try:
        (folder / "notes.txt").write_text("mine")

        def begin() -> None:
            os.chdir(folder)
            signal.setitimer(signal.ITIMER_VIRTUAL, MOMENT_S)

        asleep = WAITING_S if trial.command in SERVERS else SLOWEST_S
        ended = fork_command(trial.command.split()[0], list(trial.arguments), begin, asleep_s=asleep)
        if trial.command in SERVERS and ended.status == -signal.SIGALRM:
            ended = replace(ended, status=-signal.SIGVTALRM)
        return judge(ended, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def judge(ended: Ended, folder: Path) -> tuple[str, str]:
    """What came of it."""
    if "Traceback" in ended.err:
        return "traceback", ended.err[-500:]
    if not (folder / "notes.txt").is_file() or (folder / "notes.txt").read_text() != "mine":
        return "user's", ended.err
    if (folder / "RUN").exists():
        return "user's", "a text was run"
    if ended.status == -signal.SIGVTALRM:
        return "taken", ""
    if ended.status in (0, 3):
        return "done", ""
    if ended.status != 2:
        return "status", f"{ended.status} {ended.err[-300:]}"
    return ("refused", "") if len(ended.err.strip().splitlines()) == 1 else ("lines", ended.err[-500:])


def fork_command(
    name: str,
    arguments: list[str],
    begin: Callable[[], None],
    most_s: float = SLOWEST_CPU_S,
    asleep_s: float = SLOWEST_S,
) -> Ended:
    """Runs `ident` or `plan` in a child whose libraries are loaded already.

    Args:
        name: `ident` or `plan`.
        arguments: Its arguments.
        begin: What the child does first.
        most_s: Time on the processor after which it is ended [s].
        asleep_s: Time on the clock without any of that after which it is ended [s].
    """
    with tempfile.TemporaryFile() as errors:
        child = os.fork()
        if not child:
            _be_command(name, arguments, begin, errors.fileno(), int(most_s))
        patience = Patience(child, 2.0 * most_s, asleep_s)
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                break
            patience.look(0)
            time.sleep(LOOKING_S)
        errors.seek(0)
        code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else -os.WTERMSIG(status)
        return Ended(code, errors.read().decode(errors="backslashreplace"))


def _be_command(
    name: str,
    arguments: list[str],
    begin: Callable[[], None],
    errors: int,
    most_s: int,
) -> None:
    status = 1
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(errors, 2)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        sys.argv = [name, *arguments]
        spent = int(time.process_time()) + most_s
        resource.setrlimit(resource.RLIMIT_CPU, (spent, spent + 5))
        begin()
        run_command(name, f"{name}.cli.app")
    except SystemExit as error:
        status = int(error.code or 0)
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    os._exit(status)
