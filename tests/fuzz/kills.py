"""Kills amid every write: the process ends by SIGKILL at each of its steps on the disk in turn, and is run again.

Laws: whoever looks after the kill sees what was there before, or what is new, whole; the user's own file beside it is
untouched; and the run after the kill leaves what a run without one leaves, and nothing else.
"""

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from ident import files
from ident.files import atomic_folder, atomic_write
from ident.model.net_options import remove_checkpoint
from ident.model.residual_net import PRESETS, NetOptions, fit_residual_net
from ident.outputs import begin_folder
from ident.recordings.load import load_session
from ident.recordings.save import write_session
from ident.robot.names import data_path
from tests.fuzz.corpus import in_a_child
from tests.fuzz.guard import CHANGING

OUTCOMES = ("as before", "new", "half", "leftovers", "bystander", "traceback")
GOOD = ("as before", "new")
OWN, USERS = "result", "notes.txt"
Tree = dict[str, bytes]
Act = Callable[[Path], None]


@dataclass(frozen=True)
class Writing:
    """Something that is written at `OWN` in a folder."""

    name: str  # in the table
    act: Act  # writes it
    before: Act | None = None  # what is done before, so that there is something to be replaced; nothing if None
    # Whether the result fills step by step: a part of it is no fault then, as the next run completes it.
    steps: bool = False


def writings() -> list[Writing]:
    """All kinds of results by the way in which they are written."""

    def file(text: str) -> Act:
        def act(folder: Path) -> None:
            with atomic_write(folder / OWN) as part:
                part.write_text(text * 1000)

        return act

    def deep(folder: Path) -> None:
        with atomic_write(folder / OWN / "a/b.json") as part:
            part.write_text("new")

    def whole(text: str) -> Act:
        def act(folder: Path) -> None:
            with atomic_folder(folder / OWN, "model") as part:
                for name in (text, "second", "third"):
                    (part / name).write_text(text)

        return act

    def without_exchange(folder: Path) -> None:
        exchange, files._exchange = files._exchange, lambda first, second: False
        try:
            whole("new")(folder)
        finally:
            files._exchange = exchange

    def session(folder: Path) -> None:
        write_session(_session(), folder / OWN)

    def begun(folder: Path) -> None:
        begin_folder(folder / OWN, "check")
        with atomic_write(folder / OWN / "run.json") as part:
            part.write_text("{}")

    def train(folder: Path) -> None:
        _train(folder / OWN)

    def finish(folder: Path) -> None:
        _train(folder / OWN)
        remove_checkpoint(folder / OWN)

    return [
        Writing("a new file", file("new")),
        Writing("a file over another", file("new"), file("old")),
        Writing("a file in new folders", deep, steps=True),
        Writing("a new folder", whole("new")),
        Writing("a folder over another", whole("new"), whole("old")),
        Writing("the same without exchange", without_exchange, whole("old")),
        Writing("a session over another", session, session),
        Writing("a folder that fills", begun, steps=True),
        Writing("a checkpoint", train, steps=True),
        Writing("a checkpoint over another", train, train, steps=True),
        Writing("a finished training", finish, train, steps=True),
    ]


def kill_table(seconds: float, seed: int) -> tuple[tuple[str, ...], dict[str, list[int]], tuple[str, ...]]:
    """Kills each writing at each of its steps: once round at least, and until the time is up."""
    table = {writing.name: [0] * len(OUTCOMES) for writing in writings()}
    end, rounds = time.monotonic() + seconds, 0
    while rounds == 0 or time.monotonic() < end:
        for writing in writings():
            if rounds and time.monotonic() > end:
                break
            for outcome, evidence in kill_everywhere(writing):
                table[writing.name][OUTCOMES.index(outcome)] += 1
                if outcome not in GOOD:
                    print(f"{writing.name} {outcome}: {evidence}", flush=True)
        rounds += 1
    return OUTCOMES, table, GOOD


def kill_everywhere(writing: Writing) -> Iterator[tuple[str, str]]:
    """What is there after a kill at each step, and the evidence of what must not be."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "clean"
        _prepare(writing, folder)
        in_a_child(writing.act, folder)
        new = _tree(folder)
        step = 0
        while True:
            folder = Path(place) / f"killed_{step}"
            _prepare(writing, folder)
            old = _tree(folder)
            if not _killed(writing, folder, step):
                return
            yield _judge(writing, folder, old, new, step)
            step += 1


def _judge(writing: Writing, folder: Path, old: Tree, new: Tree, step: int) -> tuple[str, str]:
    after = {name: data for name, data in _tree(folder).items() if ".armgap-" not in name}
    if after.pop(USERS, None) != old[USERS]:
        return "bystander", f"step {step}"
    seen = {name for name, tree in (("as before", old), ("new", new)) if {**tree, USERS: b""} == {**after, USERS: b""}}
    # Between two renames the old one waits under another name; the next run puts it back.
    missing = not after and any(".armgap-" in name for name in _tree(folder))
    if not seen and not writing.steps and not missing:
        return "half", f"step {step}: {sorted(after)}"
    try:
        in_a_child(writing.act, folder)
    except SystemExit as error:
        return "traceback", f"step {step}: {error}"
    found = _tree(folder)
    if found.keys() != new.keys() or (not writing.steps and found != new):
        return "leftovers", f"step {step}: {sorted(found.keys() ^ new.keys())}"
    return ("new" if "new" in seen else "as before"), ""


def _prepare(writing: Writing, folder: Path) -> None:
    folder.mkdir()
    (folder / USERS).write_text("mine")
    if writing.before is not None:
        in_a_child(writing.before, folder)


def _tree(folder: Path) -> Tree:
    """All files below a folder by their content, and its empty folders."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_file():
            found[name] = path.read_bytes()
        elif not any(path.iterdir()):
            found[name + "/"] = b""
    return found


def _killed(writing: Writing, folder: Path, step: int) -> bool:
    """Writes in a child that is killed before its step of this number; whether it came so far."""
    child = os.fork()
    if not child:
        try:
            _count_down(folder, step)
            writing.act(folder)
        except BaseException:
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise AssertionError(f"{writing.name} fails without a kill")
    return os.WIFSIGNALED(status)


def _count_down(folder: Path, step: int) -> None:
    """Ends this process before one of its steps on the disk."""
    left = step + 1

    def hear(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal left
        if (event == "open" or event in CHANGING) and any(str(folder) in str(one) for one in arguments):
            left -= 1
            if left <= 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hear)


@cache
def _session() -> Any:
    run = Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet"
    with tempfile.TemporaryDirectory() as place:
        pq.write_table(pq.read_table(run).slice(0, 60), Path(place) / "run.parquet")
        return load_session(Path(place) / "run.parquet")


@cache
def _training_data() -> tuple[Any, Any, NetOptions]:
    rng = np.random.default_rng(0)
    states = tuple(rng.normal(size=(4, 60, 2)))
    options = replace(PRESETS["paper"], epochs=20, hidden=(4,))
    return [states], [0.1 * states[3]], options


def _train(folder: Path) -> None:
    states, left, options = _training_data()
    fit_residual_net(states, left, options=options, checkpoint=folder)
