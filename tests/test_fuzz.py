"""What `make fuzz` looks for, on a few fixed inputs: every reader takes what is spoilt, special, or no file at all."""

import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.meshes import COPY_PREFIX
from tests.fuzz.guard import Guard
from tests.fuzz.kills import GOOD, kill_everywhere, writings
from tests.fuzz.kinds import MADE, NETS, Kind, kinds
from tests.fuzz.readers import Readers

ROOT = Path(__file__).parents[1]
NAMES = [kind.name for kind in kinds(Path("nowhere")) if kind.name not in (*NETS, *MADE)]
# What is none of these counts as not there.
PASSED_OVER = ("marker", "metadata.yaml", "metadata.yaml of a .db3", "store/figures", "store/effects", "store/sessions")
PASSED_OVER += ("boards/entry/s001.json", "boards/entry/s001.parquet")
# Far more than any reader here needs, on however slow a machine: a test that would never end is to fail instead.
PATIENCE_S = 600
TERABYTE = 1 << 40


@pytest.fixture
def alarm() -> Iterator[None]:
    def ring(number: int, frame: FrameType | None) -> None:
        raise AssertionError("it hangs")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def kind_of(name: str, folder: Path) -> Kind:
    return next(kind for kind in kinds(folder) if kind.name == name)


@pytest.mark.parametrize("name", NAMES)
def test_reading_reads_and_nothing_else(name: str, corpus: Path, guard: Guard) -> None:
    """Law: reading a file writes, deletes, compiles and runs nothing, and opens none but its neighbours and ours; of a
    mesh that is a copy of its shapes alone.
    """
    kind = kind_of(name, corpus)
    kind.check(kind.read(kind.path))  # what is loaded lazily is loaded here
    with guard.watching():
        kind.read(kind.path)
    homes = [corpus.resolve(), ROOT, *(Path(one).resolve() for one in (*sys.path, sys.prefix) if one)]
    homes += [Path(one).resolve() for one in guard.read if Path(one).name.startswith(COPY_PREFIX)]
    foreign = [one for one in guard.read if not any(Path(one).resolve().is_relative_to(home) for home in homes)]
    assert (guard.done, [one for one in foreign if not one.startswith(("/proc", "/sys"))]) == ([], [])
    # A user's own effects are Python; the pages of a store are made of our own templates.
    assert guard.compiled == [] or name == "catalogue" or name.startswith("store/")


# What may stand where a file should: by its name, how it is put there.
OTHERS: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": Path.mkdir,
    "holes": lambda path: (path.touch(), os.truncate(path, TERABYTE)),
    "link to itself": lambda path: path.symlink_to(path),
}


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in PASSED_OVER])
def test_what_is_no_plain_file_is_told(name: str, other: str, corpus: Path, tmp_path: Path, alarm: None) -> None:
    """Law: no reader waits for a pipe, reads a device or fills the memory from a file with holes."""
    folder = Path(shutil.copytree(corpus, tmp_path / "corpus"))
    kind = kind_of(name, folder)
    kind.path.unlink()
    OTHERS[other](kind.path)
    with pytest.raises(InputError) as caught:
        kind.read(kind.path)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", [*NAMES, *MADE])
def test_spoilt_files_are_read_or_told(name: str, corpus: Path, tmp_path: Path, alarm: None) -> None:
    """Law: one line, or a result that can be right; nothing run, written or deleted."""
    folder = Path(shutil.copytree(corpus, tmp_path / "corpus"))
    kind = kind_of(name, folder)
    readers = Readers([kind], folder, seed=5, keep=tmp_path / "kept")
    before = signal.getsignal(signal.SIGALRM)
    found = [readers.one(number)[1:] for number in range(8)]
    signal.signal(signal.SIGALRM, before)
    assert [one for one in found if one[0] not in ("read", "told")] == []


@pytest.mark.parametrize("name", ["a file over another", "a folder over another", "the same without exchange"])
def test_kills_amid_a_write_leave_the_old_or_the_new(name: str) -> None:
    """Law: at every step on the disk; the next run leaves what one without a kill leaves."""
    writing = next(one for one in writings() if one.name == name)
    outcomes = list(kill_everywhere(writing))
    assert len(outcomes) >= 4
    assert {outcome for outcome, _ in outcomes} == set(GOOD)


def test_the_guard_hears(tmp_path: Path) -> None:
    guard = Guard()
    with guard.watching(tmp_path / "mine"):
        (tmp_path / "mine").mkdir()
        np.save(tmp_path / "mine" / "a.npy", np.zeros(1))
        (tmp_path / "other").mkdir()
        os.system("true")
    assert [one.split()[0] for one in guard.done] == ["os.mkdir", "os.system"]
