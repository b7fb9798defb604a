"""Spoilt files into readers, in forked processes that are watched: a crash or a hang takes one input, not the run."""

import contextlib
import io
import mmap
import os
import resource
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType

import numpy as np

from ident.errors import InputError
from tests.fuzz.guard import Guard
from tests.fuzz.kinds import Kind, WrongError
from tests.fuzz.patience import Patience
from tests.fuzz.spoil import BY_KIND
from tests.fuzz.tally import Tally
from tests.fuzz.trapped import PUT

OUTCOMES = ("read", "told", "traceback", "hang", "growth", "crash", "lines", "warning", "wrong", "touched", "done")
GOOD = ("read", "told")
# Processor time, and time on the clock for what waits; a machine that others use makes both differ.
HANG_S, WAITING_S = 10, 60
GROWTH_KB = 2_000_000
# What has had so much of a processor on one input hangs below Python.
MOST_S = 2.0 * HANG_S
# Of the inputs: those where no plain file lies, and those that change while they are read.
NOT_PLAIN, SWAPPED = 0.02, 0.04
# Between two looks at a child, and between two times that counts are written down.
LOOKING_S, WRITING_S = 0.2, 60.0
# Inputs that one child reads: leaks of libraries stay small, and what was counted is written down in between.
BATCH = 5_000
Snapshot = dict[str, tuple[int, int]]


class HangError(BaseException):
    """A reader took too long."""


