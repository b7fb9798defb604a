"""Kills amid whole commands: what lies in the folder at each of a command's steps on the disk, and after real kills.

A process that is killed outright leaves on the disk what its last step left there. So a command that runs once is a
kill at each of its steps, if the folder is looked at before each. What is looked at must be whole, file by file: as it
was before, as it is in the end, or a state in between that can be read. Some commands are killed in earnest, at a
moment drawn anew, and run again: they leave what a run without a kill leaves.

    python -m tests.fuzz.command_kills [--seed N] [--kills 1] [--only NAME,NAME] [--tally FILE]
"""

import argparse
import os
import secrets
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.robot.names import data_path
from tests.fuzz.corpus import in_a_child, write_files
from tests.fuzz.guard import CHANGING, WRITES
from tests.fuzz.options import fork_command, load_all
from tests.fuzz.tally import Tally
from tests.fuzz.whole import what_is_broken

USERS = "notes.txt"
TEMPORARY = ".armgap-"
# Steps on the disk at which the folder of one command is looked at.
MOST_STEPS = 300
# A command may take so much processor time [s].
MOST_S = 600.0
OUTCOMES = ("whole", "broken", "user's", "leftovers", "fails")
TASK = """robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [80, 30, -90]
duration_s = 0.65
"""
CYCLE = """robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [50, 0, -120]
[[leg]]
deg = [65, 15, -105]
dwell_s = 0.2
"""
# By a name: {c} is a folder of good files, {r} of recordings; all else is relative to the folder that is watched.
LINES = {
    "inspect": "ident inspect {r}/E1/01_trajectory_1.parquet --robot tm5-900 --mend mended --json a.json",
    "new": "ident new run.csv --robot tm5-900",
    "fit": "ident fit {r}/E1 --robot tm5-900 --net none --out model --json a.json",
    "evaluate": "ident evaluate {r}/E1/01_trajectory_1.parquet --model {c}/model --html a.html --json a.json",
    "diagnose": "ident diagnose {r}/sealed_1 --robot tm5-900 --html a.html --json a.json",
    "patch": "ident patch {c}/diagnosis.json --robot tm5-900 --out patch --json a.json",
    "export": "ident export {c}/model --out export",
    "simulate": "ident simulate --out session --runs 2 --duration 2 --rate 50 --json a.json",
    "servo": "ident servo servo.csv --out servo --json a.json",
    "verify": "ident verify {c}/model {r}/E1 --limits {c}/limits.toml --json a.json",
    "view": "ident view {r}/E1/01_trajectory_1.parquet --robot tm5-900 --rrd a.rrd",
    "ranges": "ident ranges {r}/E1 --robot tm5-900 --out ranges --json a.json",
    "watch": "ident watch cell --robot tm5-900 --store store --once --settle 0 --no-diagnose --json a.json",
    "compare": "ident compare {r}/E1 --after {r}/payload_516g --robot tm5-900 --out compared --json a.json",
    "blind": "ident blind --cases 1 --workers 1 --out blind --json a.json",
    "close": "ident close --out closed --arms 1 --rounds 1 --json a.json",
    "board": "ident board make board --cases 1 --seed 1 --worlds development",
    "excite": "plan excite --separate backlash,payload --minutes 0.3 --evaluations 8 --out motion --json a.json",
    "solve": "plan solve task.toml --method toppra --objective time --beyond --out a.csv --json a.json --picture a.png",
    "cycle": "plan cycle cycle.toml --out motions --objective time --evaluations 40 --json a.json",
    "plan compare": "plan compare task.toml --methods toppra --objective time --seeds 1 --out compared --json a.json",
    "paper": "plan paper --model {c}/model --out paper --epochs 1 --generations 1 --trials 1 --levels 2",
}


@dataclass(frozen=True)
class Place:
    """Where commands are killed."""

    corpus: Path  # good files
    scratch: Path  # an empty folder


class Shadow:
    """Copies a folder before each step on the disk in it that this process takes.

    Args:
        folder: The folder.
        copies: Where the copies go, numbered.
    """

    def __init__(self, folder: Path, copies: Path) -> None:
        self.folder, self.copies = folder, copies
        self.count = 0
        self._last: list[tuple[str, int, int]] = []
        self._is_on = True
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._is_on or self.count >= MOST_STEPS or not changes(event, arguments):
            return
        self._is_on = False  # to look is not what is watched
        try:
            self._take()
        finally:
            self._is_on = True

    def _take(self) -> None:
        state = sizes(self.folder)
        if state != self._last:
            shutil.copytree(self.folder, self.copies / f"{self.count:04d}", symlinks=True)
            self._last = state
            self.count += 1


