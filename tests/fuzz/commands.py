"""Spoilt files into whole commands, each in a forked process whose libraries are loaded already.

Laws: exit 0, 2 or 3; one line where a file is refused; no traceback; nothing of the user's touched; a result that is
written is strict JSON; no more than so much time on the processor and memory.
"""

import json
import os
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.robot.names import data_path
from tests.fuzz.kinds import Kind
from tests.fuzz.options import Ended, fork_command, load_all
from tests.fuzz.readers import limit_memory, spoil
from tests.fuzz.tally import Tally

OUTCOMES = ("done", "refused", "traceback", "status", "lines", "user's", "not strict", "long")
GOOD = ("done", "refused")
USERS = "notes.txt"
RESULT = "result.json"
SOUND_RUN = "E1/01_trajectory_1.parquet"
# Words of which {file} is the spoilt file, {corpus} the folder of good ones, {run} a sound run: by the kind of file.
RECORDING = ("ident inspect {file} --robot tm5-900 --json {out}", "ident new {file} --robot tm5-900")
RECORDING += ("ident evaluate {file} --model {corpus}/model --json {out}", "ident inspect {file} --json {out}")
FOLDER = ("ident inspect {folder} --robot tm5-900 --json {out}", "ident evaluate {folder} --model {corpus}/model")
ROBOT = ("ident inspect {run} --robot {file} --json {out}",)
MODEL_FILES = ("model/model.toml", "model/robot.urdf", "model/residual.json", "model/residual.safetensors")
MODEL = ("ident evaluate {run} --model {corpus}/model --json {out}", "ident export {corpus}/model --out exported")
LINES = {
    **dict.fromkeys(("parquet", "npz", "csv", "bag", "db3", "mcap"), RECORDING),
    **dict.fromkeys(("metadata.yaml", "metadata.yaml of a .db3"), FOLDER),
    **dict.fromkeys(("urdf", "xacro"), ROBOT),
    "included xacro": ("ident inspect {run} --robot {corpus}/arm.xacro --json {out}",),
    **dict.fromkeys(MODEL_FILES, MODEL),
    "limits.toml": ("ident verify {corpus}/model {run} --limits {file} --json {out}",),
    "diagnosis.json": ("ident patch {file} --robot tm5-900 --out patched --json {out}",),
    "world.toml": ("ident simulate --world {file} --runs 1 --duration 1 --rate 50 --out simulated",),
    "plan.json": ("ident simulate --plan {file} --rate 50 --out simulated",),
    "scene.toml": ("plan solve {file} --model {corpus}/model --method toppra --objective time --beyond --json {out}",),
}


@dataclass(frozen=True)
class Attempt:
    """One spoilt file in one command."""

    kind: Kind
    line: str  # the command, its places not filled in
    number: int  # of the input, from which all of it follows


class Commands:
    """Commands that read some kinds of files, and what came of each input.

    Args:
        kinds: The kinds, of which those without a command are left out.
        corpus: Folder of good files.
        seed: Of everything.
    """

    def __init__(self, kinds: list[Kind], corpus: Path, seed: int) -> None:
        self.kinds = [kind for kind in kinds if kind.name in LINES and kind.path.exists()]
        self.corpus, self.seed = corpus, seed
        self.counts = {kind.name: dict.fromkeys(OUTCOMES, 0) for kind in self.kinds}
        load_all()

    def run(self, seconds: float, tally: Tally | None = None) -> None:
        """Tries until the time is up."""
        end = time.monotonic() + seconds
        number = 0
        while time.monotonic() < end:
            attempt = self.draw(number)
            outcome, evidence = self.try_one(attempt)
            self.counts[attempt.kind.name][outcome] += 1
            if outcome not in GOOD:
                words = f"{attempt.kind.name}: {attempt.line}: {outcome} ({self.seed}, {number})"
                print(f"{words}: {evidence!r}", flush=True)
            number += 1
            if tally is not None and number % 20 == 0:
                tally.write(self.counts)
        if tally is not None:
            tally.write(self.counts)

    def draw(self, number: int) -> Attempt:
        """The kind and the command that a number stands for."""
        rng = np.random.default_rng([self.seed, number, 1])
        kind = self.kinds[int(rng.integers(len(self.kinds)))]
        lines = LINES[kind.name]
        return Attempt(kind, lines[int(rng.integers(len(lines)))], number)

    def try_one(self, attempt: Attempt) -> tuple[str, str]:
        """Spoils the file, runs the command in a fresh folder; the outcome and its evidence."""
        path = attempt.kind.path
        original = path.read_bytes()
        rng = np.random.default_rng([self.seed, attempt.number])
        folder = Path(tempfile.mkdtemp())
        try:
            path.write_bytes(spoil(attempt.kind, original, rng))
            (folder / USERS).write_text("mine")
            words = self.words(attempt, folder)

            def begin() -> None:
                os.chdir(folder)
                limit_memory()

            ended = fork_command(words[0], words[1:], begin)
            return judge(ended, folder)
        finally:
            path.write_bytes(original)
            shutil.rmtree(folder, ignore_errors=True)

    def words(self, attempt: Attempt, folder: Path) -> list[str]:
        """The command line."""
        places = {
            "file": attempt.kind.path,
            "folder": attempt.kind.path.parent,
            "corpus": self.corpus,
            "run": Path(data_path("logs/tm5_900")) / SOUND_RUN,
            "out": folder / RESULT,
        }
        return [word.format(**places) for word in attempt.line.split()]


def command_table(
    seconds: float, seed: int, kinds: list[Kind], corpus: Path
) -> tuple[tuple[str, ...], dict[str, list[int]], tuple[str, ...]]:
    """Counts by kind and outcome, of as many tries as the time allows."""
    commands = Commands(kinds, corpus, seed)
    commands.run(seconds)
    table = {name: list(counts.values()) for name, counts in commands.counts.items()}
    return OUTCOMES, table, GOOD


def judge(ended: Ended, folder: Path) -> tuple[str, str]:
    """What came of a command, and what shows it."""
    if "Traceback" in ended.err:
        return "traceback", ended.err[-600:]
    if ended.status < 0:
        return "long", f"signal {-ended.status} {ended.err[-300:]}"
    users = folder / USERS
    if not users.is_file() or users.read_text() != "mine" or (folder / "RUN").exists():
        return "user's", ended.err[-300:]
    if ended.status not in (0, 2, 3):
        return "status", f"{ended.status} {ended.err[-300:]}"
    if ended.status == 2:
        lines = ended.err.strip().splitlines()
        return ("refused", "") if len(lines) == 1 else ("lines", ended.err[-500:])
    return judge_result(folder / RESULT)


def judge_result(path: Path) -> tuple[str, str]:
    """Whether what was written, if anything, is strict JSON."""
    if not path.exists():
        return "done", ""
    strange: list[str] = []
    try:
        json.loads(path.read_text(encoding="utf-8"), parse_constant=strange.append)
    except ValueError as error:
        return "not strict", str(error)
    return ("not strict", strange[0]) if strange else ("done", "")