class Readers:
    """The readers of some kinds of files, and what came of each input.

    Args:
        kinds: The kinds.
        place: Folder in which the good files lie: nothing else in it may change.
        seed: Of everything.
        keep: Where inputs that end badly go.
    """

    def __init__(self, kinds: Sequence[Kind], place: Path, seed: int, keep: Path) -> None:
        self.kinds, self.place, self.seed, self.keep = kinds, place, seed, keep
        self._originals = [kind.path.read_bytes() for kind in kinds]
        self._guard = Guard()
        size = len(kinds) * len(OUTCOMES)
        # Shared with the children: counts, the number of the input that is read, and how many were.
        self._shared = np.frombuffer(mmap.mmap(-1, 8 * (size + 2)), dtype=np.int64)
        self._counts = self._shared[:size].reshape(len(kinds), len(OUTCOMES))
        shares = np.array([kind.share for kind in kinds])
        self._chance = np.cumsum(shares / shares.sum())
        self._told: set[str] = set()

    @property
    def inputs(self) -> int:
        """How many were read."""
        return int(self._counts.sum())

    def table(self) -> dict[str, list[int]]:
        """Counts of each kind by outcome."""
        return {kind.name: row.tolist() for kind, row in zip(self.kinds, self._counts, strict=True)}

    def run(self, seconds: float, tally: Tally | None = None) -> None:
        """Reads until the time is up; what was counted is written down in between, if somewhere is given."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            child = os.fork()
            if not child:
                self._be_child(end)
            self._watch(child, tally)
            self._write(tally)

    def one(self, number: int) -> tuple[int, str, str]:
        """Spoils the file that a number stands for, reads it; returns the kind, the outcome and its evidence."""
        rng = np.random.default_rng([self.seed, number])
        index = int(np.searchsorted(self._chance, rng.random()))
        kind, original = self.kinds[index], self._originals[index]
        self._put(kind, original, rng)
        before = self._snapshot(kind.path)
        changes = kind.writes or self._guard.swap is not None
        try:
            outcome, evidence = self._read(kind)
        finally:
            self._guard.swap = None
        if outcome in GOOD and self._guard.done:
            outcome, evidence = "done", "\n".join(self._guard.done)
        if outcome in GOOD and not changes and (after := self._snapshot(kind.path)) != before:
            changed = sorted(set(before.items()) ^ set(after.items()))
            outcome, evidence = "touched", repr(changed)
        return index, outcome, evidence

    def _put(self, kind: Kind, original: bytes, rng: np.random.Generator) -> None:
        """Puts a spoilt file in the good one's place; or what is no plain file, or one that changes."""
        spoilt = spoil(kind, original, rng)
        chance = rng.random()
        if kind.writes or chance > NOT_PLAIN + SWAPPED:
            kind.path.write_bytes(spoilt)
        elif chance < NOT_PLAIN:
            kind.path.unlink()
            PUT[int(rng.integers(len(PUT)))](kind.path)
        else:
            first, second = (original, spoilt) if rng.random() < 0.5 else (spoilt, original)
            kind.path.write_bytes(first)
            in_place = bool(rng.random() < 0.5)
            self._guard.swap = (kind.path, lambda: replace(kind.path, second, in_place))

    def _read(self, kind: Kind) -> tuple[str, str]:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        try:
            with warnings.catch_warnings(record=True) as caught, _quiet():
                warnings.simplefilter("always", RuntimeWarning)
                with self._guard.watching(*([kind.path.parent] if kind.writes else [])):
                    found = kind.read(kind.path)
                kind.check(found)
            runtime = [one for one in caught if issubclass(one.category, RuntimeWarning)]
            outcome = (
                ("warning", f"{runtime[0].filename}:{runtime[0].lineno} {runtime[0].message}") if runtime else None
            )
        except WrongError as error:
            return "wrong", f"{error}\n{traceback.format_exc()}"
        except InputError as error:
            outcome = ("told", "") if len(str(error).splitlines()) == 1 else ("lines", str(error))
        except HangError:
            return "hang", traceback.format_exc()
        except MemoryError:
            return "growth", traceback.format_exc()
        except Exception:
            return "traceback", traceback.format_exc()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak > GROWTH_KB:
            return "growth", "the peak of its memory"
        return outcome or ("read", "")

    def _be_child(self, end: float) -> None:
        """Reads a batch; never returns."""
        try:
            signal.signal(signal.SIGALRM, _ring)
            signal.signal(signal.SIGPROF, _ring)
            for kind in self.kinds:  # what is loaded lazily is loaded here
                kind.check(kind.read(kind.path))
                kind.prepare()
                self._shared[-1] += 1
            limit_memory()
            for _ in range(BATCH):
                if time.monotonic() >= end:
                    break
                number = int(self._shared[-2])
                self._shared[-1] += 1
                index, outcome, evidence = self.one(number)
                self._note(index, number, outcome, evidence)
                self._put_back(index)
                self._shared[-2] += 1
        except BaseException:
            traceback.print_exc()
            os._exit(3)
        os._exit(0)

    def _write(self, tally: Tally | None) -> None:
        """Adds what was counted to a file, if there is one."""
        if tally is not None:
            rows = self.table().items()
            tally.write({name: dict(zip(OUTCOMES, counts, strict=True)) for name, counts in rows})

    def _watch(self, child: int, tally: Tally | None) -> None:
        """Waits for a child; where it dies or hangs, its input is counted, and the next child goes on."""
        patience = Patience(child, MOST_S, WAITING_S)
        written = time.monotonic()
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                break
            patience.look(int(self._shared[-1]))
            if time.monotonic() - written > WRITING_S:
                self._write(tally)
                written = time.monotonic()
            time.sleep(LOOKING_S)
        if os.WIFSIGNALED(status):
            number = int(self._shared[-2])
            index = int(np.searchsorted(self._chance, np.random.default_rng([self.seed, number]).random()))
            outcome = "hang" if os.WTERMSIG(status) == signal.SIGKILL else "crash"
            self._note(index, number, outcome, f"signal {os.WTERMSIG(status)}")
            self._put_back(index)
            self._shared[-2] += 1
        elif os.WEXITSTATUS(status):
            raise SystemExit("the fuzzer itself failed")

    def _note(self, index: int, number: int, outcome: str, evidence: str) -> None:
        self._counts[index, OUTCOMES.index(outcome)] += 1
        if outcome in GOOD:
            return
        kind, last = self.kinds[index], " | ".join((evidence.strip().splitlines() or [""])[-2:])
        known = f"{kind.name} {outcome} {last}"
        if known in self._told:
            return
        self._told.add(known)
        self.keep.mkdir(parents=True, exist_ok=True)
        name = f"{kind.name.replace('/', '_')}_{self.seed}_{number}"
        if kind.path.is_file() and not kind.path.is_symlink():
            shutil.copy(kind.path, self.keep / f"{name}{kind.path.suffix}")
        (self.keep / f"{name}.txt").write_text(evidence, encoding="utf-8", errors="backslashreplace")
        print(f"{kind.name} {outcome} ({self.seed}, {number}): {last!r}", flush=True)

    def _put_back(self, index: int) -> None:
        """The good file, whatever lies in its place."""
        path = self.kinds[index].path
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink(missing_ok=True)
        path.write_bytes(self._originals[index])

    def _snapshot(self, but: Path) -> Snapshot:
        """Sizes and times of all files beside one."""
        found = {}
        for entry in os.scandir(self.place):
            if entry.path != str(but):
                status = entry.stat(follow_symlinks=False)
                found[entry.name] = (status.st_size if entry.is_file() else 0, status.st_mtime_ns)
        return found


def replace(path: Path, data: bytes, in_place: bool) -> None:
    """Another content of a file: written into it, or a file of its own in its place."""
    if in_place:
        path.write_bytes(data)
        return
    beside = path.with_name(f".{path.name}.new")
    beside.write_bytes(data)
    beside.replace(path)


def spoil(kind: Kind, data: bytes, rng: np.random.Generator) -> bytes:
    """One or two faults, by what the file holds."""
    ways = BY_KIND[kind.path.suffix[1:] or "json"]
    for _ in range(int(rng.integers(1, 3))):
        data = ways[int(rng.integers(len(ways)))](data, rng)
    return data


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _ring(number: int, frame: FrameType | None) -> None:
    raise HangError


def limit_memory() -> None:
    """No input may take the machine down: what asks for more than the allowed growth gets a MemoryError."""
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = now + 1024 * GROWTH_KB
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
