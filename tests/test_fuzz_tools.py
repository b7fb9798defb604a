"""Laws of the fuzzer's own tools: who hangs, what is half-written, what all runs come to."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.files import atomic_write
from tests.fuzz.command_kills import LINES, Killing, Place, Shadow
from tests.fuzz.commands import judge
from tests.fuzz.corpus import in_a_child
from tests.fuzz.options import Ended
from tests.fuzz.patience import Patience, read_process
from tests.fuzz.tally import Tally, add_up, total
from tests.fuzz.trapped import lay_traps
from tests.fuzz.whole import what_is_broken


def fork(act: Callable[[], object]) -> int:
    """A child that does something until it is ended."""
    child = os.fork()
    if not child:
        act()
        os._exit(0)
    return child


def spin() -> None:
    while True:
        pass


def ended_by(child: int, patience: Patience) -> int:
    """The signal by which a child is ended that is looked at until then."""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.WTERMSIG(status)
        patience.look(0)
        time.sleep(0.01)


def test_a_child_that_sleeps_is_woken_and_one_that_goes_on_is_ended() -> None:
    sleeping = fork(signal.pause)
    assert ended_by(sleeping, Patience(sleeping, most_s=1e6, asleep_s=0.1)) == signal.SIGALRM
    spinning = fork(spin)
    assert ended_by(spinning, Patience(spinning, most_s=0.1, asleep_s=1e6)) == signal.SIGKILL


def test_a_child_that_waits_for_a_processor_does_not_hang() -> None:
    """Law: it counts as at work, however long it has none."""
    spinning = fork(spin)
    patience = Patience(spinning, most_s=1e6, asleep_s=0.0)
    for _ in range(5):
        patience.look(0)
    spent_s, is_busy = read_process(spinning)
    assert is_busy
    assert spent_s >= 0.0
    os.kill(spinning, signal.SIGKILL)
    os.waitpid(spinning, 0)


def test_the_last_line_of_each_run_counts(tmp_path: Path) -> None:
    """Law: a run writes its counts again and again; runs are added."""
    path = tmp_path / "tally.jsonl"
    first = Tally(path, "files", 1)
    first.write({"csv": {"read": 1, "told": 0}})
    first.write({"csv": {"read": 3, "told": 2}})
    Tally(path, "files", 2).write({"csv": {"read": 4}, "urdf": {"told": 5}})
    Tally(path, "kills", 1).write({"fit": {"whole": 7}})
    sums = add_up(path)
    assert total(sums["files"]) == {"read": 7, "told": 7}
    assert total(sums["kills"]) == {"whole": 7}


GOOD = {
    "a.json": b'{"a": [1, 2]}',
    "a.toml": b"a = [1,\n2]\n",
    "a.html": b"<html></html>",
    "a.csv": b"a,b\n1,2\n",
    "a.xml": b"<a><b/></a>",
    "a.py": b"def f():\n    return (1)\n",
}


@pytest.mark.parametrize("name", GOOD)
def test_a_file_that_ends_early_is_broken(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(GOOD[name])
    assert what_is_broken(path) == ""
    path.write_bytes(GOOD[name][:-2])
    assert what_is_broken(path)


def test_a_kill_at_any_step_of_a_careful_write_is_seen_whole_and_of_a_careless_one_is_not(tmp_path: Path) -> None:
    """Law: the folder is looked at before each step on the disk."""

    def careful(folder: Path, copies: Path) -> None:
        Shadow(folder, copies)
        with atomic_write(folder / "a.json") as part:
            part.write_text('{"a": 1}')
        (folder / "last").touch()

    def careless(folder: Path, copies: Path) -> None:
        Shadow(folder, copies)
        with (folder / "a.json").open("w") as file:
            file.write('{"a": ')
            file.flush()
            (folder / "last").touch()

    broken = {}
    for act in (careful, careless):
        folder, copies = tmp_path / act.__name__, tmp_path / f"{act.__name__}_copies"
        folder.mkdir()
        copies.mkdir()
        in_a_child(act, folder, copies)
        results = list(copies.glob("*/a.json"))
        broken[act.__name__] = [path for path in results if what_is_broken(path)]
        assert results
    assert broken["careful"] == []
    assert broken["careless"]


def test_a_trap_folder_follows_from_its_bytes(tmp_path: Path) -> None:
    run = tmp_path / "run.parquet"
    run.write_bytes(b"run")
    laid = [sorted(os.listdir(lay_traps(seed, run, tmp_path / "session"))) for seed in (b"a", b"a", b"b", b"c")]
    assert laid[0] == laid[1]
    assert len({tuple(names) for names in laid}) > 1
    assert all("01.parquet" in names for names in laid)


@pytest.mark.parametrize(
    ("status", "err", "outcome"),
    [
        (0, "", "done"),
        (2, "ident: a line\n", "refused"),
        (2, "ident: a line\nand another\n", "lines"),
        (1, "Traceback (most recent call last)", "traceback"),
        (74, "ident: memory is full\n", "status"),
        (-signal.SIGXCPU, "", "long"),
    ],
)
def test_what_a_command_did_is_judged(status: int, err: str, outcome: str, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert judge(Ended(status, err), tmp_path)[0] == outcome


def test_a_result_that_is_no_strict_json_is_told(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "result.json").write_text(json.dumps({"a": float("nan")}))
    assert judge(Ended(0, ""), tmp_path)[0] == "not strict"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simulate", "new", "patch"])
def test_a_command_that_is_killed_leaves_whole_files(name: str, corpus: Path, tmp_path: Path) -> None:
    """Law: at each of its steps on the disk, at a moment drawn anew, and when it is run again."""
    killing = Killing(LINES[name], Place(corpus, tmp_path), np.random.default_rng(0))
    outcomes = killing.run(kills=2)
    assert len(outcomes) > 3
    assert {outcome for outcome, _ in outcomes} == {"whole"}, outcomes