def changes(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an event of Python's audit changes anything on a disk."""
    if event != "open":
        return event in CHANGING
    _, mode, flags = arguments
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    return bool(int(flags or 0) & WRITES)


def sizes(folder: Path) -> list[tuple[str, int, int]]:
    """Names, sizes and times of all files in a folder."""
    state = []
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        state.append((str(path), status.st_size, status.st_mtime_ns))
    return state


def prepare(folder: Path) -> None:
    """What commands read from the folder in which they write, and a file of the user's."""
    folder.mkdir(parents=True)
    recordings = Path(data_path("logs/tm5_900"))
    (folder / USERS).write_text("mine")
    (folder / "task.toml").write_text(TASK)
    (folder / "cycle.toml").write_text(CYCLE)
    (folder / "cell").mkdir()
    shutil.copytree(recordings / "E1", folder / "cell/monday")
    stamps = np.arange(0.0, 20.0, 0.01)
    goal = 0.5 * np.sin(1.3 * stamps) + 0.3 * np.sin(3.1 * stamps)
    rows = np.column_stack([stamps, np.interp(stamps - 0.04, stamps, goal), goal])
    header = "time,shoulder/position,shoulder/position_command"
    np.savetxt(folder / "servo.csv", rows, delimiter=",", header=header, comments="")


class Killing:
    """One command, its folder looked at before each step, then killed in earnest.

    Args:
        line: The command.
        place: Where.
        rng: Of the moments.
    """

    def __init__(self, line: str, place: Place, rng: np.random.Generator) -> None:
        self.words = line.format(c=place.corpus, r=data_path("logs/tm5_900")).split()
        self.place, self.rng = place, rng
        self.clean = place.scratch / "clean"
        self.copies = place.scratch / "copies"
        self.spent_s = 0.0

    def run(self, kills: int) -> list[tuple[str, str]]:
        """What came of each look and each kill, with what shows it."""
        prepare(self.clean)
        shutil.copy(self.place.corpus / "run.csv", self.clean / "run.csv")
        before = self.place.scratch / "before"
        shutil.copytree(self.clean, before)
        self.copies.mkdir()
        error = self._run_whole(self.clean, self.copies)
        if error:
            return [("fails", error)]
        copies = sorted(self.copies.iterdir())
        outcomes = [self.judge(copy, before) for copy in copies]
        outcomes += [self.kill(before) for _ in range(kills)]
        if copies:
            outcomes.append(self.again(copies[int(self.rng.integers(len(copies)))]))
        return outcomes

    def judge(self, after: Path, before: Path) -> tuple[str, str]:
        """A folder as a kill leaves it: every file whole, the user's untouched."""
        if (after / USERS).read_text() != "mine":
            return "user's", ""
        for path in sorted(after.rglob("*")):
            name = path.relative_to(after)
            if not path.is_file() or TEMPORARY in str(name):
                continue
            data = path.read_bytes()
            if any((tree / name).is_file() and (tree / name).read_bytes() == data for tree in (before, self.clean)):
                continue
            fault = what_is_broken(path)
            if fault:
                return "broken", f"{after.name}/{name}: {fault}"
        return "whole", ""

    def kill(self, before: Path) -> tuple[str, str]:
        """A run that is ended outright at a moment drawn from its whole length."""
        folder = self.place.scratch / "killed"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(before, folder)
        moment_s = max(0.01, float(self.rng.random()) * self.spent_s)

        def begin() -> None:
            os.chdir(folder)
            signal.setitimer(signal.ITIMER_PROF, moment_s)

        fork_command(self.words[0], self.words[1:], begin, MOST_S)
        return self.judge(folder, before)

    def again(self, killed: Path) -> tuple[str, str]:
        """The command run again in a folder as a kill left it: it leaves what a run without a kill leaves."""
        folder = self.place.scratch / "again"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(killed, folder)
        error = self._run_whole(folder, None)
        if error:
            return "fails", f"after {killed.name}: {error}"
        different = names(folder) ^ names(self.clean)
        return ("leftovers", f"after {killed.name}: {sorted(different)}") if different else ("whole", "")

    def _run_whole(self, folder: Path, copies: Path | None) -> str:
        """Runs the command to its end; what it says where it fails."""

        def begin() -> None:
            os.chdir(folder)
            if copies is not None:
                Shadow(folder, copies)

        spent_s = sum(os.times()[2:4])
        ended = fork_command(self.words[0], self.words[1:], begin, MOST_S)
        self.spent_s = sum(os.times()[2:4]) - spent_s
        return "" if ended.status in (0, 3) else f"{ended.status} {ended.err[-400:]}"


def names(folder: Path) -> set[str]:
    """Of all files in a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def kill_commands(chosen: list[str], kills: int, seed: int, tally: Tally | None) -> dict[str, dict[str, int]]:
    """Kills each command; the counts by its name and outcome."""
    table: dict[str, dict[str, int]] = {}
    with tempfile.TemporaryDirectory() as corpus:
        in_a_child(write_files, Path(corpus), False)
        load_all()
        for number, name in enumerate(chosen):
            begun = time.monotonic()
            table[name] = dict.fromkeys(OUTCOMES, 0)
            with tempfile.TemporaryDirectory() as scratch:
                killing = Killing(
                    LINES[name], Place(Path(corpus), Path(scratch)), np.random.default_rng([seed, number])
                )
                for outcome, evidence in killing.run(kills):
                    table[name][outcome] += 1
                    if outcome != "whole":
                        print(f"{name}: {outcome}: {evidence}", flush=True)
            took = f"{killing.spent_s:.1f} s of processor time, {time.monotonic() - begun:.0f} s in all"
            print(f"{name}: {table[name]}, {took}", flush=True)
            if tally is not None:
                tally.write(table)
    return table


def main() -> None:
    """Kills what is asked for, and prints what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    parser.add_argument("--kills", type=int, default=1, help="kills in earnest of each command")
    parser.add_argument("--only", default="", help="names of commands, with commas; all if not given")
    parser.add_argument("--tally", type=Path, help="file that counts are added to")
    options = parser.parse_args()
    chosen = options.only.split(",") if options.only else list(LINES)
    tally = Tally(options.tally, "kills", options.seed) if options.tally else None
    table = kill_commands(chosen, options.kills, options.seed, tally)
    bad = sum(count for counts in table.values() for outcome, count in counts.items() if outcome != "whole")
    print(f"{sum(sum(counts.values()) for counts in table.values())} looks and kills, {bad} of them bad")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
